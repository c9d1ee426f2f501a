"""Figures about reaching goals: success, times, paths from above, planning time."""

from __future__ import annotations

import math
import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from scipy.spatial import ConvexHull

from flywheel.records import Floats
from flywheel.reports import style
from flywheel.results import Navigation, RunResult
from flywheel.robots import Box

Series = list[tuple[str, str, Navigation]]
WIDTH = 9.6  # of paths from above [in]
LETTERS = 90  # of a title across all of that


def success_over_iterations(run: RunResult) -> Figure | None:
    """Success rate of both arms with 95% intervals, and of MPPI on the plant itself."""
    if not any(result.navigation for result in run.iterations):
        return None
    figure = Figure(figsize=(7.4, 3.7))
    axes = figure.subplots()
    iterations: set[int] = set()
    driven = [arm for arm in run.arms if any(i.arm == arm and i.navigation for i in run.iterations)]
    for shift, arm in enumerate(reversed(driven)):
        results = [result for result in run.of_arm(arm) if result.navigation is not None]
        places = [result.iteration for result in results]
        iterations |= set(places)
        counts = [result.navigation.success for result in results if result.navigation is not None]
        rates = np.array([100 * count.rate for count in counts])
        ends = 100 * np.array([count.interval for count in counts]).reshape(-1, 2).T
        axes.errorbar(
            np.array(places) + 0.03 * (2 * shift - 1) * (len(driven) > 1),
            rates,
            yerr=np.abs(ends - rates),
            marker=style.ARM_MARKERS[arm],
            color=style.ARM_COLOURS[arm],
            label=style.ARM_NAMES[arm],
            capsize=4,
            elinewidth=1.2,
        )
    if run.oracle is not None:
        count = run.oracle.success
        name = f"oracle: MPPI on the plant ({count.reached}/{count.total})"
        axes.axhline(100 * count.rate, label=name, **style.ORACLE_LINE)
        low, high = count.interval
        axes.axhspan(100 * low, 100 * high, color=style.ORACLE, alpha=0.1, linewidth=0)
    style.whole_steps(axes, sorted(iterations))
    axes.set_ylim(-3, 103)
    axes.set_ylabel("goals reached in time [%]")
    style.legend_above(figure, axes)
    return figure


def times_to_goal(run: RunResult) -> Figure | None:
    """Each episode's time to the goal, the median, and the number of misses."""
    series = _series(run)
    if not series:
        return None
    figure = Figure(figsize=(max(4.5, 1.0 + 1.1 * len(series)), 3.9))
    axes = figure.subplots()
    allowed = max(navigation.seconds_allowed for _, _, navigation in series)
    for place, (_, colour, navigation) in enumerate(series):
        _times(axes, place, colour, navigation, allowed)
    axes.axhline(allowed, color=style.FAINT, linewidth=1)
    axes.set_xticks(range(len(series)), [name for name, _, _ in series])
    axes.set_xlim(-0.6, len(series) - 0.4)
    axes.set_ylim(0, 1.22 * allowed)
    axes.set_ylabel("time to the goal [s]")
    axes.grid(visible=False, axis="x")
    return figure


def walks(run: RunResult) -> Figure | None:
    """Paths of all evaluation episodes from above, with their goals."""
    return paths_from_above(_series(run))


def unseen_courses(run: RunResult) -> Figure | None:
    """Paths on courses that no model was trained on: a row each, the champion's and the oracle's."""
    rows = [
        [(f"{u.course}\n", style.MPPI, u.navigation)]
        + ([(f"{u.course},\noracle", style.ORACLE, u.oracle)] if u.oracle is not None else [])
        for u in run.unseen
    ]
    if not rows:
        return None
    figure = Figure(figsize=(WIDTH, 5.0 * len(rows)))
    for index, series in enumerate(rows):
        course = _course(series)
        middle, reach = _frame(series, course)
        for place, (name, _, navigation) in enumerate(series):
            axes = figure.add_subplot(len(rows), 2, 2 * index + place + 1)
            axes.set_title(_titled(name, navigation, 2))
            _seen_from_above(axes, navigation, course, middle, reach)
            axes.set_xlabel("x [m]")
            axes.set_ylabel("y [m]")
    return figure


def paths_from_above(drivers: Series) -> Figure | None:
    """Paths of some drivers, side by side, with their goals; None if there are none.

    On a course in place, among its obstacles; elsewhere moved to a common start.

    Args:
      drivers: name, colour and episodes of each.
    """
    series = [(n, c, v) for n, c, v in drivers if any(walk.path for walk in v.walks)]
    if not series:
        return None
    course = _course(series)
    columns = min(len(series), 4 if len(series) in (4, 7, 8) else 3)
    rows = math.ceil(len(series) / columns)
    titles = [_titled(name, navigation, columns) for name, _, navigation in series]
    lines = 1 + max(title.count("\n") for title in titles)
    height = (WIDTH / columns + 0.15 + 0.2 * lines) * rows
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for place, axes in enumerate(grid.flat):
        axes.set_visible(place < len(series))
        if place + columns >= len(series):  # nothing below it
            axes.set_xlabel("x [m]" if course else "x - start [m]")
            axes.tick_params(labelbottom=True)
    middle, reach = _frame(series, course)
    for axes, title, (_, _, navigation) in zip(grid.flat, titles, series, strict=False):
        axes.set_title(title)
        _seen_from_above(axes, navigation, course, middle, reach)
    for axes in grid[:, 0]:
        axes.set_ylabel("y [m]" if course else "y - start [m]")
    return figure


