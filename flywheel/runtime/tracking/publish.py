"""Logging of a run at MLflow: mapping of numbers to metrics, and of facts to tags.

One parent run stands for the whole run. Its step is the iteration, and its lines are those of the
MPPI arm. Each iteration has a child run with its training curve, errors by lead time, data, model
and files. Each line for comparison (the control arm, the floors, the oracle) is a separate run. Its
numbers have the parent's names, so that they appear in one chart; it is not a child, because MLflow
draws a child only once it has been unfolded.

The part of a metric's name before the slash is a section of MLflow's page; sections are in
alphabetical order, and named so that the most important come first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from flywheel.reports.style import COLOURS
from flywheel.results import (
    Arm,
    DiagnosisNote,
    ErrorNumbers,
    Errors,
    IterationResult,
    LeadTimes,
    Navigation,
    RobotResult,
    RunResult,
    TrainingPoint,
    UnseenCourse,
)
from flywheel.runtime.tracking.tracker import Tracker

Values = dict[str, float]


def publish_start(
    tracker: Tracker, config: Mapping[str, Any], tags: Mapping[str, str], name: str = ""
) -> None:
    """Open the run, or reopen it.

    Args:
      tracker: of the run.
      config: resolved configuration; becomes parameters.
      tags: digests and versions, e.g. {"config": ..., "robot": ..., "code": ...}; logged as
        `flywheel.<name>`.
      name: for people; the run's key by default.
    """
    prefixed = {f"flywheel.{key}": value for key, value in tags.items()}
    look = {"flywheel.kind": "run", "mlflow.runColor": COLOURS["mppi"]}
    tracker.open(tracker.key, name or tracker.key, look | prefixed)
    tracker.describe(tracker.key, params=flattened(config))


def publish_iteration_start(tracker: Tracker, iteration: int, arm: Arm = "mppi") -> None:
    """Open the run of an iteration, or reopen it."""
    name = f"iteration {iteration}" + ("" if arm == "mppi" else f" ({arm} arm)")
    tags = {"kind": "iteration", "iteration": str(iteration), "arm": arm}
    prefixed = {f"flywheel.{key}": value for key, value in tags.items()}
    tracker.open(_iteration_run(tracker, iteration, arm), name, prefixed, parent=tracker.key)


def publish_iteration(
    tracker: Tracker,
    result: IterationResult,
    *,
    files: Iterable[str | Path] = (),
    model_folder: str | Path | None = None,
    model_shape: tuple[int, int] = (0, 0),
) -> None:
    """Log everything about an iteration, end its run, and make its model champion if the gate
    decided so.

    Args:
      tracker: of the run.
      result: of the iteration.
      files: figures and videos inside the run folder.
      model_folder: inside the run folder, written by `pyfunc_model.write_model`; None logs no model.
      model_shape: (tracked points, winches) of the model's robot.
    """
    iteration, arm = result.iteration, result.arm
    child = _iteration_run(tracker, iteration, arm)
    publish_iteration_start(tracker, iteration, arm)
    values = iteration_values(result)
    tracker.log(_arm_run(tracker, arm), values, iteration)
    tracker.log(child, {f"final/{name}": value for name, value in values.items()}, iteration)
    tracker.log_rows(child, [(point.step, curve_values(point)) for point in result.curve])
    if result.test is not None and result.test.by_lead_time is not None:
        tracker.log_rows(child, lead_time_values(result.test.by_lead_time))
    tags = _tags(result)
    tracker.describe(child, tags=tags)
    profile = {"episodes": result.episodes, "steps": result.steps}
    tracker.dataset(child, f"iteration-{iteration}-{arm}", result.snapshot, profile)
    for path in files:
        tracker.artifact(child, path)
    if model_folder is not None:
        name = f"{arm}-{iteration:04d}"
        tracker.model(child, name, result.model, model_folder, model_shape, tags, iteration)
        if result.gate is not None and result.gate.promoted:
            tracker.promote(result.model, result.gate)
    tracker.end(child)


def publish_end(tracker: Tracker, result: RunResult, files: Iterable[str | Path] = ()) -> None:
    """Log the final numbers, and end the run.

    These are the pooled test errors, and the lines of the floors, the oracle and the control arm.

    Args:
      tracker: of the run.
      result: of the finished run.
      files: report, figures and videos inside the run folder.
    """
    for arm in result.arms:
        for iteration in result.of_arm(arm):
            tracker.log(_arm_run(tracker, arm), iteration_values(iteration), iteration.iteration)
            if (errors := result.pooled_errors(iteration)) is not None:
                values = error_values("error_pooled", errors)
                tracker.log(_arm_run(tracker, arm), values, iteration.iteration)
    steps = sorted({iteration.iteration for iteration in result.iterations})
    for name, floor in (("floor", result.floor), ("informed floor", result.informed_floor)):
        if floor is not None:
            _log_line(tracker, name, error_values("error_pooled", floor), steps)
    if result.oracle is not None:
        _log_line(tracker, "oracle", navigation_values(result.oracle), steps)
    for unseen in result.unseen:
        tracker.log(tracker.key, unseen_values(unseen), max(steps, default=0))
    _log_robot(tracker, result, max(steps, default=0))
    if result.persistence is not None:
        values = error_values("persistence", result.persistence)
        tracker.log(tracker.key, values, max(steps, default=0))
    for path in files:
        tracker.artifact(tracker.key, path)
    tracker.end(tracker.key)


def _log_robot(tracker: Tracker, result: RunResult, last: int) -> None:
    """Log every model's errors on all of the robot's held-out recordings, and the robot time before it."""
    for score in result.on_robot:
        values = robot_errors({score.model: score.errors}, "robot_pooled")
        tracker.log(tracker.key, values, score.iteration)
    for model in sorted({score.model for score in result.on_robot} - {"given"}):
        if (minutes := result.minutes_to_best(model)) is not None:
            tracker.log(tracker.key, {f"robot/minutes_to_best/{model}": minutes}, last)


def _tags(result: IterationResult) -> dict[str, str]:
    tags = {
        "flywheel.snapshot": result.snapshot,
        "flywheel.parent_snapshot": result.parent_snapshot,
        "flywheel.model": result.model,
        "flywheel.arm": result.arm,
        "flywheel.iteration": str(result.iteration),
    }
    if result.gate is not None:
        tags["flywheel.gate"] = "promoted" if result.gate.promoted else "kept the champion"
        tags["flywheel.gate.reason"] = result.gate.reason
    return tags


def _log_line(tracker: Tracker, name: str, values: Mapping[str, float], steps: list[int]) -> None:
    """Log numbers that are equal in every iteration, as lines for comparison."""
    tracker.log_rows(_line_run(tracker, name), [(step, values) for step in steps])


def _arm_run(tracker: Tracker, arm: Arm) -> str:
    return tracker.key if arm == "mppi" else _line_run(tracker, f"{arm} arm")


def _line_run(tracker: Tracker, name: str) -> str:
    run = f"{tracker.key}/{name.replace(' ', '-')}"
    tags = {"flywheel.kind": "line", "flywheel.beside": tracker.key}
    tracker.open(run, f"{name}, {tracker.key}", tags | {"mlflow.runColor": COLOURS[name]})
    return run


def _iteration_run(tracker: Tracker, iteration: int, arm: Arm) -> str:
    return f"{tracker.key}/{arm}-{iteration:04d}"


def iteration_values(result: IterationResult) -> Values:
    """The numbers of an iteration, as lines over iterations."""
    values: Values = {
        "store/episodes": result.episodes,
        "store/steps": result.steps,
        "store/new_episodes": result.new_episodes,
        "store/new_steps": result.new_steps,
        "health/worker_restarts": result.restarts,
        "health/quarantined_tasks": result.quarantined,
        "health/invalid_episodes": result.invalid,
        "seconds/cpu": result.cpu_seconds,
        **{f"seconds/{stage}": seconds for stage, seconds in result.seconds.items()},
    }
    if result.validation is not None:
        values |= error_values("error_validation", result.validation)
    if result.test is not None:
        values |= error_values("error_test", result.test)
    if result.recordings is not None:
        values |= error_values("error_recordings", result.recordings)
    if result.navigation is not None:
        values |= navigation_values(result.navigation)
    if result.robot is not None:
        values |= robot_values(result.robot)
    if result.diagnosis is not None:
        values |= diagnosis_values(result.diagnosis)
    if result.gate is not None:
        values |= {
            "promotion/number": result.gate.number,
            "promotion/promoted": float(result.gate.promoted),
        }
    return values


def robot_values(robot: RobotResult) -> Values:
    """The numbers on the robot: errors and success for each model, the noise, minutes of robot time.

    `robot/error_2s/<model>` is e_pos RMSE/L [%] over predictions of 2 s (`evaluate.horizon_seconds`).
    """
    values: Values = {
        "robot/minutes": robot.minutes,
        "robot/minutes_driven": robot.driven_minutes,
        **robot_errors(robot.errors),
    }
    if robot.noise is not None:
        values["robot/error_of_noise"] = robot.noise.e_pos_rmse
    for planner, navigation in robot.drives.items():
        values[f"robot/success/{planner}"] = navigation.success.rate
        if navigation.seconds_to_goal:
            values[f"robot/seconds_to_goal/{planner}"] = navigation.median_seconds
    return values


def robot_errors(errors: Mapping[str, Errors], section: str = "robot") -> Values:
    """The errors of each model on the robot's held-out recordings, over 1 s and the whole horizon."""
    values: Values = {}
    for model, each in errors.items():
        if each.by_lead_time is None or not each.by_lead_time.seconds:
            continue
        horizon = each.by_lead_time.seconds[-1]
        values[f"{section}/error_{horizon:g}s/{model}"] = each.short.e_pos_rmse
        if not each.short.turnless:
            values[f"{section}/rotation_{horizon:g}s/{model}"] = each.short.e_rot
        if horizon > 1 and (one := each.at(1.0)) is not None:
            values[f"{section}/error_1s/{model}"] = one
    return values


