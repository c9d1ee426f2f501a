"""`flywheel navigate`: episodes to goals on the plant, with a video."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from flywheel.cli.console import Out, console
from flywheel.cli.options import CHAMPION, Overrides
from flywheel.quantities import Samples, Seed

if TYPE_CHECKING:
    from flywheel.cli.driving.driver import PlantDriver
    from flywheel.cli.driving.drives import DriveLine, Setting
    from flywheel.records import Episode
    from flywheel.runtime.pool.progress import Progress

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


@dataclass(frozen=True)
class EpisodesOptions:
    """Episodes that are driven, and their results.

    Attributes:
      seed: Seed of the task and of the planner.
      episodes: Number of episodes, with seeds from --seed on.
      results: Output file with a line per episode; existing lines are not driven again.
      picture: Picture of all paths in the results, from above.
    """

    seed: Seed = 0
    episodes: Samples = 1
    results: Annotated[Path | None, "JSONL"] = None
    picture: Annotated[Path | None, "PNG"] = None

    @property
    def seeds(self) -> range:
        """Seed of each episode."""
        return range(self.seed, self.seed + self.episodes)

    def there(self) -> list[DriveLine]:
        """The existing lines of the results."""
        from flywheel.cli.driving.drives import read_drives

        return read_drives(self.results) if self.results else []

    def left(self, there: Sequence[DriveLine], setting: Setting) -> list[int]:
        """Seeds that were not driven in this setting."""
        driven = {drive.seed for drive in there if drive.setting == setting}
        return [seed for seed in self.seeds if seed not in driven]

    def keep(self, drive: DriveLine) -> None:
        """Append a line to the results, if requested."""
        from flywheel.cli.driving.drives import append_drive

        if self.results:
            append_drive(self.results, drive)


def navigate(
    source: SourceArgument,
    overrides: Overrides = (),
    *,
    model: ModelOption = CHAMPION,
    controller: Literal["mppi", "astar"] = "mppi",
    asked: EpisodesOptions = EpisodesOptions(),
    hidden: Annotated[tuple[str, ...], "EFFECT[@PLACE][:SIZE]"] = (),
    watch: Annotated[bool, "--watch"] = False,
    film: bool = True,
    video: Path | None = None,
    logs: Annotated[Path | None, "FOLDER"] = None,
) -> None:
    """Drive to goals with MPPI or A*, and make a video.

    [bold]Examples[/bold]

    flywheel navigate runs/prism3 --seed 7 --watch

    flywheel navigate prism3 --model oracle --controller astar

    flywheel navigate runs/s_course task.course=maze --episodes 10 --results maze.jsonl --picture maze.png

    flywheel navigate runs/s_course --hidden torque_speed --episodes 10 --logs logs/

    Args:
      controller: mppi, or astar (prism3): a search for gait cycles that are measured on --model oracle.
      hidden: Hidden effect of the plant beyond its MJCF: torque_speed:2 is twice its typical size. Or the
        path of an adopted plant.
      watch: Show it live on a display.
      film: Make a video of the first episode.
      video: Output file of the video; navigate-<model>-<seed>.mp4 by default.
      logs: Output folder: each episode as CSV, in the format of a robot's log.
    """
    from flywheel.cli.driving.driver import PlantDriver
    from flywheel.data.recordings import write_recording
    from flywheel.files import file_name
    from flywheel.runtime.pool.progress import console_progress

    out, progress = console(), console_progress()
    video = (video or Path(f"navigate-{file_name(model)}-{asked.seed}.mp4")) if film else None
    place = checked_source(source, asked, logs, video)
    driver = PlantDriver(place, overrides, model, hidden, controller)
    left = asked.left(there := asked.there(), driver.setting)
    log_of = new_logs(logs, model, left) if logs else {}
    for number, each in enumerate(asked.seeds):
        if each not in left:
            out.say(f"Seed {each} is in {asked.results} already.")
            continue
        with progress.stage(f"navigate {number + 1}/{asked.episodes}", 1.0) as stage:
            drive, episode = driver.drive(each, stage, watch)
        there.append(drive)
        if each in log_of:
            write_recording(episode, log_of[each], driver.robot)
        asked.keep(drive)
        out.print(f"Seed {each}: {_ending(drive)}", highlight=False)
        if video and number == 0:
            _film(out, progress, driver, episode, each, video)
    show_drives(out, there, asked.picture)


def checked_source(
    source: str, asked: EpisodesOptions, logs: Path | None, video: Path | None = None
) -> Path:
    """The folder of a run, or the file of a configuration; checks the outputs before minutes of driving.

    Raises:
      ConfigError: there is no such configuration.
      DataError: an output cannot be written.
      RunError: the disk is full.
    """
    from flywheel.outputs import check_folder, check_outputs
    from flywheel.runtime.config.shipped import config_file

    place = Path(source) if Path(source).is_dir() else config_file(source)
    outputs = {"results": asked.results, "picture": asked.picture, "video": video}
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

    try:
        with progress.stage("film", 1.0) as stage:
            driver.film(seed, episode, path, stage)
        out.say(f"Video: {path}")
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
