"""`flywheel navigate`: episodes to goals on the plant, with a video."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console
from flywheel.cli.options import CHAMPION, Overrides, within
from flywheel.quantities import SAMPLES, SEED

if TYPE_CHECKING:
    from flywheel.cli.driving.driver import PlantDriver
    from flywheel.cli.driving.drives import DriveLine
    from flywheel.records import Episode
    from flywheel.runtime.pool.progress import Progress


class Planner(StrEnum):
    """Controllers that go to goals."""

    mppi = "mppi"
    astar = "astar"


SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="RUN|CONFIG",
        help="A run's folder, or a configuration by name or file (with any --model that is not of a run).",
    ),
]
ModelOption = Annotated[
    str,
    typer.Option(
        help="champion, an iteration's number, shipped (the network that comes with Flywheel), oracle "
        "(the plant itself), a baseline (flywheel list models), or a file of weights."
    ),
]
ControllerOption = Annotated[
    Planner,
    typer.Option(
        help="mppi, or astar (prism3): a search for gait cycles that are measured on --model oracle."
    ),
]
SeedOption = Annotated[
    int, typer.Option(help="Seed of the task and of the planner.", callback=within(SEED))
]
EpisodesOption = Annotated[
    int,
    typer.Option(help="Number of episodes, with seeds from --seed on.", callback=within(SAMPLES)),
]
HiddenOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT[@PLACE][:SIZE]",
        help="Hidden effect of the plant beyond its MJCF: torque_speed:2 is twice its typical "
        "size. Or the path of an adopted plant.",
    ),
]
WatchOption = Annotated[bool, typer.Option("--watch", help="Show it live on a display.")]
FilmOption = Annotated[bool, typer.Option(help="Make a video of the first episode.")]
VideoOption = Annotated[
    Path | None,
    typer.Option(help="Output file of the video; navigate-<model>-<seed>.mp4 by default."),
]
ResultsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="JSONL",
        help="Output file with a line per episode; existing lines are not driven again.",
    ),
]
PictureOption = Annotated[
    Path | None,
    typer.Option(metavar="PNG", help="Picture of all paths in the results, from above."),
]
LogsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER", help="Output folder: each episode as CSV, in the format of a robot's log."
    ),
]


def navigate(
    source: SourceArgument,
    overrides: Overrides = None,
    model: ModelOption = CHAMPION,
    controller: ControllerOption = Planner.mppi,
    seed: SeedOption = 0,
    episodes: EpisodesOption = 1,
    hidden: HiddenOption = None,
    watch: WatchOption = False,
    film: FilmOption = True,
    video: VideoOption = None,
    results: ResultsOption = None,
    picture: PictureOption = None,
    logs: LogsOption = None,
) -> None:
    """Drive to goals with MPPI or A*, and make a video.

    [bold]Examples[/bold]

    flywheel navigate runs/prism3 --seed 7 --watch

    flywheel navigate prism3 --model oracle --controller astar

    flywheel navigate runs/s_course task.course=maze --episodes 10 --results maze.jsonl --picture maze.png

    flywheel navigate runs/s_course --hidden torque_speed --episodes 10 --logs logs/
    """
    from flywheel.cli.driving.driver import PlantDriver
    from flywheel.cli.driving.drives import append_drive, read_drives
    from flywheel.data.recordings import write_recording
    from flywheel.files import file_name
    from flywheel.runtime.pool.progress import console_progress

    out, progress = console(), console_progress()
    video = (video or Path(f"navigate-{file_name(model)}-{seed}.mp4")) if film else None
    outputs = {"results": results, "picture": picture, "video": video}
    place = checked_source(source, outputs, logs)
    driver = PlantDriver(place, tuple(overrides or ()), model, tuple(hidden or ()), controller)
    there = read_drives(results) if results else []
    driven = {drive.seed for drive in there if drive.setting == driver.setting}
    seeds = range(seed, seed + episodes)
    log_of = new_logs(logs, model, [each for each in seeds if each not in driven]) if logs else {}
    for number, each in enumerate(seeds):
        if each in driven:
            out.say(f"Seed {each} is in {results} already.")
            continue
        label = f"navigate {number + 1}/{episodes}" if episodes > 1 else "navigate"
        with progress.stage(label, 1.0) as stage:
            drive, episode = driver.drive(each, stage, watch)
        there.append(drive)
        if each in log_of:
            write_recording(episode, log_of[each], driver.robot)
        if results:
            append_drive(results, drive)
        out.print(f"Seed {each}: {_ending(drive)}", highlight=False)
        if video and number == 0:
            _film(out, progress, driver, episode, each, video)
    show_drives(out, there, picture)


def checked_source(source: str, outputs: Mapping[str, Path | None], logs: Path | None) -> Path:
    """The folder of a run, or the file of a configuration; checks the outputs before minutes of driving.

    Raises:
      ConfigError: there is no such configuration.
      DataError: an output cannot be written.
      RunError: the disk is full.
    """
    from flywheel.outputs import check_folder, check_outputs
    from flywheel.runtime.config.shipped import config_file

    place = Path(source) if Path(source).is_dir() else config_file(source)
    check_outputs(outputs, inputs=[place])
    if logs is not None:
        check_folder(logs, "folder of the logs")
    return place


def new_logs(folder: Path, model: str, seeds: Iterable[int]) -> dict[int, Path]:
    """Log file of each seed; raises before a drive if one exists."""
    from flywheel.errors import ConfigError
    from flywheel.files import file_name

    folder.mkdir(parents=True, exist_ok=True)
    files = {seed: folder / f"{file_name(Path(model).stem)}-{seed}.csv" for seed in seeds}
    for path in files.values():
        if path.exists():
            raise ConfigError(f"{path} exists already; use another folder with --logs.")
    return files


def _film(
    out: Out, progress: Progress, driver: PlantDriver, episode: Episode, seed: int, path: Path
) -> None:
    from flywheel.errors import FlywheelError

    progress.say("Filming; without a graphics card this takes longer than driving.")
    try:
        out.say(f"Video: {driver.film(seed, episode, path)}")
    except FlywheelError as error:
        out.say(f"No video: {error}")


def show_drives(out: Out, drives: Sequence[DriveLine], picture: Path | None) -> None:
    """Print a table of several episodes, and draw them if requested."""
    from flywheel.cli.driving.drives import drive_picture, drive_table

    if len(drives) > 1:
        out.print(drive_table(drives))
    if picture:
        drive_picture(drives, picture)
        out.say(f"From above: {picture}")


def _ending(drive: DriveLine) -> str:
    middle, late = drive.plan_seconds
    planning = f" A plan took {middle:.3f} s (95 % of them less than {late:.3f} s)."
    walk = drive.walk
    if walk.reached:
        return f"[green]reached the goal after {walk.seconds:.1f} s.[/green]{planning}"
    return (
        f"[yellow]did not reach the goal in {walk.seconds:.1f} s;[/yellow] {walk.distance:.2f} m "
        f"remained.{planning}"
    )
