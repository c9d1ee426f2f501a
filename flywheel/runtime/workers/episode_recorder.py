"""Records planned episodes, on a plant (`EpisodeRecorder`) or on a robot behind a link (`RobotRecorder`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flywheel import __version__
from flywheel.control import (
    AStar,
    Controller,
    EpisodeOrder,
    Hold,
    Mppi,
    RandomControls,
    above_ground,
    by_a_box,
    perturbed,
    random_drop,
    record_episode,
    standing,
    thrown,
)
from flywheel.control.drive import Drive, drive, without_gaps
from flywheel.control.gaits import Gait
from flywheel.control.protocol import OnPiece, Piece
from flywheel.dynamics.plant import Plant, PlantDynamics, Reckoning, refined, with_effects
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import Terms
from flywheel.errors import DataError
from flywheel.records import RECORDING, Episode, Floats, Provenance, State
from flywheel.results import Walk
from flywheel.robot_link import RobotLink
from flywheel.robots import Robot, draw_terrain, load_course
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.workers.episode_plan import ASTAR, ORACLE, Effects, EpisodePlan
from flywheel.tasks import Task, TaskConfig, sample_task
from flywheel.terrain import Terrain, is_level, with_boxes

SETTLE_SECONDS = 2.0
WALK_SECONDS = 0.5  # between two points of a path [s]
GROUND, PLACE = 1, 2  # added to a seed, so that ground and place have random numbers of their own
OnProgress = Callable[[float], None]


def _nobody(done: float) -> None:
    """Ignore the progress."""


class _Recorder:
    """Base of the recorders.

    Args:
      config: of the run.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, robot: Robot) -> None:
        self.config, self.robot = config, robot
        self.digest = config_digest(config)
        self.library = config.library()

    def terms(self, effects: Effects) -> Terms:
        """Effects on the robot."""
        return tuple(effect.term(self.robot, self.library) for effect in effects)

    def task_config(self, plan: EpisodePlan) -> TaskConfig:
        """The settings of the task of a planned episode."""
        task = self.config.task
        if not plan.course:
            return task
        return task.model_copy(update={"name": "obstacle_course", "course": plan.course})

    def task_from(self, plan: EpisodePlan, points: Floats) -> Task | None:
        """The task of a robot that stands at (P, 3) [m]; None for an episode without one."""
        if plan.task_seed is None:
            return None
        rng, task = np.random.default_rng(plan.task_seed), self.task_config(plan)
        return sample_task(task.name, self.robot, points, rng, task)

    def walk_along(
        self, plan: EpisodePlan, task: Task | None, episode: Episode, points: Floats
    ) -> Walk | None:
        """An episode seen from above; None without a task.

        Args:
          plan, task: of the episode.
          episode: already recorded.
          points: (n, P, 3) tracked points over its time, without gaps [m].
        """
        outcome = episode.outcome
        if task is None or outcome is None:
            return None
        centre = task.place(points[:: max(1, round(WALK_SECONDS / episode.trajectory.dt))])
        return Walk(
            path=tuple((float(x), float(y)) for x, y in np.round(centre, 4)),
            goal=(float(task.last_goal[0]), float(task.last_goal[1])),
            reached=outcome.success,
            seconds=outcome.seconds,
            distance=outcome.distance,
            seed=plan.seed,
            obstacles=task.obstacles,
        )

    def controller(self, plan: EpisodePlan, dynamics: Dynamics | None, model: str) -> Controller:
        """Controller of a planned episode.

        Args:
          plan: of the episode.
          dynamics: for MPPI, and the plant for A*; None without planning.
          model: digest of its weights, or "".
        """
        kind, _, gait = plan.controller.partition(":")
        dt = self.config.network.dt
        if kind == "gait":
            return Gait(self.robot, gait, dt, variation=self.config.collect.gait_variation)
        if kind == "random":
            return RandomControls(self.robot, dt)
        if kind in ("drop", "throw"):
            return Hold(self.robot, dt)
        if kind == ASTAR:
            assert isinstance(dynamics, PlantDynamics), "gaits are measured on a plant"
            return AStar(dynamics, plan.controller)
        assert dynamics is not None, "MPPI plans with a model"
        search = self.config.mppi
        if plan.samples is not None:
            search = search.model_copy(update={"samples": plan.samples})
        return Mppi(dynamics, search, plan.controller, model)

    def check_own(self, episode: Episode) -> None:
        """Reject an episode of the same name from another run.

        Raises:
          DataError: its configuration is not this run's.
        """
        if episode.provenance.config != self.digest:
            raise DataError(
                f"The store has an episode {episode.id} of another run (configuration "
                f"{episode.provenance.config[:12] or 'unknown'}, this one's is "
                f"{self.digest[:12]}). Give this run its own store; recordings can be imported "
                "into that, too."
            )

    def provenance(self, plan: EpisodePlan, model: str, **more: Any) -> Provenance:
        """The provenance of a planned episode, with `more` about its plant or robot."""
        return Provenance(
            robot=self.robot.digest,
            controller=plan.controller,
            model=model,
            task=self.task_config(plan).name if plan.task_seed is not None else "",
            seed=plan.seed,
            iteration=plan.iteration,
            config=self.digest,
            code=__version__,
            **more,
        )

    def order(self, plan: EpisodePlan, model: str, **more: Any) -> EpisodeOrder:
        """The order of a planned episode; arguments as of `provenance`."""
        about = self.provenance(plan, model, **more)
        return EpisodeOrder(plan.id, about, plan.seconds, plan.seed, plan.split)


