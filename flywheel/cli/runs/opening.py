"""Opening a run's folder: its configuration, its store, its models."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from flywheel.data import TrajectoryStore
from flywheel.errors import DataError, UnknownNameError
from flywheel.files import shown
from flywheel.results import IterationResult, RunResult
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.run.folder import RunFolder, name_of
from flywheel.runtime.workers.model_weights import Weights


@dataclass(frozen=True)
class OpenRun:
    """An opened run, finished or not.

    Attributes:
      folder: its files.
      config: at its start.
      result: so far.
    """

    folder: RunFolder
    config: RunConfig
    result: RunResult

    @property
    def robot(self) -> Robot:
        """The robot of the run."""
        return self.folder.robot(self.config)

    @property
    def store(self) -> TrajectoryStore:
        """The store of its episodes."""
        return TrajectoryStore(self.folder.store_url(self.config))

    def champion(self) -> IterationResult:
        """The iteration whose model was last promoted.

        Raises:
          DataError: none was yet.
        """
        promoted = [i for i in self.result.iterations if i.gate is not None and i.gate.promoted]
        if not promoted:
            raise DataError(f"The run in {self.folder.path} has no champion yet.")
        return promoted[-1]

    def weights(self, iteration: IterationResult) -> Weights:
        """The weights of an iteration.

        Raises:
          ModelError: they are missing or damaged, or those of another iteration.
        """
        path = self.folder.weights(iteration.iteration, iteration.arm)
        return Weights.read(path, self.robot, iteration.model)

    def iteration(self, name: str) -> IterationResult:
        """An iteration by its number ("2": MPPI's arm) or name ("i0002-control")."""
        known = {name_of(i.iteration, i.arm): i for i in self.result.iterations}
        wanted = name_of(int(name), "mppi") if re.fullmatch("[0-9]{1,4}", name) else name
        if wanted in known:
            return known[wanted]
        raise UnknownNameError(
            f"The run in {self.folder.path} has no model {shown(name)}. It has: {', '.join(known)}."
        )


def open_run(path: Path) -> OpenRun:
    """Open a run's folder for reading.

    Raises:
      DataError: it is not one, has no results yet, or was changed.
      ConfigError: its configuration cannot be read.
    """
    folder = RunFolder(path)
    if not folder.config_file.exists():
        known = ", ".join(str(p) for p in known_runs()) or "none in runs/"
        raise DataError(f"{path} is not a run's folder: it has no config.yaml. Runs: {known}.")
    return OpenRun(folder, folder.config(), RunResult.load(path))


def known_runs(parent: Path = Path("runs")) -> list[Path]:
    """The folders below `parent` that hold a run."""
    return sorted(p.parent for p in parent.glob("*/config.yaml"))
