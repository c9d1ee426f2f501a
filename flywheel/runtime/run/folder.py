"""The files of a run's folder, and the checks before a run is started or continued there.

    config.yaml               resolved configuration
    run.json                  identity of the run
    my_laws.py                copies of the law files that the configuration names
    initial.npz, .json        copy of the weights that the first training begins with, if it names any
    run.lock                  held by its one driver
    store/                    trajectory store (unless the configuration names another)
    cache/<snapshot>/         training windows made from a snapshot; may be deleted
    models/i0001-mppi/        checkpoints and weights
    robot/                    transcripts of what went over the link; what a stand-in is
    iterations/i0001-mppi.json  result of the iteration; it is done when this file is there
    iterations/i0001-diagnosis.json  diagnosis of the plant before the iteration, with a page
    result.json               the run so far, for reports

The progress of a run is not stored: it follows from the existing files.
"""

from __future__ import annotations

import os
import re
import shutil
import time
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flywheel.errors import ConfigError, RunError
from flywheel.files import file_name
from flywheel.outputs import remove_unfinished
from flywheel.results import NOTHING, RESULT_FILE, Arm, DiagnosisNote, IterationResult, read, save
from flywheel.robot_link import StandInConfig
from flywheel.robot_link.opening import SIMULATED
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.run_identity import HOW, RUN_FILE, Begun, Identity, read_begun, write_identity
from flywheel.runtime.config.loading import yaml_of
from flywheel.runtime.config.robot_config import STAND_IN_FILE, read_stand_in, write_stand_in
from flywheel.runtime.config.run_config import RunConfig, config_digest, decisive, load_config
from flywheel.runtime.run.initial_weights import INITIAL_WEIGHTS, SIDE_FILE, initial_weights
from flywheel.runtime.tracking.pyfunc_model import WEIGHTS
from flywheel.seals import Seal, file_sha256
from flywheel.validation import differences, lines

ITERATION, DIAGNOSIS = "iteration", "diagnosis"
UNFINISHED = re.compile(r"\..*|.*\.(lock|part|tmp)")  # being written, or left by a killed process
POOLED = "pooled-tests"  # the snapshot of the test episodes of all iterations
SEGMENT, SNAPSHOT = "segments/", "snapshots/"  # begin the names of what is in a store, on a seal
ARMS: tuple[Arm, ...] = ("mppi", "control")