class EpisodeRecorder(_Recorder):
    """Records planned episodes on a plant; the same plan and weights give the same episode on any worker.

    Args:
      config: of the run.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, robot: Robot) -> None:
        super().__init__(config, robot)
        self._settled: dict[tuple[int, Effects], State] = {}

    def terrain(self, plan: EpisodePlan) -> Terrain | None:
        """The ground of a planned episode; each task has its own, so that all models meet the same."""
        seed = plan.seed if plan.task_seed is None else plan.task_seed
        rng = np.random.default_rng([seed, GROUND])
        drawn = draw_terrain(self.config.terrain, self.robot.length, rng)
        if plan.task_seed is None and plan.course:
            return with_boxes(drawn, load_course(plan.course).obstacles)
        return drawn  # the boxes of a task are its obstacles

    def plant(
        self,
        dataset: int,
        effects: Effects = (),
        task: Task | None = None,
        terrain: Terrain | None = None,
        fineness: int = 1,
        threads: int | None = None,
    ) -> Plant:
        """The plant of a data set.

        Args:
          dataset: index of the data set.
          effects: to add to the plant.
          task: whose obstacles are added.
          terrain: ground; None for a level one.
          fineness: ratio of the MJCF's time step to the plant's.
          threads: of the plant; None for `sim_threads`. They do not affect results.
        """
        plant = Plant(
            self.robot,
            self.config.network.dt,
            parameters=self.config.datasets[dataset].plant,
            threads=threads or self.config.sim_threads,
            terrain=terrain if task is None else with_boxes(terrain, task.obstacles),
        )
        return with_effects(refined(plant, fineness), self.terms(effects))

    def task(self, plan: EpisodePlan) -> Task | None:
        """The task of a planned episode; None without one."""
        if plan.task_seed is None:
            return None
        settled = self._settled_state(0, plan.effects)
        return self.task_from(plan, self.plant(0, plan.effects).observe(settled).points[0])

    def record(
        self,
        plan: EpisodePlan,
        dynamics: Dynamics | None,
        model: str,
        progress: OnProgress = _nobody,
        on_piece: OnPiece | None = None,
    ) -> Episode:
        """Record an episode.

        Args:
          plan: of the episode.
          dynamics: for MPPI; None without planning.
          model: digest of its weights, or "".
          progress: receives the completed fraction.
          on_piece: called with every piece of the episode.

        Raises:
          ModelError: the plant diverged, or the model did.
        """
        task, data = self.task(plan), self.config.datasets[plan.dataset]
        plant = self.plant(
            plan.dataset, plan.plant_effects, task, self.terrain(plan), plan.fineness
        )
        if plan.controller in (ORACLE, ASTAR):
            dynamics = PlantDynamics(plant)

        def told(piece: Piece) -> None:
            progress(min(1.0, piece.done * plant.dt / plan.seconds))
            if on_piece is not None:
                on_piece(piece)

        return record_episode(
            plant,
            self.config.measurement,
            self.controller(plan, dynamics, model),
            task,
            self.order(
                plan,
                model,
                dataset=data.name,
                plant=data.plant.changed(),
                effects={effect.label: effect.parameters for effect in plan.plant_effects},
            ),
            start=self._start(plan, plant, task),
            reckoning=Reckoning(
                self.robot, plant.dt, self.terms(plan.effects), data.plant.winch_speed
            ),
            on_piece=told,
        )

    def walk(self, plan: EpisodePlan, episode: Episode) -> Walk | None:
        """The episode seen from above; None without a task."""
        task, trajectory = self.task(plan), episode.trajectory
        points = trajectory.observations.points
        if task is not None and trajectory.states is not None:  # as it was, not as it was measured
            points = self.plant(0, plan.plant_effects).observe(trajectory.states).points
        return self.walk_along(plan, task, episode, points)

    def _start(self, plan: EpisodePlan, plant: Plant, task: Task | None) -> State:
        kind, _, _ = plan.controller.partition(":")
        rng, by_box = np.random.default_rng(plan.seed), task is None and bool(plan.course)
        if kind == "throw":
            return thrown(plant, rng, 1)
        if plan.perturbed:
            state = perturbed(plant, rng, 1)
        elif kind in ("drop", "gait"):
            state = random_drop(plant, rng, 1)
        else:
            state = self._settled_state(plan.dataset, plan.plant_effects)
            if task is not None and task.begin is not None:
                state = standing(plant, state, task.begin.place, task.begin.turn)
            state = above_ground(plant, state)
        if by_box:
            state = by_a_box(plant, state, np.random.default_rng([plan.seed, PLACE]))
        at_rest = kind != "gait" and not by_box and is_level(plant.terrain)
        if kind == "drop" or at_rest:
            return state
        return plant.settle(SETTLE_SECONDS, start=state)

    def _settled_state(self, dataset: int, effects: Effects) -> State:
        key = (dataset, effects)
        if key not in self._settled:
            self._settled[key] = self.plant(dataset, effects).settle(SETTLE_SECONDS)
        return self._settled[key]


class RobotRecorder(_Recorder):
    """Records planned episodes on a robot, based on measurements alone.

    Args:
      config: of the run.
      robot: of its MJCF.
      dataset: index of the data set assumed by a network; by default that of recordings, if the run
        has any.
    """

    def __init__(self, config: RunConfig, robot: Robot, dataset: int | None = None) -> None:
        super().__init__(config, robot)
        self._dataset = config.recording_number if dataset is None else dataset

    def record(
        self,
        link: RobotLink,
        plan: EpisodePlan,
        dynamics: Dynamics | None,
        model: str,
        progress: OnProgress = _nobody,
    ) -> Drive:
        """Record an episode; however it ends, the measurements are in the result.

        Args:
          link: to the robot.
          plan: of the episode.
          dynamics: for MPPI; None without planning.
          model: digest of its weights, or "".
          progress: receives the completed fraction.

        Raises:
          LinkError: the robot is another one, or is lost before the first step.
          ModelError: likewise for the controller.
        """
        config, dt = self.config, self.config.network.dt
        ahead = dynamics is not None and link.info.real_time
        steps = max(1, round(plan.seconds / dt))
        return drive(
            link,
            self.robot,
            self.controller(plan, dynamics, model),
            lambda points: self.task_from(plan, points),
            self.order(plan, model, source=RECORDING, dataset=RECORDING),
            lead=config.mppi.steps(dt)["replan_seconds"] if ahead else 0,
            reckoning=Reckoning(self.robot, dt, self.terms(plan.effects)),
            dataset=self._dataset,
            on_step=lambda done, sample: progress(min(1.0, done / steps)),
        )

    def task(self, plan: EpisodePlan, episode: Episode) -> Task | None:
        """The task of a recorded episode; None without one."""
        return self.task_from(plan, without_gaps(episode.trajectory.observations.points[0]))

    def walk(self, plan: EpisodePlan, episode: Episode) -> Walk | None:
        """The episode seen from above; None without a task."""
        points = episode.trajectory.observations.points
        seen = points[np.isfinite(points).all(axis=(1, 2))]
        return self.walk_along(plan, self.task(plan, episode), episode, seen)
