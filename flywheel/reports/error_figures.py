"""Figures about prediction: errors by lead time, errors over iterations, training, one overlay."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flywheel.reports import style
from flywheel.results import Errors, IterationResult, Overlay, RunResult

MEASURES = (("e_pos_rmse", "position error, RMSE/L [%]"), ("e_rot", "rotation error [deg]"))


def error_by_lead_time(run: RunResult) -> Figure | None:
    """Growth of errors with lead time, for each iteration's model of the MPPI arm."""
    results = [(i, e) for i in run.of_arm("mppi") if (e := run.test_errors(i)) and e.by_lead_time]
    if not results:
        return None
    figure, measures = Figure(figsize=(9.2, 3.6)), _measures(run)
    (row,) = figure.subplots(1, len(measures), squeeze=False)
    for axes, (measure, label) in zip(row, measures, strict=True):
        for index, (result, errors) in enumerate(results):
            colour = style.iteration_colour(index, len(results))
            name = f"iteration {result.iteration}"
            _by_lead_time(axes, errors, measure, color=colour, label=name, zorder=3 + index)
        top = max(max(getattr(e.by_lead_time, measure)) for _, e in results if e.by_lead_time)
        for name, floor, line in _floors(run):
            _by_lead_time(axes, floor, measure, label=name, zorder=9, **line)
        if run.persistence is not None:
            line = style.PERSISTENCE_LINE
            _by_lead_time(axes, run.persistence, measure, label="nothing moves", **line)
        axes.set_xlabel("lead time [s]")
        axes.set_ylabel(label)
        axes.set_xlim(left=0)
        axes.set_ylim(0, 1.15 * top)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right center")
    return figure


def error_over_iterations(run: RunResult) -> Figure | None:
    """Short-horizon and full-trajectory errors of both arms, with the floors."""
    if not any(run.test_errors(i) for i in run.iterations):
        return None
    figure, measures = Figure(figsize=(9.2, 6.2)), _measures(run)
    grid = figure.subplots(2, len(measures), squeeze=False)
    for row, kind in zip(grid, ("short", "full"), strict=True):
        for axes, (measure, label) in zip(row, measures, strict=True):
            _error_lines(axes, run, kind, measure)
            axes.set_ylabel(label)
            axes.set_ylim(0, 1.08 * axes.get_ylim()[1])
        horizon = "short horizon" if kind == "short" else "full trajectory"
        row[0].set_title(f"{horizon}, on test episodes")
    style.legend_above(figure, grid[0][0])
    return figure


def training_curves(run: RunResult) -> Figure | None:
    """Training loss and validation error of each iteration of the MPPI arm.

    The error is that of rotations, or of positions if orientation is not observable.
    """
    results = [i for i in run.of_arm("mppi") if i.curve]
    if not results:
        return None
    figure = Figure(figsize=(9.2, 3.4))
    loss, validation = figure.subplots(1, 2)
    measure, label = _measures(run)[-1]
    for index, result in enumerate(results):
        line_style = {
            "color": style.iteration_colour(index, len(results)),
            "label": f"iteration {result.iteration}",
        }
        few = "." if len(result.curve) < 12 else ""
        losses = [point.loss for point in result.curve]
        loss.plot([p.step for p in result.curve], losses, marker=few, linewidth=1.5, **line_style)
        errors = [(p.step, getattr(p, f"validation_{measure}")) for p in result.curve]
        points = [(step, error) for step, error in errors if error is not None]
        validation.plot([s for s, _ in points], [e for _, e in points], marker="o", **line_style)
    if all(p.loss > 0 for result in results for p in result.curve):
        style.logarithmic(loss.yaxis)
    loss.set_ylabel("training loss")
    validation.set_ylabel(f"validation {label}")
    validation.set_ylim(0, 1.08 * validation.get_ylim()[1])
    for axes in (loss, validation):
        axes.set_xlabel("optimiser step")
        style.whole_numbers(axes.xaxis)
    loss.legend(loc="upper right")
    return figure


def overlay(run: RunResult) -> Figure | None:
    """One test window from above, measured and as predicted by the last iteration's model."""
    results = [i for i in run.of_arm("mppi") if i.overlay is not None]
    if not results:
        return None
    result = results[-1]
    assert result.overlay is not None
    figure = Figure(figsize=(9.2, 4.4))
    above, distance = figure.subplots(1, 2, width_ratios=(1.25, 1))
    _seen_from_above(above, result.overlay)
    above.set_title(f"iteration {result.iteration}, from above")
    _distances(distance, result, run.length)
    return figure


