"""Records planned episodes, on a plant (`EpisodeRecorder`) or on a robot behind a link (`RobotRecorder`)."""

from __future__ import annotations

import numpy as np

from flywheel import __version__
from flywheel.control import (
    Controller,
    Hold,
    Mppi,
    RandomControls,
    above_ground,
    random_drop,
    record_episode,
    standing,
)
from flywheel.control.drive import Drive, OnStep, drive, without_gaps
from flywheel.control.gaits import Gait
from flywheel.control.protocol import OnPiece, Piece
from flywheel.dynamics.plant import Plant, PlantDynamics, Reckoning, refined, with_effects
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import Terms
from flywheel.errors import DataError
from flywheel.records import Episode, Floats, Provenance, State
from flywheel.results import Walk
from flywheel.robot_link import RobotLink
from flywheel.robots import Robot, draw_terrain
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.pool.heartbeat import Heartbeat
from flywheel.runtime.workers.episode_plan import ORACLE, Effects, EpisodePlan
from flywheel.runtime.workers.walks import walk_of
from flywheel.tasks import Task, TaskConfig, sample_task
from flywheel.terrain import Terrain

SETTLE_SECONDS = 2.0
RECORDING = "recording"  # source and data set of what a robot measured
GROUND = 1  # added to a seed, so that the ground has random numbers of its own


def controller_of(
    plan: EpisodePlan, config: RunConfig, robot: Robot, dynamics: Dynamics | None, model: str
) -> Controller:
    """Controller of a planned episode, on a plant or on a robot.

    Args:
      plan: of the episode.
      config: of the run.
      robot: of the run.
      dynamics: for MPPI; None without planning.
      model: digest of its weights, or "".
    """
    kind, _, gait = plan.controller.partition(":")
    dt = config.network.dt
    if kind == "gait":
        return Gait(robot, gait, dt, variation=config.collect.gait_variation)
    if kind == "random":
        return RandomControls(robot, dt)
    if kind == "drop":
        return Hold(robot, dt)
    assert dynamics is not None, "MPPI plans with a model"
    search = config.mppi
    if plan.samples is not None:
        search = search.model_copy(update={"samples": plan.samples})
    return Mppi(dynamics, search, plan.controller, model)


