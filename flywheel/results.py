"""Results of a run: the records written by the loop and read by reports.

All are frozen pydantic models with a JSON round trip. Paths and overlays are thinned in time. A
value that could not be measured is None; a non-finite one is kept (JSON "NaN"). Position errors are
given both as MSE/L and as RMSE/L [%], as defined in `flywheel.evaluation.errors`.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from flywheel.effects import WrittenTerm
from flywheel.errors import DataError
from flywheel.evaluation.errors import ErrorTable
from flywheel.evaluation.intervals import success_interval
from flywheel.files import MB, read_bytes
from flywheel.outputs import write_output
from flywheel.robots import Box
from flywheel.run_identity import read_begun
from flywheel.seals import Seal, Unsound, check_seal, sealed, unsealed
from flywheel.validation import first_problem


def _inside(path: str) -> str:
    parts = PurePosixPath(path).parts
    if path.startswith("/") or ".." in parts or not path.isprintable():
        raise ValueError("the path leaves the run's folder")
    return path


PathInside = Annotated[str, AfterValidator(_inside)]  # relative to the run folder, or ""


class ResultRecord(BaseModel):
    """Base of every result: frozen, no unknown fields, NaN survives JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Success(ResultRecord):
    """Number of tasks reached in time, and of all tasks."""

    reached: int = 0
    total: int = 0

    @property
    def rate(self) -> float:
        """The fraction of reached tasks, 0 to 1; NaN without a task."""
        return self.reached / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the rate; (0, 1) without a task."""
        interval = success_interval(self.reached, self.total)
        return (interval.low, interval.high)

    def __add__(self, other: Success) -> Success:
        return Success(reached=self.reached + other.reached, total=self.total + other.total)


class DiagnosisNote(ResultRecord):
    """The answer of a diagnosis between two iterations, and the plant's effects after it.

    Attributes:
      verdict: in one word.
      effects: of the plant from here on.
      adopted: True if these differ from the previous ones.
      reason: a sentence for people.
      noise: of the measurements [m].
      baseline, augmented: root mean square of measured minus predicted, with fitted initial states,
        by the previous plant and by the plant with the answer, on the fitted recordings [m].
      held_out_baseline, held_out_augmented: the same on the recordings kept for tests; None without
        any [m].
      answer: `Diagnosis.summary()`.
      page: path relative to the run folder.
    """

    verdict: str
    effects: tuple[WrittenTerm, ...] = ()
    adopted: bool = False
    reason: str = ""
    noise: float
    baseline: float
    augmented: float
    held_out_baseline: float | None = None
    held_out_augmented: float | None = None
    answer: dict[str, Any] = {}
    page: PathInside = ""


class ErrorNumbers(ResultRecord):
    """The totals of one error table, over `windows` windows or whole episodes."""

    e_pos_mse: float  # [%] squared CoM error / L
    e_pos_rmse: float  # [%] root of the mean squared CoM error / L
    e_rot: float  # [deg]
    windows: int = 0

    @classmethod
    def of(cls, table: ErrorTable) -> Self:
        """The totals of a table."""
        return cls(
            e_pos_mse=table.e_pos_mse,
            e_pos_rmse=table.e_pos_rmse,
            e_rot=table.e_rot,
            windows=table.windows,
        )

    @property
    def diverged(self) -> bool:
        """True if a rollout was not finite, so that there is no error."""
        return math.isnan(self.e_pos_rmse)

    @property
    def turnless(self) -> bool:
        """True if there is no `e_rot`, because each body has only one tracked point."""
        return math.isnan(self.e_rot) and not self.diverged


class LeadTimes(ResultRecord):
    """Short-horizon errors by lead time; all tuples are equally long."""

    seconds: tuple[float, ...]
    e_pos_mse: tuple[float, ...]
    e_pos_rmse: tuple[float, ...]
    e_rot: tuple[float, ...]

    @classmethod
    def of(cls, table: ErrorTable, every_seconds: float = 0.1) -> Self:
        """A table's rows, thinned to one per `every_seconds`; the last row is always kept."""
        lead = table.by_lead_time()
        stride = max(1, round(every_seconds / table.dt))
        rows = np.arange(table.steps)[::-1][::stride][::-1]
        return cls(**{name: tuple(values[rows].tolist()) for name, values in lead.items()})


