"""Drives one episode after the other: `PlantDriver` for `flywheel navigate`, `RobotDriver` for `drive`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.cli.driving.drives import DriveLine, Setting
from flywheel.cli.driving.hidden_effects import hidden_effects
from flywheel.cli.options import CHAMPION
from flywheel.cli.runs.opening import open_run
from flywheel.control.drive import Drive
from flywheel.control.protocol import OnPiece, Piece
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.gnn import check_device
from flywheel.dynamics.gnn.shipped import SHIPPED, shipped_weights
from flywheel.dynamics.plant import LiveView, RestartedPlant
from flywheel.dynamics.plant.render import Film
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import EFFECTS, WrittenTerm
from flywheel.errors import ConfigError
from flywheel.files import shown
from flywheel.records import Episode, Split
from flywheel.results import RESULT_FILE, Walk
from flywheel.robot_link import RobotLink, StandInConfig, TranscribedLink
from flywheel.robot_link.opening import SIMULATED, open_link
from flywheel.robots import Robot
from flywheel.runtime.config.run_config import RunConfig, config_digest, load_config
from flywheel.runtime.pool.progress import Stage
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.stages.video import scenery_of
from flywheel.runtime.workers.episode_plan import ASTAR, ORACLE, Effects, EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder, RobotRecorder
from flywheel.runtime.workers.model_weights import TrainedModel, Weights
from flywheel.tasks import Task

PLANT, RESIDUAL = "plant", "residual"


class _Driver:
    """Base of the drivers, whose arguments these are."""

    def __init__(self, source: Path, overrides: tuple[str, ...], model: str) -> None:
        self.model = model
        # Nothing else runs beside it: all cores plan.
        threads = f"sim_threads={len(os.sched_getaffinity(0))}"
        self.config = config_of(source, [threads, *overrides])
        check_device(self.config.mppi.device, "mppi.device")
        self.robot = RunFolder(source).robot(self.config)
        self._known = known_effects(source, self.config, overrides)
        self._digest = ""

    def _plan(self, name: str, controller: str, split: Split, seed: int) -> EpisodePlan:
        return EpisodePlan(
            id=f"{name}-{seed}",
            controller=controller,
            iteration=-1,
            split=split,
            seconds=self.config.task.seconds,
            seed=seed,
            task_seed=seed,
            effects=self._known,
        )

    def _setting(self, **more: Any) -> Setting:
        config = self.config
        return Setting(
            robot=self.robot.name,
            mjcf=self.robot.digest if config.model.endswith(".xml") else "",
            task=config.task.name,
            model=self.model,
            digest=self._digest,
            effects=tuple(effect.label for effect in self._known),
            samples=config.mppi.samples,
            horizon_seconds=config.mppi.horizon_seconds,
            threads=config.sim_threads,
            config=config_digest(config),
            **more,
        )


class PlantDriver(_Driver):
    """Drives episodes on a simulated plant.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", "oracle", "shipped", a baseline, an iteration of the run, or a file of weights.
      hidden: true effects of the plant instead of the known ones, see `hidden_effects`; it is then
        simulated in shorter steps, too.
      controller: "mppi", or "astar", which needs the model "oracle".

    Raises:
      ConfigError: these settings cannot be driven.
    """

    def __init__(
        self,
        source: Path,
        overrides: tuple[str, ...] = (),
        model: str = CHAMPION,
        hidden: tuple[str, ...] = (),
        controller: str = "mppi",
    ) -> None:
        if controller == ASTAR and model != ORACLE:
            raise ConfigError(
                f"A* measures gaits on the plant itself: it needs --model {ORACLE}, got {model!r}."
            )
        super().__init__(source, overrides, model)
        self._controller = controller
        self._recorder = EpisodeRecorder(self.config, self.robot)
        self._dynamics, self._digest = network_of(source, self.config, self.robot, model)
        library = self.config.library(EFFECTS)
        self._hidden = hidden_effects(hidden, self.robot, library) if hidden else None

    @property
    def setting(self) -> Setting:
        """Setting of the drives."""
        task = self.config.task
        return self._setting(
            course=task.course if task.name == "obstacle_course" else "",
            terrain=self.config.terrain.kinds,
            hidden=tuple(_written(effect) for effect in self._hidden or ()),
            fineness=self.plan(0).fineness,
            controller=self._controller,
        )

    def plan(self, seed: int) -> EpisodePlan:
        """The plan of one episode."""
        mppi = ORACLE if self.model == ORACLE else "mppi"
        controller = mppi if self._controller == "mppi" else self._controller
        plan = self._plan(f"navigate-{Path(self.model).stem}", controller, "test", seed)
        return replace(plan, hidden=self._hidden)

    def drive(self, seed: int, stage: Stage, show: bool = False) -> tuple[DriveLine, Episode]:
        """Record one episode.

        Args:
          seed: of task and planner.
          stage: display of its progress.
          show: display the episode during its recording.
        """
        plan, begun = self.plan(seed), time.process_time()
        with self._shown(plan, show) as on_piece:
            network = self._dynamics, self._digest
            episode = self._recorder.record(plan, *network, stage.update, on_piece)
        walk, task = self._recorder.walk(plan, episode), self._recorder.task(plan)
        return _line(self.setting, walk, task, episode, begun), episode

    def film(self, seed: int, episode: Episode, path: Path, stage: Stage) -> Path:
        """Make the video of an episode."""
        task, states = self._recorder.task(self.plan(seed)), episode.trajectory.states
        assert task is not None and states is not None, "a planned episode on a plant has both"
        scenery = scenery_of(task, episode.terrain)
        return Film(self.robot, states, scenery, plans=episode.plans).write(path, stage.update)

    @contextmanager
    def _shown(self, plan: EpisodePlan, wanted: bool) -> Iterator[OnPiece | None]:
        """Shows the pieces of an episode, if requested."""
        if not wanted:
            yield None
            return
        task = self._recorder.task(plan)
        assert task is not None, "a driven episode has a task"
        scenery = scenery_of(task, self._recorder.terrain(plan))
        with closing(LiveView(self.robot, scenery)) as view:

            def show(piece: Piece) -> None:
                assert piece.simulated.states is not None
                states = piece.simulated.states[0, 1:]
                view.show(states, piece.simulated.dt, piece.command.diagnostics.get("paths"))

            yield show


class RobotDriver(_Driver):
    """Drives a robot with MPPI.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", an iteration of the run, "plant" (the MJCF with the known effects),
        "residual" (that plant with the correcting network), "shipped", a baseline, or a file of weights.
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
        super().__init__(source, overrides, model)
        self.where, self._stand_in = where, stand_in if where == SIMULATED else None
        if where == SIMULATED and self.config.task.name != "reach":
            raise ConfigError(
                "A stand-in has no obstacles around it: task.name must be reach, got "
                f"{self.config.task.name}."
            )
        if asked := next((each for each in overrides if each.startswith("terrain")), None):
            raise ConfigError(
                f"{shown(asked)} has no effect: a robot is on the ground that it is on, and plans take that "
                "for a plane. Leave it out."
            )
        # A shipped network knows no recordings; the plant of the MJCF is its first data set.
        dataset = 0 if model == SHIPPED else None
        self._recorder = RobotRecorder(self.config, self.robot, dataset)
        self._dynamics, self._digest = self._model(source)
        self.link: RobotLink = open_link(
            where, self.robot, self.config.network.dt, stand_in, arguments
        )

    def _model(self, source: Path) -> tuple[Dynamics, str]:
        if self.model == PLANT:
            plant = EpisodeRecorder(self.config, self.robot).plant(0, self._known)
            return RestartedPlant.from_measurements(plant), ""
        model = str(self._residual(source)) if self.model == RESIDUAL else self.model
        network, digest = network_of(source, self.config, self.robot, model, PLANT)
        if network is None:
            raise ConfigError(
                f"A robot's full state is unknown, but --model {self.model} needs it; use {PLANT}."
            )
        return network, digest

    def _residual(self, source: Path) -> Path:
        """The last residual model of the run."""
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
        link, plan = TranscribedLink(self.link, transcript), self.plan(seed)
        try:
            return self._recorder.record(link, plan, self._dynamics, self._digest, stage.update)
        finally:
            link.end()

    def plan(self, seed: int) -> EpisodePlan:
        """The plan of one episode."""
        return self._plan(f"drive-{Path(self.model).stem}", "mppi", "train", seed)

    def line(self, seed: int, driven: Drive, begun: float) -> DriveLine:
        """A drive as a line of the results.

        Args:
          seed: of the drive.
          driven: its result.
          begun: `time.process_time()` before it [s].
        """
        plan, episode = self.plan(seed), driven.episode
        walk, task = self._recorder.walk(plan, episode), self._recorder.task(plan, episode)
        return _line(self.setting, walk, task, episode, begun)

    @property
    def setting(self) -> Setting:
        """Setting of the drives."""
        if self._stand_in is None:
            return self._setting(link=self.where)
        return self._setting(hidden=self._stand_in.hidden, link=_sensors(self._stand_in))


