"""Drives one episode after the other: `PlantDriver` for `flywheel navigate`, `RobotDriver` for `drive`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.cli.driving.drives import DriveLine, Setting
from flywheel.cli.driving.hidden_effects import hidden_effects
from flywheel.cli.options import CHAMPION
from flywheel.cli.runs.opening import open_run
from flywheel.control.drive import Drive, without_gaps
from flywheel.control.protocol import OnPiece, Piece
from flywheel.dynamics.gnn.shipped import SHIPPED, shipped_weights
from flywheel.dynamics.plant import LiveView, RestartedPlant
from flywheel.dynamics.plant.render import render_episode
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import EFFECTS, WrittenTerm
from flywheel.errors import ConfigError
from flywheel.records import Episode, Floats
from flywheel.results import RESULT_FILE, Walk
from flywheel.robot_link import RobotLink, Sample, StandInConfig, TranscribedLink
from flywheel.robot_link.opening import SIMULATED, open_link
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import (
    RunConfig,
    config_digest,
    load_config,
    load_stored_config,
)
from flywheel.runtime.pool.heartbeat import Heartbeat
from flywheel.runtime.pool.progress import Stage
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.stages.video import scenery_of
from flywheel.runtime.workers.episode_plan import ORACLE, Effects, EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder, RobotRecorder
from flywheel.runtime.workers.model_weights import TrainedModel, Weights, dynamics_of
from flywheel.tasks import Task

PLANT, RESIDUAL = "plant", "residual"


class PlantDriver:
    """Drives episodes on a simulated plant.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", "oracle", "shipped", or an iteration of the run.
      hidden: true effects of the plant instead of the known ones, see `hidden_effects`; it is then
        simulated in shorter steps, too.

    Raises:
      ConfigError: these settings cannot be driven.
    """

    def __init__(
        self,
        source: Path,
        overrides: tuple[str, ...] = (),
        model: str = CHAMPION,
        hidden: tuple[str, ...] = (),
    ) -> None:
        self.model = model
        # Nothing else runs beside it: all cores plan.
        threads = f"sim_threads={len(os.sched_getaffinity(0))}"
        self.config = config_of(source, [threads, *overrides])
        self.recorder = EpisodeRecorder(self.config, RunFolder(source).robot(self.config))
        self._dynamics, self._digest = network_of(source, self.config, self.recorder.robot, model)
        self._known = known_effects(source, self.config, overrides)
        robot = self.recorder.robot
        self._hidden = (
            hidden_effects(hidden, robot, self.config.library(EFFECTS)) if hidden else None
        )

    @property
    def setting(self) -> Setting:
        """Setting of the drives."""
        config = self.config
        return Setting(
            robot=self.recorder.robot.name,
            task=config.task.name,
            course=config.task.course if config.task.name == "obstacle_course" else "",
            terrain=config.terrain.kinds,
            model=self.model,
            digest=self._digest,
            effects=tuple(effect.label for effect in self._known),
            hidden=tuple(_written(effect) for effect in self._hidden or ()),
            fineness=self.plan(0).fineness,
            samples=config.mppi.samples,
            horizon_seconds=config.mppi.horizon_seconds,
            threads=config.sim_threads,
            config=config_digest(config),
        )

    def plan(self, seed: int) -> EpisodePlan:
        """The plan of one episode."""
        return EpisodePlan(
            id=f"navigate-{self.model}-{seed}",
            controller=ORACLE if self.model == ORACLE else "mppi",
            iteration=-1,
            split="test",
            dataset=0,
            seconds=self.config.task.seconds,
            seed=seed,
            task_seed=seed,
            effects=self._known,
            hidden=self._hidden,
        )

    def drive(self, seed: int, stage: Stage, show: bool = False) -> tuple[DriveLine, Episode]:
        """Record one episode.

        Args:
          seed: of task and planner.
          stage: display of its progress.
          show: display the episode during its recording.
        """
        plan, begun = self.plan(seed), time.process_time()
        with self._shown(plan, show) as on_piece:
            watch = _ShownHeartbeat(stage)
            episode = self.recorder.record(plan, self._dynamics, self._digest, watch, on_piece)
        took = time.process_time() - begun
        walk, task = self.recorder.walk(plan, episode), self.recorder.task(plan)
        assert walk is not None and task is not None, "an episode with a task has both"
        plans = episode.telemetry["plan_seconds"]
        return _line(self.setting, seed, walk, task, plans, took), episode

    def film(self, seed: int, episode: Episode, path: Path) -> Path:
        """Make the video of an episode."""
        task, states = self.recorder.task(self.plan(seed)), episode.trajectory.states
        assert task is not None and states is not None, "a planned episode on a plant has both"
        scenery = scenery_of(task, episode.terrain)
        return render_episode(self.recorder.robot, states, path, scenery, plans=episode.plans)

    @contextmanager
    def _shown(self, plan: EpisodePlan, wanted: bool) -> Iterator[OnPiece | None]:
        """Shows the pieces of an episode, if requested."""
        if not wanted:
            yield None
            return
        task = self.recorder.task(plan)
        assert task is not None, "a driven episode has a task"
        scenery = scenery_of(task, self.recorder.terrain(plan))
        with closing(LiveView(self.recorder.robot, scenery)) as view:

            def show(piece: Piece) -> None:
                assert piece.simulated.states is not None
                states = piece.simulated.states[0, 1:]
                view.show(states, piece.simulated.dt, piece.command.diagnostics.get("paths"))

            yield show


class RobotDriver:
    """Drives a robot with MPPI.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", an iteration of the run, "plant" (the MJCF with the known effects),
        "residual" (that plant with the correcting network), "shipped", or a file of weights.
      where: address of the robot, see `open_link`.
      stand_in: its physics and sensors, if it is simulated.
      arguments: of a user's link.

    Raises:
      ConfigError: these settings cannot be driven.
      LinkError: the robot does not answer, or is another one.
    """

    def __init__(
        self,
        source: Path,
        overrides: tuple[str, ...],
        model: str,
        where: str,
        stand_in: StandInConfig,
        arguments: Mapping[str, Any],
    ) -> None:
        threads = f"sim_threads={len(os.sched_getaffinity(0))}"  # nothing else runs beside it
        self.config, self.model, self.where = config_of(source, [threads, *overrides]), model, where
        self._stand_in = stand_in if where == SIMULATED else None
        if where == SIMULATED and self.config.task.name != "reach":
            raise ConfigError(
                "A stand-in has no obstacles around it: task.name must be reach, got "
                f"{self.config.task.name}."
            )
        self.robot = RunFolder(source).robot(self.config)
        # A shipped network knows no recordings; the plant of the MJCF is its first data set.
        dataset = 0 if model == SHIPPED else None
        self._recorder = RobotRecorder(self.config, self.robot, dataset)
        self._effects = known_effects(source, self.config, overrides)
        self._dynamics, self._digest = self._model(source)
        self.link: RobotLink = open_link(
            where, self.robot, self.config.network.dt, stand_in, arguments
        )

    def _model(self, source: Path) -> tuple[Dynamics, str]:
        if self.model == PLANT:
            plant = EpisodeRecorder(self.config, self.robot).plant(0, self._effects)
            return RestartedPlant.from_measurements(plant), ""
        if (path := self._file(source)) is not None:
            weights = TrainedModel.read(self.model, path, self.robot).weights
            threads, library = self.config.sim_threads, self.config.library()
            return dynamics_of(weights, self.robot, threads, library), weights.digest
        network, digest = network_of(source, self.config, self.robot, self.model, PLANT)
        if network is None:
            raise ConfigError(
                f"A robot's full state is unknown, but --model {self.model} needs it; use {PLANT}."
            )
        return network, digest

    def _file(self, source: Path) -> Path | None:
        """The file of weights given as the model, or the last residual model of the run."""
        if self.model != RESIDUAL:
            return path if (path := Path(self.model)).is_file() else None
        folder = RunFolder(source)
        paths = [folder.residual(i) for i in range(self.config.iterations, -1, -1)]
        found = next((path for path in paths if path.exists()), None)
        if found is None:
            raise ConfigError(
                f"{source} has no residual model: no run was made there with residual.on."
            )
        return found

    def drive(self, seed: int, stage: Stage, transcript: Path) -> Drive:
        """Drive one episode; however it ends, the measurements are in the result.

        Args:
          seed: of task, planner and simulated sensors.
          stage: display of its progress.
          transcript: file for the messages on the link, which remains if this process is killed.
        """
        plan = self._plan(seed)
        steps = max(1, round(plan.seconds / self.config.network.dt))

        def on_step(done: int, sample: Sample) -> None:
            stage.update(min(1.0, done / steps))

        link = TranscribedLink(self.link, transcript)
        try:
            return self._recorder.record(link, plan, self._dynamics, self._digest, on_step)
        finally:
            link.end()

    def _plan(self, seed: int) -> EpisodePlan:
        return EpisodePlan(
            id=f"drive-{Path(self.model).stem}-{seed}",
            controller="mppi",
            iteration=-1,
            split="train",
            dataset=0,
            seconds=self.config.task.seconds,
            seed=seed,
            task_seed=seed,
            effects=self._effects,
        )

    def line(self, seed: int, driven: Drive, begun: float) -> DriveLine:
        """A drive as a line of the results.

        Args:
          seed: of the drive.
          driven: its result.
          begun: `time.process_time()` before it [s].
        """
        plan, episode = self._plan(seed), driven.episode
        task = self._recorder.task(plan, without_gaps(episode.trajectory.observations.points[0]))
        walk = self._recorder.walk(plan, episode)
        assert task is not None and walk is not None, "an episode to a goal has both"
        plans = episode.telemetry.get("plan_seconds", np.zeros(1))
        took = time.process_time() - begun
        return _line(self.setting, seed, walk, task, plans, took)

    @property
    def setting(self) -> Setting:
        """Setting of the drives."""
        config = self.config
        return Setting(
            robot=self.robot.name,
            task=config.task.name,
            model=self.model,
            digest=self._digest,
            effects=tuple(effect.label for effect in self._effects),
            hidden=() if self._stand_in is None else self._stand_in.hidden,
            samples=config.mppi.samples,
            horizon_seconds=config.mppi.horizon_seconds,
            threads=config.sim_threads,
            config=config_digest(config),
            link=self.where if self._stand_in is None else _sensors(self._stand_in),
        )


class _ShownHeartbeat(Heartbeat):
    """Shows the progress of an episode."""

    def __init__(self, stage: Stage) -> None:
        super().__init__()
        self._stage = stage

    def progress(self, done: float, note: str = "") -> None:
        super().progress(done, note)
        self._stage.update(done, note)


def config_of(source: Path, overrides: list[str]) -> RunConfig:
    """The configuration of a run's folder or of a file, with "key=value" on top of it."""
    if not source.is_dir():
        return load_config(source, overrides)
    RunFolder(source).config()  # refused where it is not what the run was begun with
    return load_stored_config(source / "config.yaml", overrides)


