"""The page of a run: one self-contained HTML file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import yaml

from flywheel.outputs import write_output
from flywheel.reports.conclusions import conclusions, headline
from flywheel.reports.figures import FIGURES, write_figures
from flywheel.reports.html import Shown, data_uri, render
from flywheel.reports.pictures import shown
from flywheel.reports.robot_figures import NAMES
from flywheel.results import Errors, IterationResult, Navigation, RunResult

PAGE_FILE = "report.html"
PATHS = "on the ground the planner's predicted paths"
LARGEST_VIDEO = 16 * 2**20  # bytes; a page has to be mailed around

LIMITS = (
    "One seed: differences between iterations of one run do not carry over to other seeds.",
    "Position errors are squared distances of centres of mass: MSE/L has the unit of a length "
    "and is shown times 100, RMSE/L is a fraction of the robot's characteristic length L.",
    "Intervals are Wilson's, at 95%; they cover the choice of tasks, not that of the training.",
)


@dataclass(frozen=True)
class Row:
    """A line of the table of results; every cell is ready for display."""

    name: str
    kind: str
    episodes: str = ""
    short_position: str = ""
    short_rotation: str = ""
    full_position: str = ""
    full_rotation: str = ""
    success: str = ""
    seconds: str = ""
    champion: str = ""


def write_report(run: RunResult, folder: str | Path) -> list[Path]:
    """Write the page and, as `figures/*.png`, its figures; returns all of these files."""
    folder = Path(folder)
    return [write_page(folder, run), *write_figures(run, folder / "figures")]


def write_page(folder: str | Path, run: RunResult | None = None) -> Path:
    """Write `<folder>/report.html` about a run, finished or not.

    Args:
      folder: of the run; contains its videos.
      run: by default from the folder's `result.json`.

    Raises:
      DataError: the folder contains no run.
    """
    folder = Path(folder)
    page = render_page(run or RunResult.load(folder), folder)
    return write_output(folder / PAGE_FILE, page)


def render_page(run: RunResult, folder: Path) -> str:
    """The page as text.

    Args:
      run: to show.
      folder: that the videos' paths are relative to.
    """
    return render(
        "page",
        run=run,
        headline=headline(run),
        verdicts=conclusions(run),
        rows=result_rows(run),
        robot_rows=robot_rows(run),
        robot_time=robot_time(run),
        figures=shown(FIGURES, run),
        videos=_videos(run, folder),
        config=yaml.safe_dump(run.config, sort_keys=False, allow_unicode=True),
        stages=list(dict.fromkeys(s for result in run.iterations for s in result.seconds)),
        limits=[*run.notes, *_missing(run), *LIMITS],
    )


def result_rows(run: RunResult) -> list[Row]:
    """Every iteration of both arms, then the lines for comparison."""
    rows = [_iteration_row(run, result) for arm in run.arms for result in run.of_arm(arm)
            if result.arm == arm]  # fmt: skip
    beside: list[tuple[str, Errors | None, Navigation | None]] = [
        ("floor: plant restarted from the same observations", run.floor, None),
        ("informed floor: its roll computed from the cables", run.informed_floor, None),
        ("nothing moves", run.persistence, None),
        ("oracle: MPPI on the plant", None, run.oracle),
        *((f"{u.course}, never seen", None, u.navigation) for u in run.unseen),
        *((f"{u.course}: MPPI on the plant", None, u.oracle) for u in run.unseen),
        *(
            (f"{_name(result)}, on recordings", result.recordings, None)
            for result in run.iterations
        ),
        ("nothing moves, on recordings", run.persistence_on_recordings, None),
    ]
    for name, errors, navigation in beside:
        if errors is not None or navigation is not None:
            rows.append(Row(name, "beside", **_errors(errors), **_goals(navigation)))
    return rows


@dataclass(frozen=True)
class RobotRow:
    """A line of the table about the robot; every cell is ready for display."""

    iteration: str
    minutes: str
    model: str
    one_second: str
    short: str
    rotation: str
    success: str = ""
    seconds: str = ""


def robot_rows(run: RunResult) -> list[RobotRow]:
    """Results of each model of each iteration on the robot; empty for a run without one."""
    rows = []
    for result in run.of_arm("mppi"):
        if (robot := result.robot) is None:
            continue
        for model in (name for name in NAMES if name in robot.errors):
            errors = run.robot_errors(model).get(result.iteration, robot.errors[model])
            goals = _goals(robot.drives.get(model))
            one = errors.at(1.0)
            rows.append(
                RobotRow(
                    str(result.iteration),
                    f"{robot.minutes:.1f}",
                    NAMES[model],
                    "–" if one is None else _number(one),
                    _number(errors.short.e_pos_rmse),
                    _number(errors.short.e_rot),
                    goals.get("success", ""),
                    goals.get("seconds", ""),
                )
            )
    return rows


def robot_time(run: RunResult) -> list[str]:
    """Robot time needed by each model, as sentences."""
    sentences = []
    for model in ("plant", "residual", "network"):
        if (minutes := run.minutes_to_best(model)) is not None:
            in_all = max(s.minutes for s in run.on_robot if s.model == model)
            sentences.append(
                f"Robot time of the {NAMES[model]}: {minutes:.1f} minutes until its error was within 1.1 "
                f"times its least, of {in_all:.1f} minutes in all."
            )
    return sentences


def _iteration_row(run: RunResult, result: IterationResult) -> Row:
    champion = ""
    if result.gate is not None:
        champion = "yes" if result.gate.promoted else "no"
    return Row(
        _name(result),
        result.arm,
        episodes=str(result.episodes),
        champion=champion,
        **_errors(run.test_errors(result)),
        **_goals(result.navigation),
    )


def _name(result: IterationResult) -> str:
    return f"iteration {result.iteration}" + ("" if result.arm == "mppi" else ", control arm")


def _errors(errors: Errors | None) -> dict[str, str]:
    cells: dict[str, str] = {}
    if errors is not None:
        for kind, numbers in (("short", errors.short), ("full", errors.full)):
            if numbers is not None and numbers.diverged:
                cells |= {f"{kind}_position": "diverged", f"{kind}_rotation": "diverged"}
            elif numbers is not None:
                position = f"{_number(numbers.e_pos_rmse)} ({_number(numbers.e_pos_mse)})"
                cells[f"{kind}_position"] = position
                cells[f"{kind}_rotation"] = _number(numbers.e_rot)
    return cells


def _goals(navigation: Navigation | None) -> dict[str, str]:
    if navigation is None:
        return {}
    success = navigation.success
    low, high = (100 * end for end in success.interval)
    return {
        "success": f"{success.reached}/{success.total} ({low:.0f} to {high:.0f}%)",
        "seconds": _number(navigation.median_seconds),
    }


def _number(value: float) -> str:
    """Three significant digits, never in powers of ten; a dash for NaN."""
    if math.isnan(value):
        return "–"
    if math.isinf(value) or abs(value) >= 1e6:
        return f"{value:g}"
    digits = 2 - math.floor(math.log10(abs(value))) if value else 1
    return f"{value:.{min(max(digits, 0), 4)}f}"


def _videos(run: RunResult, folder: Path) -> list[Shown]:
    """Videos of the first and last iterations of the MPPI arm that have one, and of unseen courses."""
    results = [
        result
        for result in run.of_arm("mppi")
        if result.video and (folder / result.video).is_file()
    ]
    chosen = results if len(results) < 2 else [results[0], results[-1]]
    films = [(f"Iteration {result.iteration}", result.video, _who(result)) for result in chosen]
    films += [
        (
            f"{unseen.course}, never seen",
            unseen.video,
            f"MPPI on the last champion's model; {PATHS}",
        )
        for unseen in run.unseen
        if unseen.video and (folder / unseen.video).is_file()
    ]
    return [_video(folder, *film) for film in films]


def _who(result: IterationResult) -> str:
    """The driver in the video of an iteration."""
    if result.robot is not None:
        return f"The robot as measured, MPPI on model {result.robot.filmed}"
    return f"MPPI on this iteration's model; {PATHS}"


def _video(folder: Path, title: str, name: str, who: str) -> Shown:
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        return Shown(title, title, f"Not shown: {name} lies outside the run's folder.", "")
    if path.stat().st_size > LARGEST_VIDEO:
        return Shown(title, title, f"Too large for this page: see {name}.", "")
    return Shown(title, title, f"{who} ({path.name}).", data_uri(path.read_bytes(), "video/mp4"))


def _missing(run: RunResult) -> list[str]:
    """Missing results of this run, because they were not measured (yet)."""
    sentences = []
    if not run.finished:
        sentences.append("The run has not ended: the measurements at its end are missing here.")
    if not run.pooled:
        sentences.append(
            "Test errors are on the test episodes that each iteration had, not on common ones: "
            "they are not strictly comparable."
        )
    if run.floor is None:
        sentences.append("No floor was measured: the smallest possible errors are unknown.")
    if run.oracle is None:
        sentences.append("No oracle was run: the number of reachable goals is unknown.")
    if "control" not in run.arms:
        sentences.append("No control arm: more data and more training alone may explain a gain.")
    return sentences