def _measures(run: RunResult) -> tuple[tuple[str, str], ...]:
    """Errors to draw: no rotations if orientation is not observable."""
    errors = [found for result in run.iterations if (found := run.test_errors(result))]
    return MEASURES[:1] if any(each.short.turnless for each in errors) else MEASURES


def _by_lead_time(axes: Axes, errors: Errors, measure: str, **line_style: Any) -> None:
    if (lead := errors.by_lead_time) is not None:
        axes.plot(lead.seconds, getattr(lead, measure), **line_style)


def _error_lines(axes: Axes, run: RunResult, kind: str, measure: str) -> None:
    iterations: set[int] = {0}
    lost: dict[int, str] = {}
    for arm in reversed(run.arms):  # the MPPI arm lies on top
        points = [
            (result.iteration, getattr(numbers, measure))
            for result in run.of_arm(arm)
            if (errors := run.test_errors(result)) and (numbers := getattr(errors, kind))
        ]
        iterations |= {iteration for iteration, _ in points}
        axes.plot(
            [k for k, _ in points],
            [e for _, e in points],
            marker=style.ARM_MARKERS[arm],
            color=style.ARM_COLOURS[arm],
            label=style.ARM_NAMES[arm],
        )
        lost |= {k: style.ARM_COLOURS[arm] for k, error in points if math.isnan(error)}
    for iteration, colour in lost.items():
        _diverged(axes, iteration, colour)
    for name, errors, line in _floors(run):
        if (floor := getattr(errors, kind)) is not None:
            axes.axhline(getattr(floor, measure), label=name, **line)
    style.whole_steps(axes, sorted(iterations))


def _diverged(axes: Axes, iteration: int, colour: str) -> None:
    """Write the reason for a missing point."""
    axes.annotate(
        "\N{MULTIPLICATION SIGN} diverged",
        (iteration, 0.93),
        xycoords=axes.get_xaxis_transform(),
        xytext=(-4, 0),
        textcoords="offset points",
        va="center",
        color=colour,
        fontsize="small",
    )


def _floors(run: RunResult) -> list[tuple[str, Errors, dict[str, Any]]]:
    """MuJoCo restarted from the same observations: name, errors and line style of each measured one."""
    floors = [
        ("floor", run.floor, style.FLOOR_LINE),
        ("informed floor", run.informed_floor, style.INFORMED_LINE),
    ]
    return [(name, errors, line) for name, errors, line in floors if errors is not None]


def _seen_from_above(axes: Axes, window: Overlay) -> None:
    measured, predicted = np.array(window.measured), np.array(window.predicted)
    frames = np.unique(np.linspace(0, len(window.seconds) - 1, 3).round().astype(int))
    for index, t in enumerate(frames):
        alpha = 0.3 + 0.7 * index / max(1, len(frames) - 1)
        for cloud, colour, dashes in ((measured, style.INK, "-"), (predicted, style.MISSED, "--")):
            for a, b in window.rods:
                ends = cloud[t, [a, b], :2].T
                axes.plot(*ends, dashes, color=colour, alpha=alpha, linewidth=1.6)
            axes.plot(*cloud[t, :, :2].T, "o", color=colour, alpha=alpha, markersize=3.5)
    for cloud, colour, dashes, name in (
        (measured, style.INK, "-", "measured"),
        (predicted, style.MISSED, "--", "predicted"),
    ):
        middle = cloud.mean(axis=1)[:, :2]
        axes.plot(*middle.T, dashes, color=colour, linewidth=2.4, label=f"{name} (centre of caps)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.14))


def _distances(axes: Axes, result: IterationResult, length: float) -> None:
    window = result.overlay
    assert window is not None
    gap = np.linalg.norm(np.array(window.predicted) - np.array(window.measured), axis=-1)
    axes.plot(window.seconds, 100 * gap / length, color=style.FAINT, linewidth=1.2)
    mean = 100 * gap.mean(axis=1) / length
    axes.plot(window.seconds, mean, color=style.MISSED, label="mean of the end caps")
    axes.set_xlabel("lead time [s]")
    axes.set_ylabel("distance predicted to measured [% of L]")
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
