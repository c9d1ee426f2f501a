"""What `flywheel navigate` drives: episodes of a run's model, or of the plant itself, one at a time."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from flywheel.cli.driving.drives import Drive, Setting
from flywheel.cli.driving.hidden_effects import hidden_effects
from flywheel.cli.options import CHAMPION
from flywheel.cli.runs.opening import open_run
from flywheel.control.protocol import OnPiece, Piece
from flywheel.dynamics.gnn.shipped import SHIPPED, shipped_weights
from flywheel.dynamics.plant import LiveView
from flywheel.dynamics.plant.render import render_episode
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import EFFECTS, WrittenTerm
from flywheel.errors import ConfigError
from flywheel.records import Episode
from flywheel.results import RESULT_FILE
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
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.model_weights import Weights


class Driver:
    """Drives episodes.

    Args:
      source: folder of a run, or file of a configuration.
      overrides: "key=value" on top of it.
      model: "champion", "oracle", "shipped", or an iteration of the run.
      hidden: what the plant has in place of what everybody is told, see `hidden_effects`; it is then
        simulated in shorter steps, too.

    Raises:
      ConfigError: nothing can be driven like that.
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
        """What drives, and where."""
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

    def drive(self, seed: int, stage: Stage, show: bool = False) -> tuple[Drive, Episode]:
        """Record one episode.

        Args:
          seed: of task and planner.
          stage: shows how far it is.
          show: the episode while it happens.
        """
        plan, begun = self.plan(seed), time.process_time()
        with self._shown(plan, show) as on_piece:
            watch = _ShownHeartbeat(stage)
            episode = self.recorder.record(plan, self._dynamics, self._digest, watch, on_piece)
        took = time.process_time() - begun
        walk, task = self.recorder.walk(plan, episode), self.recorder.task(plan)
        assert walk is not None and task is not None, "an episode with a task has both"
        middle, late = np.quantile(episode.telemetry["plan_seconds"], [0.5, 0.95])
        return Drive(
            setting=self.setting,
            seed=seed,
            walk=walk,
            seconds_allowed=task.seconds,
            tolerance=task.tolerance,
            plan_seconds=(round(float(middle), 4), round(float(late), 4)),
            cpu_seconds=round(took, 2),
        ), episode

    def film(self, seed: int, episode: Episode, path: Path) -> Path:
        """Make the video of an episode."""
        task, states = self.recorder.task(self.plan(seed)), episode.trajectory.states
        assert task is not None and states is not None, "a planned episode on a plant has both"
        scenery = scenery_of(task, episode.terrain)
        return render_episode(self.recorder.robot, states, path, scenery, plans=episode.plans)

    @contextmanager
    def _shown(self, plan: EpisodePlan, wanted: bool) -> Iterator[OnPiece | None]:
        """Shows the pieces of an episode, where that is wanted."""
        if not wanted:
            yield None
            return
        task = self.recorder.task(plan)
        assert task is not None, "an episode that is driven has a task"
        scenery = scenery_of(task, self.recorder.terrain(plan))
        with closing(LiveView(self.recorder.robot, scenery)) as view:

            def show(piece: Piece) -> None:
                assert piece.simulated.states is not None
                states = piece.simulated.states[0, 1:]
                view.show(states, piece.simulated.dt, piece.command.diagnostics.get("paths"))

            yield show


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
    """Effects of the plant that is driven: those that are asked for, or those that a run adopted."""
    asked = any(each.partition("=")[0] == "effects" for each in overrides)
    if asked or not (source / RESULT_FILE).exists():
        return config.effects
    return open_run(source).result.effects_before(config.iterations + 1)


def network_of(
    source: Path, config: RunConfig, robot: Robot, model: str, instead: str = ORACLE
) -> tuple[Dynamics | None, str]:
    """The network to plan with and its digest; none for the oracle, which the recorder makes itself."""
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