def config_of(source: Path, overrides: list[str]) -> RunConfig:
    """The configuration of a run's folder or of a file, with "key=value" on top of it."""
    if not source.is_dir():
        return load_config(source, overrides)
    RunFolder(source).config()  # refused where it is not what the run was begun with
    return load_config(source / "config.yaml", overrides, stored=True)


def known_effects(source: Path, config: RunConfig, overrides: tuple[str, ...]) -> Effects:
    """Effects of the driven plant: given ones, or those adopted by a run."""
    asked = any(each.partition("=")[0] == "effects" for each in overrides)
    if asked or not (source / RESULT_FILE).exists():
        return config.effects
    return open_run(source).result.effects_before(config.iterations + 1)


def network_of(
    source: Path, config: RunConfig, robot: Robot, model: str, instead: str = ORACLE
) -> tuple[Dynamics | None, str]:
    """The model for planning and its digest; none for the oracle, which the recorder makes itself.

    The digest of a baseline by name is empty.

    Raises:
      ConfigError: there is none, or it is of another control step.
    """
    if model == ORACLE:
        return None, ""
    if model in BASELINES:
        return BASELINES[model](robot, config.network.dt, config.sim_threads), ""
    weights = (
        TrainedModel.read(model, path, robot).weights
        if (path := Path(model)).is_file()
        else _network_weights(source, robot, model, instead)
    )
    threads, library, arithmetic = config.sim_threads, config.library(), config.mppi.arithmetic
    dynamics = weights.dynamics(robot, threads, library, arithmetic)
    if abs(dynamics.dt - config.network.dt) > 1e-9:
        raise ConfigError(
            f"The model {model} predicts in steps of {dynamics.dt:g} s; network.dt is "
            f"{config.network.dt:g} s."
        )
    return dynamics, weights.digest


