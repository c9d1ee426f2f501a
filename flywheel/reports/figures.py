"""All figures of a run, by name."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from flywheel.outputs import write_output
from flywheel.registry import lookup
from flywheel.reports import error_figures, goal_figures, ladder_figures, robot_figures
from flywheel.reports.pictures import Picture, as_file
from flywheel.results import RunResult

FIGURES: dict[str, Picture[RunResult]] = {
    "robot": Picture(
        robot_figures.on_the_robot,
        "On the robot",
        "Left: predictions of the robot's held-out recordings, which were not used for learning, "
        "by the unchanged MJCF, by the plant with the identified effects, and by the network; "
        "the dashed green line is the measurement noise. Right: goals reached by MPPI on the "
        "robot with each of them, with Wilson's 95% interval.",
    ),
    "success": Picture(
        goal_figures.success_over_iterations,
        "Goals reached",
        "Fraction of the evaluation tasks reached in time, with Wilson's 95% interval. The same "
        "tasks in every iteration and arm. Iteration 0 is common to both arms.",
    ),
    "errors": Picture(
        error_figures.error_over_iterations,
        "Prediction errors over iterations",
        "Test episodes are never trained on. The floors are the plant itself, restarted from the "
        "model's inputs: with the invisible roll of the rods drawn at random, and (informed) "
        "computed from the cables by exact parameters.",
    ),
    "ladder": Picture(
        ladder_figures.ladder_over_iterations,
        "Progress on the recordings",
        "Left: the plant of the simulated data, with the starts of all windows fitted; a step "
        "down is labelled with the effect added by a diagnosis. Right: the networks trained on "
        "it, predicting from measurements.",
    ),
    "lead-time": Picture(
        error_figures.error_by_lead_time,
        "Prediction errors by lead time",
        "MPPI arm, light to dark from the first to the last iteration. Dashed: the floors. "
        "Dotted: the prediction without motion.",
    ),
    "walks": Picture(
        goal_figures.walks,
        "Paths of the robot",
        "Every evaluation episode from above, on a course among its obstacles, elsewhere moved "
        "to a common start (+). Blue, solid: reached its goal (circle, drawn to its tolerance). "
        "Orange, dashed: did not.",
    ),
    "unseen": Picture(
        goal_figures.unseen_courses,
        "Courses that no model was trained on",
        "The last champion's paths, and those of MPPI that knows the plant.",
    ),
    "times": Picture(
        goal_figures.times_to_goal,
        "Time to the goal",
        "One dot per episode that reached its goal; the bar is their median. The grey line is "
        "the time limit.",
    ),
    "overlay": Picture(
        error_figures.overlay,
        "One prediction, from above",
        "A test window at three moments, faint to strong. Right: distances of the predicted from "
        "the measured end caps (grey: each; orange: their mean).",
    ),
    "training": Picture(
        error_figures.training_curves,
        "Training",
        "Left: training loss. Right: rotation error of rollouts on validation episodes.",
    ),
    "planning": Picture(
        goal_figures.planning_times,
        "Planning time",
        "Wall time of one MPPI plan in closed loop, all iterations together; lines are medians.",
    ),
}


def draw(name: str, run: RunResult, format: Literal["svg", "png"] = "svg") -> bytes | None:
    """One figure as a file's bytes, the same for the same run; None without data.

    Raises:
      UnknownNameError: no such figure.
    """
    picture = lookup(FIGURES, name, "figure")
    return as_file(lambda: picture.draw(run), format)


def write_figures(run: RunResult, folder: str | Path) -> list[Path]:
    """Write every figure with data as `<folder>/<name>.png`."""
    folder = Path(folder)
    written = []
    for name in FIGURES:
        if (content := draw(name, run, "png")) is not None:
            path = folder / f"{name}.png"
            written.append(write_output(path, content))
    return written