class Errors(ResultRecord):
    """A dynamics model's errors on one set of episodes.

    Attributes:
      short: over the short horizon, from random starts.
      full: over whole episodes; None if these were not predicted.
      by_lead_time: over the short horizon, by lead time.
      by_episode: episode id -> e_pos_mse from random starts in it [%].
    """

    short: ErrorNumbers
    full: ErrorNumbers | None = None
    by_lead_time: LeadTimes | None = None
    by_episode: dict[str, float] = {}

    @classmethod
    def of(
        cls,
        short: ErrorTable,
        full: ErrorTable | None = None,
        by_episode: Mapping[str, ErrorTable] = MappingProxyType({}),
    ) -> Self:
        """The errors of the tables from `evaluation.score` and `evaluation.score_full`."""
        return cls(
            short=ErrorNumbers.of(short),
            full=None if full is None else ErrorNumbers.of(full),
            by_lead_time=LeadTimes.of(short),
            by_episode={name: table.e_pos_mse for name, table in by_episode.items()},
        )

    def at(self, seconds: float) -> float | None:
        """e_pos_rmse over lead times up to `seconds` [%]; None if unknown."""
        lead = self.by_lead_time
        if lead is None or not lead.seconds or lead.seconds[-1] < seconds - 1e-9:
            return None
        known = [
            e for t, e in zip(lead.seconds, lead.e_pos_rmse, strict=True) if t <= seconds + 1e-9
        ]
        return float(np.sqrt(np.mean(np.square(known))))


class Walk(ResultRecord):
    """One evaluation episode seen from above.

    Attributes:
      path: (x, y) of the CoM [m], thinned to about two per second.
      goal: (x, y) [m].
      reached: True if the goal was reached in time.
      seconds: time to the goal, or to the end of the episode [s].
      distance: to the goal at the end [m].
      seed: of the episode.
      obstacles: of the task.
    """

    path: tuple[tuple[float, float], ...] = ()
    goal: tuple[float, float]
    reached: bool
    seconds: float
    distance: float
    seed: int = 0
    obstacles: tuple[Box, ...] = ()


class Navigation(ResultRecord):
    """Closed-loop episodes of one controller on the evaluation tasks.

    Attributes:
      controller: e.g. "mppi", "mppi on the plant".
      walks: one per episode; an invalid episode has none.
      seconds_allowed: to reach the goal [s].
      tolerance: radius of the goal [m].
      plan_seconds: wall time of the plans, thinned to at most some thousands [s].
    """

    controller: str = "mppi"
    walks: tuple[Walk, ...] = ()
    seconds_allowed: float = 60.0
    tolerance: float = 0.0
    plan_seconds: tuple[float, ...] = ()

    @property
    def success(self) -> Success:
        """Number of episodes that reached the goal."""
        return Success(reached=sum(w.reached for w in self.walks), total=len(self.walks))

    @property
    def seconds_to_goal(self) -> tuple[float, ...]:
        """Times to the goal of the episodes that reached it, ascending [s]."""
        return tuple(sorted(w.seconds for w in self.walks if w.reached))

    @property
    def median_seconds(self) -> float:
        """Median time to the goal of the episodes that reached it [s]; NaN if none did."""
        reached = self.seconds_to_goal
        return float(np.median(reached)) if reached else math.nan

    def plan_quantile(self, q: float) -> float:
        """Quantile of the planning time [s]; NaN without records."""
        return float(np.quantile(self.plan_seconds, q)) if self.plan_seconds else math.nan


class TrainingPoint(ResultRecord):
    """One point of the training curve; `validation_*` is None without a validation."""

    step: int
    loss: float
    learning_rate: float | None = None
    validation_e_pos_rmse: float | None = None
    validation_e_rot: float | None = None
    seconds: float = 0.0


