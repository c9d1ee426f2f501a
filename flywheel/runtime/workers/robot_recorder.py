"""Records planned episodes on a robot behind a link, by what is measured alone."""

from __future__ import annotations

import numpy as np

from flywheel import __version__
from flywheel.control.drive import Drive, OnStep, drive, without_gaps
from flywheel.dynamics.plant import Reckoning
from flywheel.dynamics.protocol import Dynamics
from flywheel.records import Episode, Floats, Provenance
from flywheel.results import Walk
from flywheel.robot_link import RobotLink
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.runtime.workers.episode_recorder import controller_of
from flywheel.runtime.workers.walks import walk_of
from flywheel.tasks import Task, sample_task

RECORDING = "recording"


class RobotRecorder:
    """Records planned episodes on a robot.

    Args:
      config: of the run.
      robot: of its MJCF.
      dataset: index of the data set that a network takes the robot for; by default that of recordings, if the
        run has any.
    """

    def __init__(self, config: RunConfig, robot: Robot, dataset: int | None = None) -> None:
        self.config, self.robot, self._library = config, robot, config.library()
        recorded = config.robot is not None or bool(config.collect.recordings)
        # A network that was trained without recordings has no data set of theirs.
        usual = config.dataset_numbers()[RECORDING] if recorded else 0
        self._dataset = usual if dataset is None else dataset

    def record(
        self,
        link: RobotLink,
        plan: EpisodePlan,
        dynamics: Dynamics | None,
        model: str,
        on_step: OnStep | None = None,
    ) -> Drive:
        """Record an episode; however it ends, what was measured is in the result.

        Args:
          link: to the robot.
          plan: of the episode.
          dynamics: that MPPI plans with; None if nothing is planned.
          model: digest of its weights, or "".
          on_step: is told of every control step.

        Raises:
          LinkError: the robot is another one, or is lost before the first step.
          ModelError: the same of the controller.
        """
        config, dt = self.config, self.config.network.dt
        ahead = dynamics is not None and link.info.real_time
        terms = tuple(effect.term(self.robot, self._library) for effect in plan.effects)
        return drive(
            link,
            self.robot,
            controller_of(plan, self.config, self.robot, dynamics, model),
            lambda points: self.task(plan, points),
            seconds=plan.seconds,
            seed=plan.seed,
            episode_id=plan.id,
            provenance=self._provenance(plan, model),
            split=plan.split,
            lead=config.mppi.steps(dt)["replan_seconds"] if ahead else 0,
            reckoning=Reckoning(self.robot, dt, terms),
            dataset=self._dataset,
            on_step=on_step,
        )

    def task(self, plan: EpisodePlan, points: Floats) -> Task | None:
        """The task of a robot that stands at (P, 3) [m]; None for an episode without one."""
        if plan.task_seed is None:
            return None
        rng = np.random.default_rng(plan.task_seed)
        return sample_task(self.config.task.name, self.robot, points, rng, self.config.task)

    def walk(self, plan: EpisodePlan, episode: Episode) -> Walk | None:
        """The episode seen from above; None without a task."""
        points = episode.trajectory.observations.points
        task = self.task(plan, without_gaps(points[0]))
        if task is None:
            return None
        seen = points[np.isfinite(points).all(axis=(1, 2))]
        return walk_of(task, episode, seen, plan.seed)

    def _provenance(self, plan: EpisodePlan, model: str) -> Provenance:
        return Provenance(
            robot=self.robot.digest,
            source="recording",
            dataset=RECORDING,
            controller=plan.controller,
            model=model,
            task=self.config.task.name if plan.task_seed is not None else "",
            seed=plan.seed,
            iteration=plan.iteration,
            config=config_digest(self.config),
            code=__version__,
        )
