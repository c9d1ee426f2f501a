"""`flywheel drive`: MPPI drives a robot behind a link to goals, and logs it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console
from flywheel.cli.driving.navigate import (
    EpisodesOptions,
    SourceArgument,
    checked_source,
    new_logs,
    show_drives,
)
from flywheel.cli.exits import FAILED, INTERRUPTED
from flywheel.cli.options import CHAMPION, Overrides
from flywheel.cli.robot.stand_in import StandInOptions

if TYPE_CHECKING:
    from flywheel.cli.driving.driver import RobotDriver
    from flywheel.cli.driving.drives import DriveLine

ENDINGS = {
    "goal": "[green]reached the goal after {seconds:.1f} s[/green]",
    "time": (
        "[yellow]did not reach the goal in {seconds:.1f} s[/yellow], {distance:.2f} m remained"
    ),
    "lost": "[red]the link was lost after {seconds:.1f} s[/red]",
    "failed": "[red]the planner failed after {seconds:.1f} s[/red]",
    "stopped": "[yellow]stopped after {seconds:.1f} s[/yellow]",
}
CODES = {"lost": FAILED, "failed": FAILED, "stopped": INTERRUPTED}


def drive(
    source: SourceArgument,
    overrides: Overrides = (),
    *,
    robot: Annotated[str, "ROBOT"] = "simulated",
    model: str = CHAMPION,
    asked: EpisodesOptions = EpisodesOptions(),
    stand_in: StandInOptions = StandInOptions(),
    arguments: Annotated[tuple[str, ...], "--argument", "KEY=VALUE"] = (),
    logs: Annotated[Path, "FOLDER"] = Path("drives"),
) -> None:
    """Drive a robot to goals with MPPI, and log the measurements.

    Success is judged by measurements alone. However an episode ends, also by Ctrl-C or a lost link,
    the robot holds its winches, and its log is complete up to there. A transcript next to the log
    survives a killed driver; `flywheel robot log` makes a log from it.

    [bold]Examples[/bold]

    flywheel drive prism3 --model shipped

    flywheel drive runs/prism3 --hidden torque_speed --hidden payload

    flywheel drive runs/prism3 --robot tcp://127.0.0.1:7420 --episodes 3

    flywheel drive prism3 --model plant --robot my_lab:MyRobot --argument port=/dev/ttyUSB0

    Args:
      robot: simulated (a stand-in), tcp://HOST:PORT, ros://HOST:PORT, or MODULE:CLASS of your own.
      model: champion, an iteration's number, plant (the MJCF with adopted effects), residual (that plant,
        corrected by a network), shipped (the network that comes with Flywheel), a baseline (flywheel list
        models), or a file of weights.
      arguments: Argument of your own link.
      logs: Output folder: each episode as CSV, in the format of a robot's log.
    """
    from flywheel.cli.driving.driver import RobotDriver

    out, place, there = console(), checked_source(source, asked, logs), asked.there()
    way = _arguments(arguments)
    driver = RobotDriver(place, overrides, model, robot, stand_in.config(), way)
    try:
        seeds = asked.left(there, driver.setting)
        if done := asked.episodes - len(seeds):
            out.say(f"{done} of {asked.episodes} episodes are in {asked.results} already.")
        files = new_logs(logs, model, seeds)
        lines, ended = _drive_all(out, driver, files, asked)
    finally:
        driver.link.close()
    show_drives(out, [*there, *lines], asked.picture)
    if ended in CODES:
        raise typer.Exit(CODES[ended])


def _drive_all(
    out: Out, driver: RobotDriver, files: Mapping[int, Path], asked: EpisodesOptions
) -> tuple[list[DriveLine], str]:
    """Drive one episode for each seed, until one of them ends early; returns the end of the last one."""
    from flywheel.data.recordings import write_recording
    from flywheel.runtime.pool.progress import console_progress

    lines, ended, progress = [], "", console_progress()
    for number, (seed, file) in enumerate(files.items(), 1):
        begun = time.process_time()
        transcript = file.with_suffix(".jsonl")
        with progress.stage(f"drive {number}/{len(files)}", 1.0) as stage:
            driven = driver.drive(seed, stage, transcript)
        write_recording(driven.episode, file, driver.robot)
        transcript.unlink()
        lines.append(driver.line(seed, driven, begun))
        asked.keep(lines[-1])
        ended, walk = driven.ended, lines[-1].walk
        words = ENDINGS[ended].format(seconds=walk.seconds, distance=walk.distance)
        out.print(f"Seed {seed}: {words}. {_remarks(driven.late_plans, driven.skipped)}{file}")
        if driven.why:
            out.say(driven.why, style="red")
        if ended in CODES:
            break
    return lines, ended


def _remarks(late: int, skipped: int) -> str:
    words = []
    if late:
        words.append(f"{late} plans came late, and the previous one continued.")
    if skipped:
        words.append(f"In {skipped} control periods no command was sent in time.")
    return " ".join([*words, ""])


def _arguments(texts: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE as a dictionary."""
    from flywheel.errors import ConfigError

    found = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not sign or not key.isidentifier():
            raise ConfigError(f"--argument takes KEY=VALUE, got {text!r}.")
        found[key] = value
    return found