class GateDecision(ResultRecord):
    """The gate's decision on this iteration's model.

    Attributes:
      promoted: True for a new champion.
      measure: name of the compared number, with its unit ("validation e_rot at 2 s [deg]").
      number: the measure of the candidate.
      reference: the measure of the champion so far; None for the first model.
      ratio, low, high: number over reference, and the ends of its 95 % interval; None if unknown.
      reason: one sentence for people.
    """

    promoted: bool
    measure: str
    number: float
    reference: float | None = None
    ratio: float | None = None
    low: float | None = None
    high: float | None = None
    reason: str = ""


class Overlay(ResultRecord):
    """One test window, measured and predicted, thinned in time.

    Attributes:
      seconds: (T,) lead times [s].
      measured: (T, P, 3) tracked points [m].
      predicted: (T, P, 3) [m].
      rods: pairs of indices into P that belong to one rod.
    """

    seconds: tuple[float, ...]
    measured: tuple[tuple[tuple[float, float, float], ...], ...]
    predicted: tuple[tuple[tuple[float, float, float], ...], ...]
    rods: tuple[tuple[int, int], ...] = ()
    episode: str = ""


Arm = Literal["mppi", "control"]
RESULT_FILE, RESULT = "result.json", "result"
LARGEST_RESULT = 200 * MB  # [bytes]; one of ten iterations has some 5 MB
NOTHING: Mapping[str, str] = MappingProxyType({})


class RobotResult(ResultRecord):
    """Drives of an iteration on the robot, and the errors of its models on it.

    Attributes:
      minutes: recorded on the robot before, and used for training.
      driven_minutes: recorded in this iteration's drives.
      errors: name of a model -> its errors on the robot's held-out recordings up to here.
        "network"; "given", the unchanged MJCF; "plant", the MJCF with the adopted effects;
        "residual", that plant with a correcting network.
      noise: error floor due to sensor noise.
      drives: name of MPPI's model -> its episodes.
      filmed: name of the model of the drive in the iteration's video; "" without one.
    """

    minutes: float = 0.0
    driven_minutes: float = 0.0
    errors: dict[str, Errors] = Field(default_factory=dict)
    noise: ErrorNumbers | None = None
    drives: dict[str, Navigation] = Field(default_factory=dict)
    filmed: str = ""


class IterationResult(ResultRecord):
    """One iteration in one arm.

    Attributes:
      iteration: its number; 0 has the gaits, random controls and drops.
      arm: "mppi", or "control" (as many episodes and optimiser steps, but random controls).
      snapshot, parent_snapshot: digests of the model's training data, and of the arm's previous
        data.
      model: digest of the weights.
      validation, test: errors; None if not run. Tests are simulated episodes.
      recordings: errors on the recordings that are kept for tests, the same ones in every
        iteration; None without any.
      navigation: closed-loop evaluation with this model; None if not run.
      episodes, steps: of training data in the snapshot, in all.
      new_episodes, new_steps: collected by this iteration.
      restarts, quarantined, invalid: numbers of workers restarted, episodes set aside, episodes
        discarded.
      seconds: wall time per stage ("collect", "snapshot", "train", "evaluate", "decide") [s].
      cpu_seconds: processor time of the workers for all arms, in the result of "mppi" only [s].
      diagnosis: of the plant before this iteration; None without one.
      robot: results on the robot; None in a run without one.
      video: path relative to the run folder, or "".
    """

    iteration: int
    arm: Arm = "mppi"
    snapshot: str
    parent_snapshot: str = ""
    model: str
    validation: Errors | None = None
    test: Errors | None = None
    recordings: Errors | None = None
    navigation: Navigation | None = None
    episodes: int = 0
    steps: int = 0
    new_episodes: int = 0
    new_steps: int = 0
    restarts: int = 0
    quarantined: int = 0
    invalid: int = 0
    seconds: dict[str, float] = Field(default_factory=dict)
    cpu_seconds: float = 0.0
    curve: tuple[TrainingPoint, ...] = ()
    gate: GateDecision | None = None
    overlay: Overlay | None = None
    diagnosis: DiagnosisNote | None = None
    robot: RobotResult | None = None
    video: PathInside = ""


