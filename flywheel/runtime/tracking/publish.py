"""What is logged of a run: five moments, from the loop's records to the tracker's.

One parent run per flywheel, whose step is the iteration and whose lines are those of the MPPI arm;
one child run per iteration, with its training curve, its errors by lead time, its data, its model
and its files; and, beside the parent, one run per line to compare with (the control arm, the floors,
the oracle). Their numbers have the parent's names, so that they meet in one chart; they are no
children, because MLflow draws a child only once someone has unfolded it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from flywheel.runtime.results import Arm, IterationResult, RunResult, TrainingPoint
from flywheel.runtime.tracking.charts import (
    COLOURS,
    curve_values,
    error_values,
    flattened,
    iteration_values,
    lead_time_values,
    navigation_values,
    unseen_values,
)
from flywheel.runtime.tracking.tracker import Tracker


def publish_start(
    tracker: Tracker, config: Mapping[str, Any], tags: Mapping[str, str], name: str = ""
) -> None:
    """Open the run, or open it again.

    Args:
      tracker: of the run.
      config: resolved configuration; becomes parameters.
      tags: digests and versions, e.g. {"config": ..., "robot": ..., "code": ...}.
      name: for people; the run's key by default.
    """
    prefixed = {f"flywheel.{key}": value for key, value in tags.items()}
    look = {"flywheel.kind": "run", "mlflow.runColor": COLOURS["mppi"]}
    tracker.open(tracker.key, name or tracker.key, look | prefixed)
    tracker.describe(tracker.key, params=flattened(config))


def publish_iteration_start(tracker: Tracker, iteration: int, arm: Arm = "mppi") -> None:
    """Open the run of an iteration, or open it again."""
    name = f"iteration {iteration}" + ("" if arm == "mppi" else f" ({arm} arm)")
    tags = {"kind": "iteration", "iteration": str(iteration), "arm": arm}
    prefixed = {f"flywheel.{key}": value for key, value in tags.items()}
    tracker.open(_child(tracker, iteration, arm), name, prefixed, parent=tracker.key)


def publish_training(
    tracker: Tracker, iteration: int, points: Iterable[TrainingPoint], arm: Arm = "mppi"
) -> None:
    """Log points of the training curve of an iteration that has begun."""
    rows = [(point.step, curve_values(point)) for point in points]
    tracker.log_rows(_child(tracker, iteration, arm), rows)


def publish_iteration(
    tracker: Tracker,
    result: IterationResult,
    *,
    files: Iterable[str | Path] = (),
    model_folder: str | Path | None = None,
    model_shape: tuple[int, int] = (0, 0),
) -> None:
    """Log all of an iteration, end its run, and make its model champion if the gate said so.

    Args:
      tracker: of the run.
      result: of the iteration.
      files: figures and videos inside the run folder.
      model_folder: inside the run folder, written by `served.write_served`; None logs no model.
      model_shape: (tracked points, winches) of the model's robot.
    """
    iteration, arm = result.iteration, result.arm
    child = _child(tracker, iteration, arm)
    publish_iteration_start(tracker, iteration, arm)
    values = iteration_values(result)
    tracker.log(_arm(tracker, arm), values, iteration)
    tracker.log(child, {f"final/{name}": value for name, value in values.items()}, iteration)
    publish_training(tracker, iteration, result.curve, arm)
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
    """Log what is known only at the end, and end the run.

    That is pooled test errors and the lines to compare with: floors, oracle and, with iteration 0 in
    common, the control arm.
    """
    for arm in result.arms:
        for iteration in result.of_arm(arm):
            tracker.log(_arm(tracker, arm), iteration_values(iteration), iteration.iteration)
            if (errors := result.pooled_errors(iteration)) is not None:
                values = error_values("error_pooled", errors)
                tracker.log(_arm(tracker, arm), values, iteration.iteration)
    steps = sorted({iteration.iteration for iteration in result.iterations})
    for name, floor in (("floor", result.floor), ("informed floor", result.informed_floor)):
        if floor is not None:
            _constant(tracker, name, error_values("error_pooled", floor), steps)
    if result.oracle is not None:
        _constant(tracker, "oracle", navigation_values(result.oracle), steps)
    for unseen in result.unseen:
        tracker.log(tracker.key, unseen_values(unseen), max(steps, default=0))
    if result.persistence is not None:
        values = error_values("persistence", result.persistence)
        tracker.log(tracker.key, values, max(steps, default=0))
    for path in files:
        tracker.artifact(tracker.key, path)
    tracker.end(tracker.key)


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


def _constant(tracker: Tracker, name: str, values: Mapping[str, float], steps: list[int]) -> None:
    tracker.log_rows(_line(tracker, name), [(step, values) for step in steps])


def _arm(tracker: Tracker, arm: Arm) -> str:
    return tracker.key if arm == "mppi" else _line(tracker, f"{arm} arm")


def _line(tracker: Tracker, name: str) -> str:
    run = f"{tracker.key}/{name.replace(' ', '-')}"
    tags = {"flywheel.kind": "line", "flywheel.beside": tracker.key}
    tracker.open(run, f"{name}, {tracker.key}", tags | {"mlflow.runColor": COLOURS[name]})
    return run


def _child(tracker: Tracker, iteration: int, arm: Arm) -> str:
    return f"{tracker.key}/{arm}-{iteration:04d}"