def diagnosis_values(note: DiagnosisNote) -> Values:
    """The errors of the plant before and after a diagnosis, and the noise [mm]."""
    ladder = {
        "noise_mm": note.noise,
        "plant_before_mm": note.baseline,
        "plant_after_mm": note.augmented,
        "held_out_before_mm": note.held_out_baseline,
        "held_out_after_mm": note.held_out_augmented,
    }
    values: Values = {f"diagnosis/{k}": 1000.0 * v for k, v in ladder.items() if v is not None}
    return values | {"diagnosis/effects": len(note.effects)}


def error_values(section: str, errors: Errors) -> Values:
    """The errors on one set of episodes: over the short horizon, and over whole episodes."""
    values = _totals(section, "short", errors.short)
    return values if errors.full is None else values | _totals(section, "full", errors.full)


def unseen_values(unseen: UnseenCourse) -> Values:
    """The closed-loop numbers of `navigation_values`, under the name of the course."""
    values = navigation_values(unseen.navigation)
    return {
        key.replace("closed_loop", f"closed_loop_{unseen.course}"): value
        for key, value in values.items()
        if key.startswith("closed_loop")
    }


def navigation_values(navigation: Navigation) -> Values:
    """Success rate with its interval, times to the goal and planning times."""
    low, high = navigation.success.interval
    values: Values = {
        "closed_loop/success_rate": navigation.success.rate,
        "closed_loop/success_rate_low": low,
        "closed_loop/success_rate_high": high,
        "closed_loop/episodes": navigation.success.total,
    }
    if navigation.seconds_to_goal:
        values["closed_loop/seconds_median"] = navigation.median_seconds
    if navigation.plan_seconds:
        values["seconds/plan_median"] = navigation.plan_quantile(0.5)
        values["seconds/plan_p95"] = navigation.plan_quantile(0.95)
    return values


