"""Which number of a result goes under which name onto MLflow's charts.

The part of a name before the slash becomes a section of MLflow's page, in alphabetical order: what
people look for first comes first. The parent run's step is the iteration; the names of its lines
are shared by the runs that stand beside it (the control arm, the floors, the oracle), so that they
meet in one chart.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flywheel.runtime.results import (
    DiagnosisNote,
    ErrorNumbers,
    Errors,
    IterationResult,
    LeadTimes,
    Navigation,
    TrainingPoint,
    UnseenCourse,
)

Values = dict[str, float]
COLOURS = {  # of Okabe and Ito (2008, jfly.uni-koeln.de/color); the figures have the same
    "mppi": "#0072B2",
    "control arm": "#E69F00",
    "floor": "#4a4a4a",
    "informed floor": "#CC79A7",
    "oracle": "#009E73",
}


def iteration_values(result: IterationResult) -> Values:
    """Every number of an iteration that makes a line over iterations."""
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
    if result.diagnosis is not None:
        values |= diagnosis_values(result.diagnosis)
    if result.gate is not None:
        values |= {
            "promotion/number": result.gate.number,
            "promotion/promoted": float(result.gate.promoted),
        }
    return values


def diagnosis_values(note: DiagnosisNote) -> Values:
    """The ladder from the plant as it was to the noise, in millimetres."""
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
    """Short-horizon and full errors of one set of episodes."""
    values = _totals(section, "short", errors.short)
    return values if errors.full is None else values | _totals(section, "full", errors.full)


def unseen_values(unseen: UnseenCourse) -> Values:
    """What `navigation_values` says of closed loops, under the name of the course."""
    values = navigation_values(unseen.navigation)
    return {
        key.replace("closed_loop", f"closed_loop_{unseen.course}"): value
        for key, value in values.items()
        if key.startswith("closed_loop")
    }


def navigation_values(navigation: Navigation) -> Values:
    """Success with its interval, times to the goal, planning times."""
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
    """One point of a training curve; its step is the optimiser's."""
    optional = {
        "training/learning_rate": point.learning_rate,
        "training/validation_e_pos_rmse_percent": point.validation_e_pos_rmse,
        "training/validation_e_rot_deg": point.validation_e_rot,
    }
    return {"training/loss": point.loss} | {k: v for k, v in optional.items() if v is not None}


def lead_time_values(lead: LeadTimes) -> list[tuple[int, Values]]:
    """(lead time in milliseconds, errors there) for each lead time."""
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
