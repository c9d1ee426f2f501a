"""A run at MLflow: mapping of its results to runs, metrics, tags and files.

One parent run stands for the whole run. Its step is the iteration, and its lines are those of the
MPPI arm. Each iteration has a child run with its training curve, errors by lead time, data, model
and files. Each line for comparison (the control arm, the floors, the oracle) is a separate run. Its
numbers have the parent's names, so that they appear in one chart; it is not a child, because MLflow
draws a child only once it has been unfolded.

The part of a metric's name before the slash is a section of MLflow's page; sections are in
alphabetical order, and named so that the most important come first.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator, Mapping
from typing import Any

from flywheel.reports.page import PAGE_FILE
from flywheel.reports.style import COLOURS
from flywheel.results import (
    DiagnosisNote,
    ErrorNumbers,
    Errors,
    IterationResult,
    LeadTimes,
    Navigation,
    ResultRecord,
    RobotResult,
    RunResult,
    TrainingPoint,
    UnseenCourse,
)
from flywheel.runtime.run.folder import RunFolder, name_of
from flywheel.runtime.tracking.dashboard import DATABASE, is_missing
from flywheel.runtime.tracking.mlflow_client import Board, Run
from flywheel.runtime.tracking.tracker import Status

Values = dict[str, float]
PUBLISHED = "flywheel.published"  # tag of a run with everything about a result: its digest
MARK = "published.txt"  # in the folder of a run with nothing left to publish: where, and the digest


class Page:
    """A run's results at MLflow. Publishing them again changes nothing.

    Args:
      board: for the results.
      folder: of the run, with its models, figures and videos.
      shape: (tracked points, winches) of the robot, for the signatures of the models.
    """

    def __init__(self, board: Board, folder: RunFolder, shape: tuple[int, int]) -> None:
        self._board, self._folder, self._shape = board, folder, shape
        self._done: set[str] = set()  # what this process has published or found there
        self._mark = folder.path / MARK

    def publish(self, result: RunResult, status: Status) -> None:
        """Publish everything that is not there yet.

        Raises:
          Exception: MLflow cannot be reached, or its database is damaged. A repetition goes on
            from there.
        """
        mark = f"{self._board.uri} {_digest(result)}"
        if self._is_complete(mark):
            return
        parent = self._parent(result)
        if result.key not in self._done:
            self._board.describe(parent, params=flattened(result.config))
            self._done.add(result.key)
        for each in result.iterations:
            if (name := name_of(each.iteration, each.arm)) not in self._done:
                self._iteration(result, each)
                self._done.add(name)
        if result.finished:
            self._end(result)
            self._mark.write_text(mark)
        else:
            self._board.status(parent, status)

    def _is_complete(self, mark: str) -> bool:
        lost = self._board.uri.startswith("sqlite") and is_missing(self._folder.path / DATABASE)
        return not lost and self._mark.exists() and self._mark.read_text() == mark

    def _iteration(self, result: RunResult, each: IterationResult) -> None:
        """Publish everything about an iteration; its model becomes champion if the gate decided so."""
        board, parent, name = self._board, self._parent(result), name_of(each.iteration, each.arm)
        child = self._child(result, each)
        digest, step = _digest(each), each.iteration
        if child.tags.get(PUBLISHED) == digest:
            return
        values, tags = iteration_values(each), _tags(each)
        board.log(self._line(result, each.arm), [(step, values)], since=child)
        final = {f"final/{name}": value for name, value in values.items()}
        board.log(child, [(step, final), *((p.step, curve_values(p)) for p in each.curve)])
        if each.test is not None and each.test.by_lead_time is not None:
            board.log(child, lead_time_values(each.test.by_lead_time))
        board.describe(child, tags=tags)
        profile = {"episodes": each.episodes, "steps": each.steps}
        board.dataset(child, f"iteration-{step}-{each.arm}", each.snapshot, profile)
        page = each.diagnosis.page if each.diagnosis is not None and each.arm == "mppi" else ""
        for path in filter(None, (each.video, page)):
            board.artifact(child, path)
        if each.model:
            served = self._folder.weights(step, each.arm).parent
            key = f"{result.key}/{name}/{each.model}"
            board.model(child, key, name, each.model, served, self._shape, tags, step)
        if each.gate is not None:
            board.promote(parent, each.model, each.gate)
        board.status(child, "FINISHED", self._ended(each))
        board.describe(child, tags={PUBLISHED: digest})

    def _end(self, result: RunResult) -> None:
        """Publish the final numbers: the pooled test errors, floors, oracle, and the control arm's line."""
        board, parent = self._board, self._parent(result)
        last = max((i.iteration for i in result.iterations), default=0)
        if parent.tags.get(PUBLISHED) == _digest(result):
            return
        for arm in result.arms:
            for each in result.of_arm(arm):
                values = iteration_values(each)
                if (errors := result.pooled_errors(each)) is not None:
                    values |= error_values("error_pooled", errors)
                since = self._child(result, each)
                board.log(self._line(result, arm), [(each.iteration, values)], since)
        for name, values in _constant_lines(result):
            board.log(self._line(result, name), [(step, values) for step in range(last + 1)])
        board.log(parent, final_rows(result, last))
        figures = sorted((self._folder.path / "figures").glob("*.png"))
        videos = [each.video for each in result.unseen if each.video]
        for path in (PAGE_FILE, *map(str, figures), *videos):
            board.artifact(parent, path)
        board.status(parent, "FINISHED")
        board.describe(parent, tags={PUBLISHED: _digest(result)})

    def _parent(self, result: RunResult) -> Run:
        tags = {
            "kind": "run",
            "config": result.config_digest,
            "robot": result.robot_digest,
            "code": result.code,
            "seed": str(result.config.get("seed", "")),
            **{f"version.{name}": number for name, number in result.versions.items()},
        }
        look = {"mlflow.runColor": COLOURS["mppi"]}
        look |= {f"flywheel.{key}": value for key, value in tags.items()}
        return self._board.run(result.key, result.name or result.key, look)

    def _child(self, result: RunResult, each: IterationResult) -> Run:
        """The run of an iteration."""
        step, arm = each.iteration, each.arm
        tags = {"kind": "iteration", "iteration": str(step), "arm": arm}
        tags = {f"flywheel.{key}": value for key, value in tags.items()}
        name = f"iteration {step}" + ("" if arm == "mppi" else f" ({arm} arm)")
        begun = self._ended(each) - sum(each.seconds.values())
        parent = self._parent(result)
        return self._board.run(f"{result.key}/{arm}-{step:04d}", name, tags, parent, begun)

    def _ended(self, each: IterationResult) -> float:
        """When an iteration was completed, in seconds since 1970."""
        path = self._folder.result_file(each.iteration, each.arm)
        return path.stat().st_mtime if path.exists() else time.time()

    def _line(self, result: RunResult, name: str) -> Run:
        """The run with the line of an arm, a floor or the oracle in the common charts."""
        if name == "mppi":
            return self._parent(result)
        name = f"{name} arm" if name == "control" else name
        tags = {"flywheel.kind": "line", "flywheel.beside": result.key}
        tags |= {"mlflow.runColor": COLOURS[name]}
        key = f"{result.key}/{name.replace(' ', '-')}"
        return self._board.run(key, f"{name}, {result.key}", tags)


def _digest(result: ResultRecord) -> str:
    return hashlib.sha256(result.model_dump_json().encode()).hexdigest()


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


def _constant_lines(result: RunResult) -> Iterator[tuple[str, Values]]:
    """Names and numbers of the lines that are equal in every iteration."""
    for name, floor in (("floor", result.floor), ("informed floor", result.informed_floor)):
        if floor is not None:
            yield name, error_values("error_pooled", floor)
    if result.oracle is not None:
        yield "oracle", navigation_values(result.oracle)


def final_rows(result: RunResult, last: int) -> list[tuple[int, Values]]:
    """The parent's numbers of the end of a run: unseen courses, the robot, persistence.

    Every model's errors are on all of the robot's held-out recordings.
    """
    rows = [
        (score.iteration, robot_errors({score.model: score.errors}, "robot_pooled"))
        for score in result.on_robot
    ]
    rows += [(last, unseen_values(unseen)) for unseen in result.unseen]
    for model in sorted({score.model for score in result.on_robot} - {"given"}):
        if (minutes := result.minutes_to_best(model)) is not None:
            rows.append((last, {f"robot/minutes_to_best/{model}": minutes}))
    if result.persistence is not None:
        rows.append((last, error_values("persistence", result.persistence)))
    return rows


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