class RobotScore(ResultRecord):
    """The errors of one model of one iteration on all of the robot's held-out recordings.

    Attributes:
      iteration: of the model.
      model: its name, as in `RobotResult`.
      minutes: recorded on the robot before, and used for training.
      errors: of the model.
    """

    iteration: int
    model: str
    minutes: float
    errors: Errors


class PooledTest(ResultRecord):
    """The errors of one iteration's model on the test episodes of all iterations."""

    arm: Arm
    iteration: int
    model: str
    errors: Errors


class UnseenCourse(ResultRecord):
    """Closed-loop episodes on a course that no model was trained on.

    Attributes:
      course: its name.
      navigation: of the last champion.
      oracle: of MPPI on the plant itself; None if not run.
      video: path relative to the run folder, or "".
    """

    course: str
    navigation: Navigation
    oracle: Navigation | None = None
    video: PathInside = ""


class RunResult(ResultRecord):
    """The state of a run. The loop saves it after every iteration; reports read it, finished or not.

    Attributes:
      name, key: a name for people, and the unique key of the run at MLflow.
      config, config_digest: the resolved and validated configuration, and sha256 of the part that
        determines results.
      code, versions: version of this project, and of its engines.
      robot, robot_digest, length: name, digest and characteristic length L [m] of the robot.
      iterations: in the order of their ends, both arms.
      pooled: every model on the pooled test set (filled at the end).
      floor: MuJoCo restarted from the same partial observations, on the pooled test set, with the
        roll of each rod drawn at random.
      informed_floor: the same with the roll computed from the cables, by exact parameters.
      persistence: "nothing moves", on the same set.
      persistence_on_recordings: the same on the recordings that are kept for tests.
      oracle: MPPI on the plant itself; the ceiling of success.
      unseen: the last champion on courses without training.
      on_robot: every model on all of the robot's held-out recordings; empty in a run without a
        robot.
      robot_noise: error floor due to sensor noise.
      notes: sentences that the page must show among its limits.
    """

    name: str
    key: str
    config: dict[str, Any] = Field(default_factory=dict)
    config_digest: str = ""
    code: str = ""
    versions: dict[str, str] = Field(default_factory=dict)
    robot: str = ""
    robot_digest: str = ""
    length: float = 1.0
    iterations: tuple[IterationResult, ...] = ()
    pooled: tuple[PooledTest, ...] = ()
    floor: Errors | None = None
    informed_floor: Errors | None = None
    persistence: Errors | None = None
    persistence_on_recordings: Errors | None = None
    oracle: Navigation | None = None
    unseen: tuple[UnseenCourse, ...] = ()
    on_robot: tuple[RobotScore, ...] = ()
    robot_noise: ErrorNumbers | None = None
    finished: bool = False
    notes: tuple[str, ...] = ()

    @property
    def arms(self) -> tuple[Arm, ...]:
        """The arms that have an iteration, "mppi" first."""
        present = {i.arm for i in self.iterations}
        return tuple(arm for arm in ("mppi", "control") if arm in present)

    def of_arm(self, arm: Arm) -> tuple[IterationResult, ...]:
        """The arm's iterations in order. Iteration 0 is common to both arms."""
        own = {i.iteration: i for i in self.iterations if i.arm == arm}
        shared = {i.iteration: i for i in self.iterations if i.iteration == 0}
        return tuple(i for _, i in sorted((shared | own).items()))

    def effects_before(self, iteration: int) -> tuple[WrittenTerm, ...]:
        """The plant's effects before a diagnosis in this iteration."""
        earlier = [t for t in self.of_arm("mppi") if t.iteration < iteration and t.diagnosis]
        if earlier and earlier[-1].diagnosis is not None:
            return earlier[-1].diagnosis.effects
        return tuple(WrittenTerm.model_validate(e) for e in self.config.get("effects", ()))

    def pooled_errors(self, result: IterationResult) -> Errors | None:
        """The errors of an iteration's model on the pooled test set; None if that was not run."""
        for pooled in self.pooled:
            if (pooled.arm, pooled.iteration) == (result.arm, result.iteration):
                return pooled.errors
        return None

    def test_errors(self, result: IterationResult) -> Errors | None:
        """The errors on the pooled test set if that was run, else on the iteration's own test episodes."""
        return self.pooled_errors(result) or result.test

    def robot_errors(self, model: str) -> dict[int, Errors]:
        """Iteration -> errors of a model on the robot: on all held-out recordings, or on those of
        its time.

        Args:
          model: as in `RobotResult`. "given" is the same in every iteration.
        """
        scored = {s.iteration: s.errors for s in self.on_robot if s.model == model}
        if scored and model == "given":
            return {t.iteration: scored[min(scored)] for t in self.of_arm("mppi")}
        if scored:
            return scored
        had = {t.iteration: t.robot for t in self.of_arm("mppi") if t.robot is not None}
        return {i: r.errors[model] for i, r in had.items() if model in r.errors}

    def minutes_to_best(self, model: str, within: float = 1.1) -> float | None:
        """Minutes on the robot until a model's position error is within some factor of its least.

        None if its errors on the same recordings are unknown for some iteration.
        """
        scored = [s for s in self.on_robot if s.model == model]
        errors = [s.errors.short.e_pos_rmse for s in scored]
        finite = [error for error in errors if math.isfinite(error)]
        if not finite:
            return None
        good = (s.minutes for s, e in zip(scored, errors, strict=True) if e <= within * min(finite))
        return min(good)

    def save(self, folder: str | Path, rests_on: Mapping[str, str] = NOTHING) -> Path:
        """Write `<folder>/result.json` in one atomic step, under a seal.

        Args:
          folder: of the run.
          rests_on: name -> digest of the result's other files, for the seal.
        """
        return save(self, Path(folder) / RESULT_FILE, Seal(RESULT, RESULT, self.key, rests_on))

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read `<folder>/result.json`.

        Raises:
          DataError: it is missing, was altered, or belongs to another run than the folder.
        """
        try:
            return cls.read(folder)[0]
        except Unsound as error:
            if error.kind == "missing":
                raise
            hint = f"`flywheel data verify {folder}` lists remedies."
            raise Unsound(f"{error} {hint}", error.kind) from None

    @classmethod
    def read(cls, folder: str | Path) -> tuple[Self, Seal]:
        """Read the result with its seal.

        Raises:
          DataError: as `load`.
        """
        owner = ""
        with suppress(Unsound):  # what run.json has is told by `flywheel data verify`
            owner = read_begun(Path(folder)).identity.key
        return read(cls, Path(folder) / RESULT_FILE, Seal(RESULT, RESULT, owner))


R = TypeVar("R", bound=ResultRecord)


def save(record: ResultRecord, path: Path, seal: Seal) -> Path:
    """Write any of these records as JSON under a seal, in one atomic and durable step."""
    return write_output(path, sealed(json.loads(record.model_dump_json()), seal))


def read(kind: type[R], path: Path, wanted: Seal) -> tuple[R, Seal]:
    """Read a record that `save` wrote, with its seal.

    Args:
      kind: class of the record.
      path: of the file.
      wanted: required seal of the file. If its owner is "", any is accepted.

    Raises:
      DataError: the file is missing, or its content is no such record.
      Unsound: the file was altered, or belongs to another run.
    """
    if not os.path.lexists(path):
        message = f"There is no {path.name} in {path.parent}; has the run started?"
        raise Unsound(message, "missing")
    what = f"The file {path}"
    values, seal = unsealed(read_bytes(path, "file", DataError, LARGEST_RESULT), what)
    check_seal(seal, wanted.kind, wanted.name, what)
    if wanted.owner not in ("", seal.owner):
        words = f"{what} is of another run ({seal.owner}, this one is {wanted.owner})."
        raise Unsound(words, "foreign")
    try:
        return kind.model_validate(values), seal
    except ValidationError as error:
        raise Unsound(f"{what} is not a {kind.__name__}: {first_problem(error)}.") from None