def curve_values(point: TrainingPoint) -> Values:
    """The numbers of one point of a training curve."""
    optional = {
        "training/learning_rate": point.learning_rate,
        "training/validation_e_pos_rmse_percent": point.validation_e_pos_rmse,
        "training/validation_e_rot_deg": point.validation_e_rot,
    }
    return {"training/loss": point.loss} | {k: v for k, v in optional.items() if v is not None}


def lead_time_values(lead: LeadTimes) -> list[tuple[int, Values]]:
    """Each lead time [ms] with the errors there."""
    return [
        (
            round(1000 * seconds),
            {
                "lead_time_ms/e_pos_mse_percent": lead.e_pos_mse[i],
                "lead_time_ms/e_pos_rmse_percent": lead.e_pos_rmse[i],
                "lead_time_ms/e_rot_deg": lead.e_rot[i],
            },
        )
        for i, seconds in enumerate(lead.seconds)
    ]


def flattened(config: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """A nested configuration as dotted names and short texts; lists stay one value."""
    flat: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, Mapping) and value:
            flat |= flattened(value, f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = str(value)
    return flat


def _totals(section: str, kind: str, errors: ErrorNumbers) -> Values:
    return {
        f"{section}/{kind}_e_pos_mse_percent": errors.e_pos_mse,
        f"{section}/{kind}_e_pos_rmse_percent": errors.e_pos_rmse,
        f"{section}/{kind}_e_rot_deg": errors.e_rot,
    }
