"""The worker that trains: a plain class that a test can call without a cluster."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.dynamics.plant import RestartedPlant
from flywheel.dynamics.residual import ResidualWeights
from flywheel.errors import DataError, ModelError
from flywheel.records import Split
from flywheel.results import TrainingPoint
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.heartbeat import Worker
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.workers.episode_plan import Effects
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.stored_episodes import EpisodeWinches
from flywheel.training import Trainer, TrainingConfig, TrainingProgress
from flywheel.training.residual import train_residual

SPLITS: tuple[Split, ...] = ("train", "validation")


@dataclass(frozen=True)
class TrainingOrder:
    """One training.

    Attributes:
      snapshot: name of the data.
      folder: for checkpoints and weights.
      cache: folder for the training windows.
      initial: file of the initial weights, or None.
      seed: of the training.
      effects: adopted so far.
    """

    snapshot: str
    folder: Path
    cache: Path
    initial: Path | None
    seed: int
    effects: Effects = ()

    def recipe(self, usual: TrainingConfig) -> TrainingConfig:
        """The usual recipe with this seed; without symmetries if an effect is at a single place."""
        alike = usual.symmetries and not any(effect.location for effect in self.effects)
        return usual.model_copy(update={"seed": self.seed, "symmetries": alike})


@dataclass(frozen=True)
class TrainingNote:
    """The report to the driver about a training.

    Attributes:
      weights: file of the trained weights.
      digest: of the weights.
      curve: of the training.
      problem: reason for missing weights, or "".
    """

    weights: Path = Path()
    digest: str = ""
    curve: tuple[TrainingPoint, ...] = ()
    problem: str = ""


@dataclass(frozen=True)
class ResidualOrder:
    """One training of a residual model.

    Attributes:
      recordings: ids of the robot's training recordings.
      path: for the weights.
      seed: of the training.
      effects: of the corrected plant.
    """

    recordings: tuple[str, ...]
    path: Path
    seed: int
    effects: Effects = ()


class TrainerWorker(Worker):
    """Trains models.

    Args:
      config: of the run.
      store: URL of the trajectory store.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, store: str, robot: Robot) -> None:
        super().__init__()
        self._config, self._robot = config, robot
        self._store = TrajectoryStore(store)

    def train(self, order: TrainingOrder) -> TrainingNote:
        """Train from the last checkpoint in the order's folder, or from the beginning.

        A diverged training has no weights; its note says why.
        """
        self._heartbeat.start("reading the snapshot")
        # A trainer whose driver was killed lives on for some seconds.
        with hold(order.folder / "trainer.lock", f"The model in {order.folder}", 60.0):
            snapshot = self._store.snapshot(order.snapshot)
            winches = EpisodeWinches(self._robot, order.effects, self._config.library())
            train, validation = (
                WindowCache.build(
                    SplitSource(
                        self._store, snapshot, split, self._robot, winches, winches.effects_digest
                    ),
                    order.cache,
                )
                for split in SPLITS
            )
            trainer = Trainer(
                order.recipe(self._config.training),
                self._config.network,
                self._robot,
                train,
                validation,
                order.folder,
                order.initial,
            )
            try:
                result = trainer.run(self._progress)
            except ModelError as error:
                return TrainingNote(problem=str(error))
        points = tuple(
            TrainingPoint(
                step=p.step,
                loss=p.loss,
                learning_rate=p.learning_rate,
                validation_e_pos_rmse=p.e_pos_rmse,
                validation_e_rot=p.e_rot,
            )
            for p in result.curve
        )
        return TrainingNote(result.weights, result.digest, points)

    def train_residual(self, order: ResidualOrder) -> str:
        """Train a residual model, unless its weights exist.

        Returns:
          Reason for a missing model, or "".
        """
        self._heartbeat.start("reading the recordings")
        with hold(order.path.parent / "trainer.lock", f"The model in {order.path.parent}", 60.0):
            if order.path.exists():
                return ""
            config = self._config.residual
            simulated = EpisodeRecorder(self._config, self._robot).plant(0, order.effects)
            tracks = [self._store.read(name).trajectory for name in order.recordings]
            training = config.training.model_copy(update={"seed": order.seed})
            plant = RestartedPlant.from_measurements(simulated)
            try:
                found = train_residual(
                    plant, tracks, config.network, training, self._heartbeat.progress
                )
            except (DataError, ModelError) as error:
                return f"There is no residual model: {error}"
            ResidualWeights.of(found.model).write(order.path, found.notes())
        return ""

    def _progress(self, now: TrainingProgress) -> None:
        words = (
            f"step {now.point.step} of {now.steps} ({now.steps_per_second:.1f}/s), "
            f"loss {now.point.loss:.3g}"
        )
        self._heartbeat.progress(now.point.step / now.steps, words)