def _network_weights(source: Path, robot: Robot, model: str, instead: str) -> Weights:
    if model == SHIPPED:
        return Weights.read(shipped_weights(robot), robot)
    if not source.is_dir():
        raise ConfigError(
            f"{source} is a configuration, which has no model {model!r}. Give a run's folder, or --model "
            f"{instead}, {SHIPPED}, {', '.join(BASELINES)}, or a file of weights."
        )
    run = open_run(source)
    iteration = run.champion() if model == CHAMPION else run.iteration(model)
    return run.weights(iteration)


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
    setting: Setting, walk: Walk | None, task: Task | None, episode: Episode, begun: float
) -> DriveLine:
    """A drive as a line of the results, given `time.process_time()` before it [s]."""
    assert walk is not None and task is not None, "an episode to a goal has both"
    took = time.process_time() - begun
    planned = episode.telemetry.get("plan_seconds", np.zeros(1))
    planned = planned[planned > 0] if planned.any() else planned  # A* plans at some commands only
    middle, late = np.quantile(planned, [0.5, 0.95])
    return DriveLine(
        setting=setting,
        seed=walk.seed,
        walk=walk,
        seconds_allowed=task.seconds,
        tolerance=task.tolerance,
        plan_seconds=(round(float(middle), 4), round(float(late), 4)),
        cpu_seconds=round(took, 2),
    )
