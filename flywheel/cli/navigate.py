"""`flywheel navigate`: MPPI episodes to goals, with a video, one after the other."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel.cli.drives import (
    Drive,
    Setting,
    append_drive,
    drive_picture,
    drive_table,
    read_drives,
)
from flywheel.cli.hidden_effects import hidden_effects
from flywheel.cli.runs import open_run
from flywheel.cli.show import console
from flywheel.control.protocol import OnPiece, Piece
from flywheel.data.recordings import write_recording
from flywheel.dynamics.plant import LiveView
from flywheel.dynamics.plant.render import render_episode
from flywheel.dynamics.protocol import Dynamics
from flywheel.effects import WrittenTerm
from flywheel.errors import ConfigError, FlywheelError
from flywheel.files import file_name
from flywheel.outputs import check_folder, check_outputs
from flywheel.records import Episode
from flywheel.runtime.config.run_config import (
    RunConfig,
    config_digest,
    load_config,
    load_stored_config,
)
from flywheel.runtime.pool.heartbeat import Heartbeat
from flywheel.runtime.pool.progress import Stage, console_progress
from flywheel.runtime.results import RESULT_FILE
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.stages.video import scenery_of
from flywheel.runtime.workers.episode_plan import ORACLE, Effects, EpisodePlan
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder

CHAMPION = "champion"


@dataclass(frozen=True)
class Wish:
    """What is asked for.

    Attributes:
      source: folder of a run, or a configuration.
      overrides: "key=value" on top of it.
      model: "champion", "oracle", or an iteration of the run.
      seeds: of the tasks and of the planner.
      hidden: what the plant has in place of what everybody is told, see `hidden_effects`; it is then
        simulated in shorter steps, too.
      video: where that of the first episode goes; None for `navigate-<model>-<seed>.mp4`.
      film: make it.
      watch: show the episodes while they happen.
      results: file that gets a line per episode; episodes that are in it are not driven again.
      picture: PNG of all paths in the results, from above.
      logs: folder that gets each episode as CSV.
    """

    source: Path
    overrides: tuple[str, ...] = ()
    model: str = CHAMPION
    seeds: range = range(1)
    hidden: tuple[str, ...] = ()
    video: Path | None = None
    film: bool = True
    watch: bool = False
    results: Path | None = None
    picture: Path | None = None
    logs: Path | None = None

    @property
    def video_file(self) -> Path:
        """Where the video goes."""
        return self.video or Path(f"navigate-{file_name(self.model)}-{self.seeds.start}.mp4")

    def check(self) -> None:
        """Make sure that everything can be written, before minutes of driving.

        Raises:
          DataError: something cannot be written.
          RunError: the disk is full.
        """
        video = self.video_file if self.film else None
        files = {"results": self.results, "picture": self.picture, "video": video}
        check_outputs(files, inputs=[self.source])
        if self.logs is not None:
            check_folder(self.logs, "folder of the logs")


class Driver:
    """Drives the episodes of a wish.

    Args:
      wish: see there.

    Raises:
      ConfigError: nothing can be driven like that.
    """

    def __init__(self, wish: Wish) -> None:
        self.wish = wish
        # Nothing else runs beside it: all cores plan.
        threads = f"sim_threads={len(os.sched_getaffinity(0))}"
        self.config = _config(wish.source, [threads, *wish.overrides])
        self.recorder = EpisodeRecorder(self.config, RunFolder(wish.source).robot(self.config))
        self._dynamics, self._digest = _dynamics(
            wish.source, self.config, self.recorder, wish.model
        )
        self._known = _effects(wish.source, self.config, wish.overrides)
        robot = self.recorder.robot
        self._hidden = hidden_effects(wish.hidden, robot) if wish.hidden else None

    @property
    def setting(self) -> Setting:
        """What drives, and where."""
        config = self.config
        return Setting(
            robot=self.recorder.robot.name,
            task=config.task.name,
            course=config.task.course if config.task.name == "obstacle_course" else "",
            terrain=config.terrain.kinds,
            model=self.wish.model,
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
        """Of one episode."""
        return EpisodePlan(
            id=f"navigate-{self.wish.model}-{seed}",
            controller=ORACLE if self.wish.model == ORACLE else "mppi",
            iteration=-1,
            split="test",
            dataset=0,
            seconds=self.config.task.seconds,
            seed=seed,
            task_seed=seed,
            effects=self._known,
            hidden=self._hidden,
        )

    def drive(self, seed: int, stage: Stage) -> tuple[Drive, Episode]:
        """Record one episode."""
        plan, begun = self.plan(seed), time.process_time()
        with self._shown(plan) as on_piece:
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

    def film(self, seed: int, episode: Episode) -> Path:
        """Make the video of an episode."""
        task, states = self.recorder.task(self.plan(seed)), episode.trajectory.states
        assert task is not None and states is not None, "a planned episode on a plant has both"
        scenery = scenery_of(task, episode.terrain)
        return render_episode(
            self.recorder.robot, states, self.wish.video_file, scenery, plans=episode.plans
        )

    @contextmanager
    def _shown(self, plan: EpisodePlan) -> Iterator[OnPiece | None]:
        """Shows the pieces of an episode, where that is asked for."""
        if not self.wish.watch:
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


def navigate(wish: Wish) -> None:
    """Drive, say how it ended, film it, and keep what is to be kept."""
    wish.check()
    driver, out = Driver(wish), console()
    there = read_drives(wish.results) if wish.results else []
    setting, progress = driver.setting, console_progress()
    driven = {drive.seed for drive in there if drive.setting == setting}
    logs = {seed: _log(wish, seed) for seed in wish.seeds if seed not in driven}
    for number, seed in enumerate(wish.seeds):
        if seed in driven:
            out.say(f"Seed {seed} is in {wish.results} already.")
            continue
        label = f"navigate {number + 1}/{len(wish.seeds)}" if len(wish.seeds) > 1 else "navigate"
        with progress.stage(label, 1.0) as stage:
            drive, episode = driver.drive(seed, stage)
        there.append(drive)
        if (log := logs[seed]) is not None:
            write_recording(episode, log, driver.recorder.robot)
        if wish.results:
            append_drive(wish.results, drive)
        out.print(f"Seed {seed}: {_ending(drive)}", highlight=False)
        if wish.film and number == 0:
            progress.say("Filming; this takes longer than driving without a graphics card.")
            try:
                out.say(f"Video: {driver.film(seed, episode)}")
            except FlywheelError as error:
                out.say(f"No video: {error}")
    if len(there) > 1:
        out.print(drive_table(there))
    if wish.picture:
        drive_picture(there, wish.picture)
        out.say(f"From above: {wish.picture}")


def _log(wish: Wish, seed: int) -> Path | None:
    """Where the log of an episode goes; refused now rather than after it was driven."""
    if wish.logs is None:
        return None
    wish.logs.mkdir(parents=True, exist_ok=True)
    path = wish.logs / f"{file_name(wish.model)}-{seed}.csv"
    if path.exists():
        raise ConfigError(f"{path} is there already; name another folder for the logs.")
    return path


class _ShownHeartbeat(Heartbeat):
    """Shows the progress of an episode."""

    def __init__(self, stage: Stage) -> None:
        super().__init__()
        self._stage = stage

    def progress(self, done: float, note: str = "") -> None:
        super().progress(done, note)
        self._stage.update(done, note)


def _config(source: Path, overrides: list[str]) -> RunConfig:
    if not source.is_dir():
        return load_config(source, overrides)
    RunFolder(source).config()  # refused where it is not what the run was begun with
    return load_stored_config(source / "config.yaml", overrides)


def _effects(source: Path, config: RunConfig, overrides: tuple[str, ...]) -> Effects:
    """Of the plant that is driven: those that are asked for, or those that a run adopted."""
    asked = any(each.partition("=")[0] == "effects" for each in overrides)
    if asked or not (source / RESULT_FILE).exists():
        return config.effects
    return open_run(source).result.effects_before(config.iterations + 1)


def _dynamics(
    source: Path, config: RunConfig, recorder: EpisodeRecorder, model: str
) -> tuple[Dynamics | None, str]:
    """The model to plan with and its digest; the recorder makes the oracle itself."""
    if model == ORACLE:
        return None, ""
    if not source.is_dir():
        raise ConfigError(
            f"{source} is a configuration, which has no models. Give a run's folder, or --model "
            "oracle."
        )
    run = open_run(source)
    iteration = run.champion() if model == CHAMPION else run.iteration(model)
    weights = run.weights(iteration)
    return weights.dynamics(recorder.robot, config.sim_threads), weights.digest


def _written(effect: WrittenTerm) -> str:
    """With its values: "torque_speed (slope 0.1)"."""
    values = ", ".join(f"{name} {value:.3g}" for name, value in effect.parameters.items())
    return f"{effect.label} ({values})"


def _ending(drive: Drive) -> str:
    middle, late = drive.plan_seconds
    planning = f" A plan took {middle:.3f} s (95 % of them less than {late:.3f} s)."
    walk = drive.walk
    if walk.reached:
        return f"[green]reached the goal after {walk.seconds:.1f} s.[/green]{planning}"
    return (
        f"[yellow]did not reach the goal in {walk.seconds:.1f} s;[/yellow] {walk.distance:.2f} m "
        f"were left.{planning}"
    )
