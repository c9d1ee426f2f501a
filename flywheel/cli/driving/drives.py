"""Results of closed-loop episodes: a file with a line each, a table, and a picture from above."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError
from rich.table import Table

from flywheel.cli.console import table
from flywheel.errors import DataError
from flywheel.evaluation.intervals import success_interval
from flywheel.files import MB, read_text
from flywheel.outputs import write_output
from flywheel.reports import style
from flywheel.reports.goal_figures import paths_from_above
from flywheel.reports.pictures import as_file
from flywheel.results import Navigation, ResultRecord, Walk

LARGEST_RESULTS = 500 * MB  # [bytes]; an episode takes some kB


class Setting(ResultRecord):
    """Setting of a drive. Episodes of equal settings may be counted together.

    Attributes:
      robot, task, course: names; "" for no course.
      mjcf: digest of the robot; "" for a shipped one.
      terrain: kinds of drawn ground; none for the plane.
      model: "champion", "oracle", or an iteration.
      controller: "mppi" or "astar".
      digest: of its weights; "" for the oracle.
      effects: known effects of the plant, beyond the MJCF.
      hidden: its true effects; none if they are the same.
      fineness: ratio of the MJCF's time step to the plant's.
      samples, horizon_seconds: of MPPI.
      threads: of the planner.
      config: digest of the configuration.
      link: to the robot, with the sensors of a stand-in; "" for a plant.
    """

    robot: str
    mjcf: str = ""
    task: str
    course: str = ""
    terrain: tuple[str, ...] = ()
    model: str
    controller: str = "mppi"
    digest: str = ""
    effects: tuple[str, ...] = ()
    hidden: tuple[str, ...] = ()
    fineness: int = 1
    samples: int
    horizon_seconds: float
    threads: int
    config: str
    link: str = ""


class DriveLine(ResultRecord):
    """One episode.

    Attributes:
      setting: of the drive.
      seed: of task and planner.
      walk: seen from above, with its end.
      seconds_allowed, tolerance: of the task [s], [m].
      plan_seconds: median and 95 % quantile of a plan's time [s].
      cpu_seconds: of the whole episode, in all threads.
    """

    setting: Setting
    seed: int
    walk: Walk
    seconds_allowed: float
    tolerance: float
    plan_seconds: tuple[float, float]
    cpu_seconds: float


def read_drives(path: Path) -> list[DriveLine]:
    """The episodes of a file, without repetitions as of two processes; empty without a file.

    Raises:
      DataError: a line is not an episode.
    """
    if not path.exists():
        return []
    found: dict[tuple[int, Setting], DriveLine] = {}
    lines = read_text(path, "results", DataError, LARGEST_RESULTS).splitlines()
    for number, line in enumerate(lines, 1):
        try:
            drive = DriveLine.model_validate_json(line)
        except ValidationError as error:
            raise DataError(
                f"{path}, line {number}, is not an episode of `navigate`: {error}"
            ) from None
        found.setdefault((drive.seed, drive.setting), drive)
    return list(found.values())


def append_drive(path: Path, drive: DriveLine) -> None:
    """Append a line immediately, so that it survives later failures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(drive.model_dump_json() + "\n")


def drive_table(drives: Sequence[DriveLine]) -> Table:
    """One row per setting."""
    columns = ["who", "where", "hidden", "reached", "95 %", "median [s]", "slowest [s]"]
    columns += ["plan, median [s]", "95 % below [s]", "CPU [s]"]
    return table("", columns, [_row(group) for group in _groups(drives)])


def drive_picture(drives: Sequence[DriveLine], path: Path) -> None:
    """Paths from above, one picture per setting.

    Raises:
      DataError: there is no path to draw.
    """
    series = [
        (_title(group[0].setting), style.MPPI, _navigation(group)) for group in _groups(drives)
    ]
    image = as_file(lambda: paths_from_above(series), "png")
    if image is None:
        raise DataError("None of these episodes has a path to draw.")
    write_output(path, image)


def _groups(drives: Sequence[DriveLine]) -> list[list[DriveLine]]:
    groups: dict[str, list[DriveLine]] = {}
    for drive in drives:
        groups.setdefault(drive.setting.model_dump_json(), []).append(drive)
    return list(groups.values())


def _navigation(drives: Sequence[DriveLine]) -> Navigation:
    return Navigation(
        controller=drives[0].setting.model,
        walks=tuple(drive.walk for drive in drives),
        seconds_allowed=drives[0].seconds_allowed,
        tolerance=drives[0].tolerance,
    )


def _row(drives: Sequence[DriveLine]) -> list[object]:
    setting, navigation = drives[0].setting, _navigation(drives)
    count, seconds = navigation.success, navigation.seconds_to_goal
    interval = success_interval(count.reached, count.total, method="exact")
    middle, late = np.median([drive.plan_seconds for drive in drives], axis=0)
    return [
        _who(setting),
        where_of(setting),
        ", ".join(setting.hidden) or None,
        f"{count.reached} of {count.total}",
        f"{100 * interval.low:.0f}-{100 * interval.high:.0f} %",
        navigation.median_seconds,
        seconds[-1] if seconds else None,
        float(middle),
        float(late),
        float(sum(drive.cpu_seconds for drive in drives)),
    ]


def _who(setting: Setting) -> str:
    """The controller unless it is MPPI, and its model."""
    controller = "" if setting.controller == "mppi" else f"{setting.controller}, "
    return f"{controller}{setting.model} {setting.digest[:8]}".strip()


def where_of(setting: Setting) -> str:
    """The course or the task, and uneven ground."""
    ground = f" on {', '.join(setting.terrain)}" if setting.terrain else ""
    return f"{setting.course or setting.task}{ground}"


def _title(setting: Setting) -> str:
    told = f", told {', '.join(setting.effects)}" if setting.effects else ""
    hidden = f", hidden {', '.join(setting.hidden)}" if setting.hidden else ""
    return f"{_who(setting)}, {where_of(setting)}{told}{hidden}"