def known_effects(source: Path, config: RunConfig, overrides: tuple[str, ...]) -> Effects:
    """Effects of the driven plant: given ones, or those adopted by a run."""
    asked = any(each.partition("=")[0] == "effects" for each in overrides)
    if asked or not (source / RESULT_FILE).exists():
        return config.effects
    return open_run(source).result.effects_before(config.iterations + 1)


def network_of(
    source: Path, config: RunConfig, robot: Robot, model: str, instead: str = ORACLE
) -> tuple[Dynamics | None, str]:
    """The network for planning and its digest; none for the oracle, which the recorder makes itself."""
    if model == ORACLE:
        return None, ""
    if model == SHIPPED:
        shipped = Weights.read(shipped_weights(robot), robot)
        return shipped.dynamics(robot, config.sim_threads), shipped.digest
    if not source.is_dir():
        raise ConfigError(
            f"{source} is a configuration, which has no models. Give a run's folder, or --model "
            f"{instead} or {SHIPPED}."
        )
    run = open_run(source)
    iteration = run.champion() if model == CHAMPION else run.iteration(model)
    weights = run.weights(iteration)
    return weights.dynamics(robot, config.sim_threads), weights.digest


def _written(effect: WrittenTerm) -> str:
    """An effect with its values: "torque_speed (slope 0.1)"."""
    values = ", ".join(f"{name} {value:.3g}" for name, value in effect.parameters.items())
    return f"{effect.label} ({values})"


def _sensors(stand_in: StandInConfig) -> str:
    """A stand-in and its sensors: "simulated, noise 0.003"."""
    values = stand_in.model_dump(exclude={"hidden"})
    usual = StandInConfig().model_dump()
    changed = [f"{name} {value}" for name, value in values.items() if value != usual[name]]
    return ", ".join([SIMULATED, *changed])


def _line(
    setting: Setting, seed: int, walk: Walk, task: Task, plans: Floats, took: float
) -> DriveLine:
    """A drive as a line of the results.

    Args:
      setting, seed: of the drive.
      walk: seen from above.
      task: of the drive.
      plans: (N,) times of the plans [s].
      took: processor time of the whole drive [s].
    """
    middle, late = np.quantile(plans, [0.5, 0.95])
    return DriveLine(
        setting=setting,
        seed=seed,
        walk=walk,
        seconds_allowed=task.seconds,
        tolerance=task.tolerance,
        plan_seconds=(round(float(middle), 4), round(float(late), 4)),
        cpu_seconds=round(took, 2),
    )
