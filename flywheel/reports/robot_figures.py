"""Results of a run on its robot: errors and success of each model, over iterations and robot time."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flywheel.reports import style
from flywheel.results import RunResult

NAMES = {
    "given": "MJCF as given",
    "plant": "MJCF with identified effects",
    "residual": "residual model (plant and network)",
    "network": "network",
}
COLOURS = {
    "given": style.FLOOR,
    "plant": style.INFORMED,
    "residual": style.CONTROL,
    "network": style.MPPI,
}
MARKERS = {"given": "", "plant": "s", "residual": "D", "network": "o"}


def on_the_robot(run: RunResult) -> Figure | None:
    """Errors on the robot's held-out recordings, and goals reached on it, over iterations."""
    results = [result for result in run.of_arm("mppi") if result.robot is not None]
    if not results:
        return None
    figure = Figure(figsize=(9.6, 4.0))
    errors, goals = figure.subplots(1, 2, width_ratios=(1.25, 1))
    _errors(errors, run)
    _goals(goals, run)
    for axes in (errors, goals):
        style.whole_steps(axes, [result.iteration for result in results])
        minutes = {r.iteration: r.robot.minutes for r in results if r.robot is not None}
        labels = [f"{i}\n{minutes[i]:.1f} min" for i in minutes]
        axes.set_xticks(list(minutes), labels)
        axes.set_xlabel("iteration, and minutes on the robot until then")
    figure.legend(*errors.get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return figure


def _errors(axes: Axes, run: RunResult) -> None:
    last = max(result.iteration for result in run.of_arm("mppi"))
    for model, name in NAMES.items():
        found = {i: e.short.e_pos_rmse for i, e in run.robot_errors(model).items()}
        found = {i: error for i, error in found.items() if math.isfinite(error)}
        if not found:
            continue
        if model == "given":
            value = found[max(found)]
            axes.axhline(
                value, label=name, color=COLOURS[model], linestyle=(0, (5, 2)), linewidth=1.6
            )
            continue
        axes.plot(
            list(found),
            list(found.values()),
            marker=MARKERS[model],
            color=COLOURS[model],
            label=name,
        )
    _name_steps(axes, run)
    noise = run.robot_noise or next(
        (t.robot.noise for t in reversed(run.of_arm("mppi")) if t.robot and t.robot.noise), None
    )
    if noise is not None:
        axes.axhline(noise.e_pos_rmse, label="noise", **style.ORACLE_LINE)
    axes.set_xlim(-0.12, last + 0.12)
    style.logarithmic(axes.yaxis)
    axes.set_title("Errors on held-out recordings")
    axes.set_ylabel("e_pos RMSE/L [%]")


def _name_steps(axes: Axes, run: RunResult) -> None:
    """Labels of the effects added to the plant, at their iterations."""
    plant = {i: e.short.e_pos_rmse for i, e in run.robot_errors("plant").items()}
    for result in run.of_arm("mppi"):
        note = result.diagnosis
        if note is None or not note.adopted or result.iteration not in plant:
            continue
        before = {effect.label for effect in run.effects_before(result.iteration)}
        added = [e.label for e in note.effects if e.label not in before] or ["fitted anew"]
        axes.annotate(
            "\n".join(f"+ {name}" for name in added),
            (result.iteration, plant[result.iteration]),
            xytext=(0, -8),
            textcoords="offset points",
            ha="right" if result.iteration else "left",
            va="top",
            color=COLOURS["plant"],
            fontsize="small",
        )


def _goals(axes: Axes, run: RunResult) -> None:
    results = [result for result in run.of_arm("mppi") if result.robot is not None]
    planners = dict.fromkeys(p for r in results if r.robot for p in r.robot.drives)
    for number, planner in enumerate(planners):
        counts = {
            r.iteration: r.robot.drives[planner].success
            for r in results
            if r.robot is not None and planner in r.robot.drives
        }
        places = np.array(list(counts)) + 0.04 * (number - (len(planners) - 1) / 2)
        rates = np.array([100 * count.rate for count in counts.values()])
        ends = 100 * np.array([count.interval for count in counts.values()]).reshape(-1, 2).T
        axes.errorbar(
            places,
            rates,
            yerr=np.abs(ends - rates),
            marker=MARKERS[planner] or "^",
            color=COLOURS[planner],
            capsize=4,
            elinewidth=1.2,
        )
    axes.set_ylim(-3, 103)
    axes.set_title("Goals reached on the robot")
    axes.set_ylabel("reached in time [%]")
