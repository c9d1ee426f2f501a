"""A run in progress: common objects of all stages, and the results of earlier iterations from the
run's files.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flywheel.data import Snapshot, TrajectoryStore
from flywheel.dynamics.residual import ResidualWeights
from flywheel.errors import LinkError, RunError
from flywheel.faults import fault_of, told
from flywheel.records import Split
from flywheel.results import Arm, Errors, IterationResult, RunResult
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.pool.jobs import Job, JobFailed, PoolReport
from flywheel.runtime.pool.pool import WorkerPool
from flywheel.runtime.pool.progress import Progress
from flywheel.runtime.run.folder import RunFolder, name_of
from flywheel.runtime.tracking.tracker import Tracker
from flywheel.runtime.workers.episode_note import EpisodeNote
from flywheel.runtime.workers.episode_plan import (
    Effects,
    EpisodePlan,
    evaluation,
    first_recordings,
    robot_drives,
)
from flywheel.runtime.workers.model_weights import read_weights

# Roughly how long a core is busy with one second of an episode [s]; for the remaining time that is shown.
SIMULATING, PLANNING = 0.02, 0.3


@dataclass(frozen=True)
class Model:
    """A trained model.

    Attributes:
      arm, iteration: of its training.
      digest: of the weights.
      path: of the weights' file.
    """

    arm: Arm
    iteration: int
    digest: str
    path: Path


@dataclass
class Run:
    """A run in progress.

    Attributes:
      config: resolved.
      folder: its files.
      robot: of the run.
      store: of its episodes.
      pool: of its workers.
      tracker: None if the run is not tracked.
      progress: display for people.
    """

    config: RunConfig
    folder: RunFolder
    robot: Robot
    store: TrajectoryStore
    pool: WorkerPool
    tracker: Tracker[RunResult] | None
    progress: Progress
    _shared: dict[str, Any] = field(default_factory=dict)

    def arms(self, iteration: int) -> list[Arm]:
        """Arms with their own results in an iteration; iteration 0 is common to both."""
        return ["mppi", "control"] if iteration and self.config.control_arm else ["mppi"]

    def arm_of(self, iteration: int, arm: Arm) -> Arm:
        """The arm on which an arm's iteration is based: in iteration 0 always "mppi"."""
        return arm if arm in self.arms(iteration) else "mppi"

    def finished(self, arm: Arm) -> list[IterationResult]:
        """The results of an arm so far, iteration 0 included."""
        iterations = range(self.config.iterations + 1)
        results = [self.folder.finished(i, self.arm_of(i, arm)) for i in iterations]
        return [result for result in results if result is not None]

    def latest(self, arm: Arm) -> IterationResult | None:
        """The iteration whose model an arm continues from; None before the first.

        It is the champion's iteration. The control arm has no gate and continues from its last
        usable model.
        """
        chosen = [r for r in self.finished(arm) if r.gate is None or r.gate.promoted]
        return next((r for r in reversed(chosen) if usable(r.validation)), None)

    def latest_model(self, arm: Arm) -> Model | None:
        """The model that an arm plans with and trains further; None before the first."""
        result = self.latest(arm)
        return None if result is None else self.model_of(result)

    def model_of(self, result: IterationResult) -> Model:
        """The model of an iteration."""
        path = self.folder.weights(result.iteration, result.arm)
        return Model(result.arm, result.iteration, result.model, path)

    def shared_weights(self, model: Model) -> Any:
        """A reference to the model's weights, for jobs. They are shared with all workers only once."""
        if model.digest not in self._shared:
            library = self.config.library()
            weights = read_weights(model.path, self.robot, model.digest, library)
            self._shared[model.digest] = self.pool.share(weights)
        return self._shared[model.digest]

    def residual(self, iteration: int) -> Model | None:
        """The residual model of an iteration; None without one."""
        path = self.folder.residual(iteration)
        if not path.exists():
            return None
        weights = ResidualWeights.read(path, self.robot, library=self.config.library())
        return Model("mppi", iteration, weights.digest, path)

    def show(self, result: RunResult) -> None:
        """Publish the result so far, if the run is tracked."""
        if self.tracker is not None:
            self.tracker.show(result)

    def snapshot(self, name: str) -> Snapshot | None:
        """A sealed snapshot, or None."""
        return self.store.snapshot(name) if name in self.store.snapshots() else None

    def effects(self, iteration: int) -> Effects:
        """The effects of an iteration's plant, beyond the MJCF."""
        return self._plant(iteration)[1]

    def _plant(self, iteration: int) -> tuple[int, Effects]:
        """The first iteration with the same plant as this one, and its effects."""
        for earlier in range(iteration, 0, -1):
            note = self.folder.diagnosis(earlier)
            if note is not None and note.adopted:
                return earlier, note.effects
        return 0, self.config.effects

    def test_episodes(self, iteration: int) -> list[str]:
        """Ids of the simulated test episodes on an iteration's plant.

        These are those of the first collection on the plant, and the closed-loop ones up to the
        iteration.
        """
        begun, _ = self._plant(iteration)
        first = self.store.snapshot(name_of(begun, "mppi"))
        turns = range(begun, iteration + 1)
        plans = [p.id for i in turns for p in evaluation(self.config, i, "mppi")]
        there = self.store.committed()
        own = [e.id for e in first.episodes if e.split == "test" and e.source == "sim"]
        return own + [p for p in plans if p in there]

    def robot_episodes(self, iteration: int) -> list[str]:
        """Ids of the planned episodes on the robot before an iteration's own drives."""
        if self.config.robot is None:
            return []
        plans = first_recordings(self.config)
        for earlier in range(iteration):
            for planner in self.config.robot.planners:
                plans += robot_drives(self.config, earlier, planner)
        there = self.store.committed()
        return [plan.id for plan in plans if plan.id in there]

    def recordings(self, split: Split, iteration: int) -> list[str]:
        """Ids of the recordings of a split: imported ones, and the robot's before an iteration's drives."""
        names = dict.fromkeys([*self.config.collect.recordings, *self.robot_episodes(iteration)])
        there = self.store.committed()
        summaries = (summary for name in names for summary in there[name].summaries)
        return [summary.id for summary in summaries if summary.split == split]

    def robot_minutes(self, iteration: int) -> float:
        """Minutes recorded on the robot before an iteration's own drives."""
        there, dt = self.store.committed(), self.config.network.dt
        names = self.robot_episodes(iteration)
        return sum(s.steps for name in names for s in there[name].summaries) * dt / 60

    def do(self, jobs: Sequence[Job], title: str) -> PoolReport:
        """Run jobs on the pool.

        Raises:
          RunError: the operating system reported an error, e.g. because the disk is full.
          JobFailed: a job raised an error.
        """
        if not jobs:
            return PoolReport()
        try:
            return self.pool.run(jobs, progress=self.progress, title=title)
        except JobFailed as error:
            cause = error.__cause__
            if isinstance(cause, OSError) and fault_of(cause):
                raise RunError(told(cause)) from error
            if isinstance(cause, LinkError | RunError):  # the robot is lost, or cannot be reached
                raise RunError(str(cause)) from error
            raise

    def episode_jobs(self, plans: Sequence[EpisodePlan], model: Model | None = None) -> list[Job]:
        """Jobs that record episodes. An episode that is already in the store is only reported.

        Args:
          plans: of the episodes.
          model: for MPPI.

        Raises:
          RunError: MPPI plans an episode, and there is no model.
        """
        return [
            Job(
                plan.id,
                "sim",
                "record",
                (plan, self._planner(model)) if plan.controller == "mppi" else (plan,),
                size=plan.seconds * (SIMULATING if plan.task_seed is None else PLANNING),
            )
            for plan in plans
        ]

    def robot_jobs(self, plans: Sequence[EpisodePlan], model: Model | None = None) -> list[Job]:
        """Jobs that record episodes on the robot; episodes already in the store are only reported.

        Args:
          plans: of the episodes.
          model: for MPPI; None for the plant with the effects of each plan.
        """
        weights = () if model is None else (self.shared_weights(model),)
        size = SIMULATING if plans and plans[0].task_seed is None else PLANNING
        return [
            Job(plan.id, "robot", "record", (plan, *weights), size=plan.seconds * size)
            for plan in plans
        ]

    def _planner(self, model: Model | None) -> Any:
        """Shared weights of the model for MPPI."""
        if model is None:
            raise RunError("MPPI cannot collect: there is no model yet.")
        return self.shared_weights(model)


def usable(errors: Errors | None) -> bool:
    """True if there are errors and they are finite."""
    return errors is not None and math.isfinite(errors.short.e_pos_rmse)


def episode_notes(report: PoolReport, plans: Sequence[EpisodePlan]) -> list[EpisodeNote]:
    """The reports about planned episodes, in the order of the plans, without those set aside."""
    return [report.results[plan.id] for plan in plans if plan.id in report.results]