@dataclass(frozen=True)
class RunFolder:
    """The files of one run.

    Attributes:
      path: of the folder.
    """

    path: Path

    @property
    def lock(self) -> Path:
        """The lock that the driver holds."""
        return self.path / "run.lock"

    @property
    def there(self) -> bool:
        """True if a run was started here, whatever is left of it."""
        return self.config_file.exists() or os.path.lexists(self.path / RUN_FILE)

    @property
    def config_file(self) -> Path:
        """The resolved configuration."""
        return self.path / "config.yaml"

    @property
    def robot_file(self) -> Path:
        """The copy of the MJCF at the start of the run."""
        return self.path / "robot.xml"

    def config(self) -> RunConfig:
        """The configuration at the start of the run.

        Raises:
          Unsound: the file, a copy of a named file or run.json was changed since then.
          ConfigError: it is not a configuration.
        """
        begun = read_begun(self.path)
        for name in (self.config_file.name, *self.copies(begun)):
            begun.check(self.path, name)
        return load_config(self.config_file, stored=True)

    def copies(self, begun: Begun) -> list[str]:
        """Names of the copies of files named in the configuration: law files, initial weights."""
        return sorted(begun.files.keys() - {self.config_file.name, self.robot_file.name})

    @property
    def initial_weights(self) -> Path | None:
        """The copy of the initial weights of the first training; None for random ones."""
        path = (self.path / INITIAL_WEIGHTS).absolute()
        return path if path.exists() else None

    def robot(self, config: RunConfig) -> Robot:
        """The robot at the start of the run, wherever its MJCF is now.

        Raises:
          Unsound: the copy of its MJCF was changed since then.
          RobotError: there is no run here, and the MJCF cannot be used.
        """
        if not self.config_file.exists():
            return load_robot(config.model)
        read_begun(self.path).check(self.path, self.robot_file.name)
        return read_robot(self.robot_file)

    @property
    def robot_folder(self) -> Path:
        """Transcripts of the robot's link, and the stand-in's description."""
        return (self.path / "robot").absolute()

    @property
    def cache(self) -> Path:
        """The folder of the training windows, which are rebuilt if missing."""
        return self.path / "cache"

    def store_url(self, config: RunConfig) -> str:
        """URL of the store with the run's episodes."""
        return config.store or str((self.path / "store").absolute())

    def model(self, iteration: int, arm: Arm) -> Path:
        """The folder of an iteration's checkpoints and weights."""
        return (self.path / "models" / name_of(iteration, arm)).absolute()

    def model_files(self, iteration: int, arm: Arm) -> list[Path]:
        """The files in that folder, without unfinished ones."""
        found = sorted(self.model(iteration, arm).rglob("*"))
        return [path for path in found if not path.is_dir() and not UNFINISHED.fullmatch(path.name)]

    def weights(self, iteration: int, arm: Arm) -> Path:
        """The weights of an iteration's model, in a folder that `pyfunc_model.read_model` reads."""
        return self.model(iteration, arm) / "served" / WEIGHTS

    def residual(self, iteration: int) -> Path:
        """The weights of an iteration's residual model, which belong to the files of its model."""
        return self.model(iteration, "mppi") / "residual" / "residual.npz"

    def finished(self, iteration: int, arm: Arm) -> IterationResult | None:
        """The result of an iteration; None if it is not complete.

        Raises:
          Unsound: its file was altered, or belongs to another run.
        """
        found = self.kept(iteration, arm)
        return None if found is None else found[0]

    def kept(self, iteration: int, arm: Arm) -> tuple[IterationResult, Seal] | None:
        """The result of an iteration with its seal, which names all its dependencies; None if it is
        not complete.
        """
        path = self.result_file(iteration, arm)
        if not os.path.lexists(path):
            return None
        return read(IterationResult, path, Seal(ITERATION, path.stem, self.begun().identity.key))

    def finish(self, result: IterationResult, rests_on: Mapping[str, str] = NOTHING) -> None:
        """Write the result of an iteration in one atomic step, which completes the iteration.

        Args:
          result: of the iteration.
          rests_on: name -> digest of the iteration's other files, for the seal.
        """
        path = self.result_file(result.iteration, result.arm)
        save(result, path, Seal(ITERATION, path.stem, self.begun().identity.key, rests_on))

    def diagnosis(self, iteration: int) -> DiagnosisNote | None:
        """The diagnosis before an iteration; None if there is none (yet).

        Raises:
          Unsound: its file was altered, or belongs to another run.
        """
        found = self.kept_diagnosis(iteration)
        return None if found is None else found[0]

    def kept_diagnosis(self, iteration: int) -> tuple[DiagnosisNote, Seal] | None:
        """The diagnosis before an iteration with its seal, which names its page; None if there is none."""
        path = self._diagnosis(iteration).with_suffix(".json")
        if not os.path.lexists(path):
            return None
        return read(DiagnosisNote, path, Seal(DIAGNOSIS, path.stem, self.begun().identity.key))

    def keep_diagnosis(self, iteration: int, note: DiagnosisNote, page: str) -> DiagnosisNote:
        """Write the page, then the note, which completes the diagnosis.

        Returns:
          The note with the page's path.
        """
        path = self._diagnosis(iteration)
        path.parent.mkdir(parents=True, exist_ok=True)
        html = path.with_suffix(".html")
        html.write_text(page, encoding="utf-8")
        note = note.model_copy(update={"page": str(html.relative_to(self.path))})
        rests_on = {note.page: file_sha256(html, "page")}
        seal = Seal(DIAGNOSIS, path.name, self.begun().identity.key, rests_on)
        save(note, path.with_suffix(".json"), seal)
        return note

    def begun(self) -> Begun:
        """The identity of the run, and the digests of its initial files.

        Raises:
          Unsound: run.json is missing or was altered.
        """
        return read_begun(self.path)

    def begin(self, config: RunConfig, resume: bool) -> Identity:
        """Start a run here, or continue the run that is here.

        Raises:
          ConfigError: there is a run and `resume` is false, or it has another configuration or
            MJCF.
          Unsound: an initial file of the run was changed.
          RobotError: the MJCF cannot be used.
        """
        parts = (".", "iterations", "robot", "figures", "videos")
        for folder in (*map(self.path.joinpath, parts), *self.path.glob("models/*/**/")):
            remove_unfinished(folder)
        if not self.config_file.exists():
            self._check_empty()
            return self._created(config)
        if not resume:
            raise ConfigError(
                f"There is a run in {self.path} already. Continue it with --resume, or give "
                "another folder."
            )
        stored = self.config()
        old, new = ({**decisive(each), "store": each.store} for each in (stored, config))
        if changes := list(differences(old, new)):
            raise ConfigError(
                f"The run in {self.path} was started with another "
                f"configuration:\n{lines(changes)}\nResume it with its own, or start a new run in "
                "another folder."
            )
        self._check_robot(config)
        self._check_stand_in(stored, config)
        return self.begun().identity

    def _check_empty(self) -> None:
        """Reject the folder of a run whose configuration is gone."""
        left = [
            name for name in (RESULT_FILE, "iterations", "models") if (self.path / name).exists()
        ]
        if left:
            raise ConfigError(
                f"{self.path} has no {self.config_file.name}, but is the folder of a run: it has "
                f"{' and '.join(left)}. {HOW}"
            )

    def _check_robot(self, config: RunConfig) -> None:
        """Reject an MJCF that was edited since the start of the run; it may be gone, because the
        run has a copy.
        """
        if config.model.endswith(".xml") and not Path(config.model).exists():
            return
        now, kept = load_robot(config.model), self.robot(config)
        if now.digest != kept.digest:
            raise ConfigError(
                f"The robot {config.model} has changed since the run in {self.path} was started "
                f"(digest {kept.digest[:12]} -> {now.digest[:12]}): its episodes are of the MJCF "
                f"kept in {self.robot_file.name}. Start a new run in another folder, or restore "
                "that MJCF."
            )

    def _check_stand_in(self, stored: RunConfig, config: RunConfig) -> None:
        """Reject another stand-in than at the start of the run, and one whose description is gone; an
        omitted description counts as the same.
        """
        if config.robot is None or stored.robot is None:
            return
        kept = read_stand_in(self.robot_folder)
        if kept is None and stored.robot.link == SIMULATED:
            raise ConfigError(f"There is no file {self.robot_folder / STAND_IN_FILE}. {HOW}")
        if config.robot.stand_in not in (StandInConfig(), kept):
            raise ConfigError(
                f"The run in {self.path} was started on another robot: its hidden effects, or its "
                f"sensors, differ from {self.robot_folder.name}/{STAND_IN_FILE}. Start a new run "
                "in another folder."
            )

    def check_space(self, least_gb: float) -> None:
        """Reject a disk that is almost full.

        Raises:
          RunError: less than `least_gb` is free.
        """
        free = shutil.disk_usage(self.path).free / 1e9
        if free < least_gb:
            raise RunError(
                f"Only {free:.1f} GB are free at {self.path}; a run needs at least {least_gb:g} "
                "GB (workers.least_free_gb)."
            )

    def _created(self, config: RunConfig) -> Identity:
        self.check_space(config.workers.least_free_gb)  # a run that is refused leaves nothing
        identity = Identity(
            key=f"{_plain(config.name)}-{uuid.uuid4().hex[:8]}",
            config_digest=config_digest(config),
            begun=time.strftime("%F %T"),
        )
        robot = load_robot(config.model)
        self.robot_file.write_text(robot.xml)
        if (weights := initial_weights(config, robot)) is not None:
            shutil.copyfile(weights, self.path / INITIAL_WEIGHTS)
            shutil.copyfile(weights.with_suffix(".json"), self.path / SIDE_FILE)
        if config.robot is not None and config.robot.link == SIMULATED:
            write_stand_in(config.robot.stand_in, self.robot_folder)
        temporary = self.config_file.with_suffix(".tmp")
        temporary.write_text(yaml_of(config), encoding="utf-8")
        for law in config.effects_from:  # where the configuration of the folder looks for them
            (self.path / law.file).write_text(law.text, encoding="utf-8", newline="")
        digests = {
            self.config_file.name: file_sha256(temporary, "configuration"),
            self.robot_file.name: file_sha256(self.robot_file, "MJCF"),
            **{law.file: law.sha256 for law in config.effects_from},
            **{
                name: file_sha256(self.path / name, "weights")
                for name in (INITIAL_WEIGHTS, SIDE_FILE)
                if config.training.start_from
            },
        }
        write_identity(self.path, identity, digests)
        temporary.replace(self.config_file)  # last: with it, the run has begun
        return identity

    def _diagnosis(self, iteration: int) -> Path:
        return self.path / "iterations" / f"i{iteration:04d}-diagnosis"

    def result_file(self, iteration: int, arm: Arm) -> Path:
        """The result of an iteration, which is complete when this file is there."""
        return self.path / "iterations" / f"{name_of(iteration, arm)}.json"


def _plain(name: str) -> str:
    """A name reduced to the characters allowed in a run's key."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", file_name(name)).strip("-") or "run"


def name_of(iteration: int, arm: Arm) -> str:
    """The name of an iteration's snapshot, model and result, e.g. "i0001-mppi"."""
    return f"i{iteration:04d}-{arm}"
