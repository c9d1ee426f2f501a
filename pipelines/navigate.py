"""`flywheel navigate`: one MPPI episode to a goal, with a video."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from flywheel.dynamics.plant.render import render_episode
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ConfigError, FlywheelError
from flywheel.records import Episode
from flywheel.runtime.config import RunConfig, load_config
from flywheel.runtime.plan import ORACLE, Effects, EpisodePlan
from flywheel.runtime.progress import Stage, console_progress
from flywheel.runtime.recording import Recorder
from flywheel.runtime.results import RESULT_FILE
from flywheel.runtime.run_folder import RunFolder
from flywheel.runtime.watch import Watch
from pipelines.runs import open_run
from pipelines.show import console

CHAMPION = "champion"


def drive(source: Path, overrides: list[str], model: str, seed: int, video: Path | None) -> None:
    """Record the episode, say how it ended, and film it.

    Args:
      source: folder of a run, or a configuration.
      overrides: "key=value" on top of it.
      model: "champion", "oracle", or an iteration of the run.
      seed: of the task and of the planner.
      video: where it goes, or None for the usual place.
    """
    # Nothing else runs beside it: all cores plan.
    config = _config(source, [f"sim_threads={len(os.sched_getaffinity(0))}", *overrides])
    recorder = Recorder(config, RunFolder(source).robot(config))
    dynamics, digest = _dynamics(source, config, recorder, model)
    plan = EpisodePlan(
        id=f"navigate-{model}-{seed}",
        controller=ORACLE if model == ORACLE else "mppi",
        iteration=-1,
        split="test",
        dataset=0,
        seconds=config.task.seconds,
        seed=seed,
        task_seed=seed,
        effects=_effects(source, config, overrides),
    )
    progress = console_progress()
    with progress.stage("navigate", 1.0) as stage:
        episode = recorder.record(plan, dynamics, digest, _ShownWatch(stage))
    out = console()
    out.print(_ending(episode), highlight=False)
    progress.say("Filming; this takes longer than driving without a graphics card.")
    path = video or Path(f"navigate-{model}-{seed}.mp4")
    try:
        _film(recorder, plan, episode, path)
    except FlywheelError as error:
        out.print(f"No video: {error}", soft_wrap=True)
    else:
        out.print(f"Video: {path}", soft_wrap=True)


class _ShownWatch(Watch):
    """Shows the progress of an episode."""

    def __init__(self, stage: Stage) -> None:
        super().__init__()
        self._stage = stage

    def progress(self, done: float, note: str = "") -> None:
        super().progress(done, note)
        self._stage.update(done, note)


def _config(source: Path, overrides: list[str]) -> RunConfig:
    return load_config(source / "config.yaml" if source.is_dir() else source, overrides)


def _effects(source: Path, config: RunConfig, overrides: list[str]) -> Effects:
    """Of the plant that is driven: those that are asked for, or those that a run adopted."""
    asked = any(each.partition("=")[0] == "effects" for each in overrides)
    if asked or not (source / RESULT_FILE).exists():
        return config.effects
    return open_run(source).result.effects_before(config.iterations + 1)


def _dynamics(
    source: Path, config: RunConfig, recorder: Recorder, model: str
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


def _ending(episode: Episode) -> str:
    outcome = episode.outcome
    assert outcome is not None, "an episode with a task has an outcome"
    plans = episode.telemetry.get("plan_seconds")
    planning = ""
    if plans is not None and len(plans):
        middle, late = np.quantile(plans, [0.5, 0.95])
        planning = f" A plan took {middle:.3f} s (95 % of them less than {late:.3f} s)."
    if outcome.success:
        return f"[green]Reached the goal after {outcome.seconds:.1f} s.[/green]{planning}"
    return (
        f"[yellow]Did not reach the goal in {outcome.seconds:.1f} s;[/yellow] "
        f"{outcome.distance:.2f} m were left.{planning}"
    )


def _film(recorder: Recorder, plan: EpisodePlan, episode: Episode, path: Path) -> None:
    task, states = recorder.task(plan), episode.trajectory.states
    assert task is not None and states is not None, "a planned episode on a plant has both"
    render_episode(
        recorder.robot,
        states,
        path,
        obstacles=task.obstacles,
        goal=task.goal,
        terrain=episode.terrain,
    )