class EpisodeRecorder:
    """Records planned episodes on a plant; the same plan and weights give the same episode on any worker.

    Args:
      config: of the run.
      robot: of the run.
    """

    def __init__(self, config: RunConfig, robot: Robot) -> None:
        self.config, self.robot = config, robot
        self._digest = config_digest(config)
        self.library = config.library()
        self._settled: dict[tuple[int, Effects], State] = {}

    def terrain(self, plan: EpisodePlan) -> Terrain | None:
        """The ground of a planned episode; each task has its own, so that all models meet the same."""
        seed = plan.seed if plan.task_seed is None else plan.task_seed
        rng = np.random.default_rng([seed, GROUND])
        return draw_terrain(self.config.terrain, self.robot.length, rng)

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
            obstacles=() if task is None else task.obstacles,
            threads=threads or self.config.sim_threads,
            terrain=terrain,
        )
        return with_effects(refined(plant, fineness), self._terms(effects))

    def task(self, plan: EpisodePlan) -> Task | None:
        """The task of a planned episode; None without one."""
        if plan.task_seed is None:
            return None
        settled = self._settled_state(0, plan.effects)
        points = self.plant(0, plan.effects).observe(settled).points[0]
        rng = np.random.default_rng(plan.task_seed)
        task = self._task_config(plan)
        return sample_task(task.name, self.robot, points, rng, task)

    def _task_config(self, plan: EpisodePlan) -> TaskConfig:
        task = self.config.task
        if not plan.course:
            return task
        return task.model_copy(update={"name": "obstacle_course", "course": plan.course})

    def record(
        self,
        plan: EpisodePlan,
        dynamics: Dynamics | None,
        model: str,
        heartbeat: Heartbeat,
        on_piece: OnPiece | None = None,
    ) -> Episode:
        """Record an episode.

        Args:
          plan: of the episode.
          dynamics: for MPPI; None without planning.
          model: digest of its weights, or "".
          heartbeat: receives the progress.
          on_piece: called with every piece of the episode.

        Raises:
          ModelError: the plant diverged, or the model did.
        """
        task = self.task(plan)
        plant = self.plant(
            plan.dataset, plan.plant_effects, task, self.terrain(plan), plan.fineness
        )
        if plan.controller == ORACLE:
            dynamics = PlantDynamics(plant)

        def told(piece: Piece) -> None:
            heartbeat.progress(min(1.0, piece.done * plant.dt / plan.seconds))
            if on_piece is not None:
                on_piece(piece)

        return record_episode(
            plant,
            self.config.measurement,
            controller_of(plan, self.config, self.robot, dynamics, model),
            task,
            start=self._start(plan, plant, task),
            seconds=plan.seconds,
            seed=plan.seed,
            episode_id=plan.id,
            provenance=self._provenance(plan, model),
            split=plan.split,
            reckoning=Reckoning(
                self.robot,
                plant.dt,
                self._terms(plan.effects),
                self.config.datasets[plan.dataset].plant.winch_speed,
            ),
            on_piece=told,
        )

    def check_own(self, episode: Episode) -> None:
        """Reject an episode of the same name from another run.

        Raises:
          DataError: its configuration is not this run's.
        """
        if episode.provenance.config != self._digest:
            raise DataError(
                f"The store has an episode {episode.id} of another run (configuration "
                f"{episode.provenance.config[:12] or 'unknown'}, this one's is "
                f"{self._digest[:12]}). Give this run its own store; recordings can be imported "
                "into that, too."
            )

    def walk(self, plan: EpisodePlan, episode: Episode) -> Walk | None:
        """The episode seen from above; None without a task."""
        task = self.task(plan)
        if task is None or episode.outcome is None:
            return None
        trajectory = episode.trajectory
        points = trajectory.observations.points
        if trajectory.states is not None:  # as it was, not as it was measured
            points = self.plant(0, plan.plant_effects).observe(trajectory.states).points
        return walk_of(task, episode, points, plan.seed)

    def _terms(self, effects: Effects) -> Terms:
        return tuple(effect.term(self.robot, self.library) for effect in effects)

    def _start(self, plan: EpisodePlan, plant: Plant, task: Task | None) -> State:
        kind, _, _ = plan.controller.partition(":")
        if kind in ("drop", "gait"):
            dropped = random_drop(plant, np.random.default_rng(plan.seed), 1)
            return dropped if kind == "drop" else plant.settle(SETTLE_SECONDS, start=dropped)
        state = self._settled_state(plan.dataset, plan.plant_effects)
        if task is not None and task.begin is not None:
            state = standing(plant, state, task.begin.place, task.begin.turn)
        if plant.terrain is None:
            return state
        return plant.settle(SETTLE_SECONDS, start=above_ground(plant, state))

    def _settled_state(self, dataset: int, effects: Effects) -> State:
        key = (dataset, effects)
        if key not in self._settled:
            self._settled[key] = self.plant(dataset, effects).settle(SETTLE_SECONDS)
        return self._settled[key]

    def _provenance(self, plan: EpisodePlan, model: str) -> Provenance:
        data = self.config.datasets[plan.dataset]
        return Provenance(
            robot=self.robot.digest,
            dataset=data.name,
            controller=plan.controller,
            model=model,
            task=self._task_config(plan).name if plan.task_seed is not None else "",
            seed=plan.seed,
            iteration=plan.iteration,
            config=self._digest,
            code=__version__,
            plant=data.plant.changed(),
            effects={effect.label: effect.parameters for effect in plan.plant_effects},
        )


class RobotRecorder:
    """Records planned episodes on a robot, based on measurements alone.

    Args:
      config: of the run.
      robot: of its MJCF.
      dataset: index of the data set assumed by a network; by default that of recordings, if the run
        has any.
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
        """Record an episode; however it ends, the measurements are in the result.

        Args:
          link: to the robot.
          plan: of the episode.
          dynamics: for MPPI; None without planning.
          model: digest of its weights, or "".
          on_step: called at every control step.

        Raises:
          LinkError: the robot is another one, or is lost before the first step.
          ModelError: likewise for the controller.
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