def planning_times(run: RunResult) -> Figure | None:
    """Planning time, over all iterations of the MPPI arm, and for the oracle."""
    own = [s for i in run.of_arm("mppi") if i.navigation for s in i.navigation.plan_seconds]
    oracle = run.oracle.plan_seconds if run.oracle is not None else ()
    if not own:
        return None
    figure = Figure(figsize=(6.6, 3.3))
    axes = figure.subplots()
    highest = 1000 * float(np.quantile([*own, *oracle], 0.995))
    bins = np.linspace(0, 1.05 * highest, 50)
    for seconds, colour, name in (
        (own, style.MPPI, "on the learned model"),
        (oracle, style.ORACLE, "on the plant"),
    ):
        if len(seconds):
            middle, late = 1000 * np.quantile(seconds, [0.5, 0.95])
            label = f"{name}: median {middle:.0f} ms, 95% under {late:.0f} ms"
            axes.hist(
                1000 * np.array(seconds),
                bins.tolist(),
                color=colour,
                alpha=0.55,
                label=label,
                density=True,
            )
            axes.axvline(middle, color=colour, linewidth=1.6)
    axes.set_xlabel("wall time of one plan [ms]")
    axes.set_yticks([])
    axes.set_ylabel("share of plans")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2))
    return figure


def _series(run: RunResult) -> Series:
    """(label, colour, episodes): the MPPI arm's iterations, the control arm's last, the oracle."""
    series: Series = [
        (f"iteration\n{result.iteration}", style.MPPI, result.navigation)
        for result in run.of_arm("mppi")
        if result.navigation is not None
    ]
    control = [result for result in run.iterations if result.arm == "control" and result.navigation]
    if control and control[-1].navigation is not None:
        name = f"control arm\n{control[-1].iteration}"
        series.append((name, style.CONTROL, control[-1].navigation))
    if run.oracle is not None:
        series.append(("oracle\n", style.ORACLE, run.oracle))
    return series


def _times(axes: Axes, place: int, colour: str, navigation: Navigation, allowed: float) -> None:
    times = np.array(navigation.seconds_to_goal)
    spread = np.linspace(-0.16, 0.16, max(1, len(times)))
    order = np.random.default_rng(place).permutation(len(times))
    axes.plot(place + spread[order], times, "o", color=colour, alpha=0.55, markersize=4.5)
    if len(times):
        middle = float(np.median(times))
        axes.plot([place - 0.28, place + 0.28], [middle, middle], color=style.INK, linewidth=2.2)
        axes.text(place + 0.31, middle, f"{middle:.0f}", va="center", fontsize=9)
    missed = navigation.success.total - len(times)
    note = f"{missed} missed" if missed else "none missed"
    axes.text(place, 1.04 * allowed, note, ha="center", va="bottom", fontsize=8.5, color=style.INK)


def _titled(name: str, navigation: Navigation, columns: int) -> str:
    """Name and success of the driver, above one of so many panels."""
    count = navigation.success
    title = f"{' '.join(name.split())}: {count.reached}/{count.total}"
    return textwrap.fill(title, LETTERS // columns)


def _seen_from_above(
    axes: Axes, navigation: Navigation, course: tuple[Box, ...], middle: Floats, reach: float
) -> None:
    """One driver's paths, in a square around (2,) of given half width [m]."""
    _obstacles(axes, course)
    _paths(axes, navigation, bool(course))
    axes.set(aspect="equal")
    axes.set_xlim(middle[0] - reach, middle[0] + reach)
    axes.set_ylim(middle[1] - reach, middle[1] + reach)


def _course(series: Series) -> tuple[Box, ...]:
    """The common obstacles of all episodes; none if these differ."""
    found = {walk.obstacles for _, _, navigation in series for walk in navigation.walks}
    return found.pop() if len(found) == 1 else ()


def _obstacles(axes: Axes, boxes: tuple[Box, ...]) -> None:
    for box in boxes:
        seen = box.corners[:, :2]
        outline = seen[ConvexHull(seen).vertices]
        axes.add_patch(Polygon(outline, color=style.FAINT, zorder=1.8))


def _paths(axes: Axes, navigation: Navigation, absolute: bool) -> None:
    for walk in navigation.walks:
        if not walk.path:
            continue
        path = np.array(walk.path[:: len(walk.path) // 60 + 1] + walk.path[-1:])
        origin = np.zeros(2) if absolute else path[0]
        goal, path = np.array(walk.goal) - origin, path - origin
        colour, dashes = (style.MPPI, "-") if walk.reached else (style.MISSED, "--")
        axes.plot(*path.T, dashes, color=colour, linewidth=1.1, alpha=0.85)
        size = max(navigation.tolerance, 0.05)
        axes.add_patch(Circle(tuple(goal), size, fill=walk.reached, color=colour, alpha=0.3))
        axes.add_patch(Circle(tuple(goal), size, fill=False, color=colour, linewidth=0.9))
        axes.plot(*path[0], "k+", markersize=8)


def _frame(series: Series, course: tuple[Box, ...]) -> tuple[Floats, float]:
    """Middle (2,) and half width [m] of a square around all drawn items."""
    walks = [walk for _, _, navigation in series for walk in navigation.walks if walk.path]
    room = max(navigation.tolerance for _, _, navigation in series)
    if not course:
        places = [np.array([*walk.path, walk.goal]) - np.array(walk.path[0]) for walk in walks]
        return np.zeros(2), 1.08 * (room + max(float(np.abs(p).max()) for p in places))
    seen = [np.array([*walk.path, walk.goal]) for walk in walks]
    boxes = [corner[:2] for box in course for corner in box.corners]
    everything = np.concatenate([*seen, boxes])
    low, high = everything.min(axis=0), everything.max(axis=0)
    return (low + high) / 2, 1.04 * (room + float((high - low).max()) / 2)
