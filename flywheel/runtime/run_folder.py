"""Where a run keeps what, and whether a folder may be begun or continued.

    config.yaml               resolved configuration
    run.json                  who the run is
    run.lock                  held by its one driver
    store/                    trajectory store (unless the configuration names another)
    cache/<snapshot>/         windows for training, made from a snapshot; may be deleted
    models/i0001-mppi/        checkpoints and weights
    iterations/i0001-mppi.json  what the iteration produced; its presence means that it is done
    iterations/i0001-diagnosis.json  what the plant was found to lack before it, with a page
    result.json               the run so far, for reports

There is no file that says how far a run is: what is there says it.
"""

from __future__ import annotations

import re
import shutil
import time
import uuid
from dataclasses import dataclass
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict

from flywheel.errors import ConfigError, RunError
from flywheel.robots import Robot, load_robot
from flywheel.runtime.config import RunConfig, config_digest, decisive
from flywheel.runtime.config_files import differences, validated
from flywheel.runtime.measures import DiagnosisNote
from flywheel.runtime.results import Arm, IterationResult, load, save
from flywheel.runtime.served import WEIGHTS


class Identity(BaseModel):
    """Who a run is.

    Attributes:
      key: unique; MLflow finds the run by it.
      config_digest: of what decides its results.
      begun: local time.
    """

    model_config = ConfigDict(frozen=True)

    key: str
    config_digest: str
    begun: str


@dataclass(frozen=True)
class RunFolder:
    """The files of one run.

    Attributes:
      path: of the folder.
    """

    path: Path

    @property
    def lock(self) -> Path:
        """Held by the driver."""
        return self.path / "run.lock"

    @property
    def config_file(self) -> Path:
        """Resolved configuration."""
        return self.path / "config.yaml"

    @property
    def robot_file(self) -> Path:
        """Copy of the MJCF that the run was begun with."""
        return self.path / "robot.xml"

    def robot(self, config: RunConfig) -> Robot:
        """The robot that the run was begun with, wherever its MJCF is now.

        Raises:
          RobotError: a run from before there were copies, and the MJCF cannot be used.
        """
        if self.robot_file.exists():
            return Robot.from_mjcf(self.robot_file)
        return load_robot(config.robot)

    @property
    def cache(self) -> Path:
        """Windows for training; made again where missing."""
        return self.path / "cache"

    def store_url(self, config: RunConfig) -> str:
        """Where the episodes are."""
        return config.store or str((self.path / "store").absolute())

    def model(self, iteration: int, arm: Arm) -> Path:
        """Folder of an iteration's checkpoints and weights."""
        return (self.path / "models" / name_of(iteration, arm)).absolute()

    def weights(self, iteration: int, arm: Arm) -> Path:
        """The weights of an iteration's model, in a folder that `served.read_served` reads."""
        return self.model(iteration, arm) / "served" / WEIGHTS

    def finished(self, iteration: int, arm: Arm) -> IterationResult | None:
        """What an iteration produced, or None if it is not done."""
        path = self._result(iteration, arm)
        return load(IterationResult, path) if path.exists() else None

    def finish(self, result: IterationResult) -> None:
        """Note that an iteration is done, in one atomic step."""
        save(result, self._result(result.iteration, result.arm))

    def diagnosis(self, iteration: int) -> DiagnosisNote | None:
        """What was found before an iteration; None if nobody asked yet."""
        path = self._diagnosis(iteration).with_suffix(".json")
        return load(DiagnosisNote, path) if path.exists() else None

    def keep_diagnosis(self, iteration: int, note: DiagnosisNote, page: str) -> DiagnosisNote:
        """Write the page, then the note: with it, the diagnosis is done."""
        path = self._diagnosis(iteration)
        path.parent.mkdir(parents=True, exist_ok=True)
        html = path.with_suffix(".html")
        html.write_text(page, encoding="utf-8")
        note = note.model_copy(update={"page": str(html.relative_to(self.path))})
        save(note, path.with_suffix(".json"))
        return note

    def forget(self, iteration: int, arm: Arm) -> None:
        """Take an iteration as not done, so that it is done again."""
        self._result(iteration, arm).unlink(missing_ok=True)

    def begin(self, config: RunConfig, resume: bool) -> Identity:
        """Begin a run here, or go on with the one that is here.

        Raises:
          ConfigError: there is a run and `resume` is false, or its configuration or MJCF was another.
          RobotError: the MJCF cannot be used.
        """
        if not self.config_file.exists():
            return self._created(config)
        if not resume:
            raise ConfigError(
                f"There is a run in {self.path} already. Continue it with --resume, or give "
                "another folder."
            )
        stored = validated(
            RunConfig, yaml.safe_load(self.config_file.read_text()), str(self.config_file)
        )
        if changes := list(differences(decisive(stored), decisive(config))):
            lines = "\n".join(f"  {change}" for change in changes)
            raise ConfigError(
                f"The run in {self.path} was begun with another configuration:\n{lines}\n"
                "Resume it with the one it has, or begin a new run in another folder."
            )
        self._check_robot(config)
        return Identity.model_validate_json((self.path / "run.json").read_text())

    def _check_robot(self, config: RunConfig) -> None:
        """Refuse an MJCF that was edited since; one that is gone is not missed."""
        if config.robot.endswith(".xml") and not Path(config.robot).exists():
            return
        now, kept = load_robot(config.robot), self.robot(config)
        if now.digest != kept.digest:
            raise ConfigError(
                f"The robot {config.robot} has changed since the run in {self.path} was begun (digest "
                f"{kept.digest[:12]} -> {now.digest[:12]}): its episodes are of the MJCF kept in "
                f"{self.robot_file.name}. Begin a new run in another folder, or restore that MJCF."
            )

    def check_space(self, least_gb: float) -> None:
        """Raises RunError where the disk is almost full."""
        free = shutil.disk_usage(self.path).free / 1e9
        if free < least_gb:
            raise RunError(
                f"Only {free:.1f} GB are free where {self.path} lies; a run wants at least "
                f"{least_gb:g} GB (workers.least_free_gb)."
            )

    def _created(self, config: RunConfig) -> Identity:
        self.check_space(config.workers.least_free_gb)  # a run that is refused leaves nothing
        identity = Identity(
            key=f"{re.sub('[^A-Za-z0-9._-]+', '-', config.name)[:80]}-{uuid.uuid4().hex[:8]}",
            config_digest=config_digest(config),
            begun=time.strftime("%F %T"),
        )
        self.robot_file.write_text(load_robot(config.robot).xml)
        (self.path / "run.json").write_text(identity.model_dump_json(indent=1))
        text = yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)
        temporary = self.config_file.with_suffix(".tmp")
        temporary.write_text(text)
        temporary.replace(self.config_file)  # last: with it, the run has begun
        return identity

    def _diagnosis(self, iteration: int) -> Path:
        return self.path / "iterations" / f"i{iteration:04d}-diagnosis"

    def _result(self, iteration: int, arm: Arm) -> Path:
        return self.path / "iterations" / f"{name_of(iteration, arm)}.json"


def name_of(iteration: int, arm: Arm) -> str:
    """What snapshots, models and results of an iteration are called."""
    return f"i{iteration:04d}-{arm}"
