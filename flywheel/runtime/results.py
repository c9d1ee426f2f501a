"""What an iteration and a run produced: the numbers that the loop writes and reports read.

Frozen, JSON round trip (`save`, `load`), no arrays of steps: paths and overlays are thinned. A value
that could not be measured is None; a value that came out non-finite is kept as it is (JSON "NaN").
Errors follow the paper's two measures: position as MSE/L and as RMSE/L [%], rotation [deg].
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from flywheel.errors import DataError
from flywheel.evaluation.errors import ErrorTable
from flywheel.evaluation.intervals import success_interval

Arm = Literal["mppi", "control"]
RESULT_FILE = "result.json"


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Success(_Record):
    """How many of the tasks were reached in time."""

    reached: int = 0
    total: int = 0

    @property
    def rate(self) -> float:
        """Share in 0..1; NaN without a task."""
        return self.reached / self.total if self.total else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the rate; (0, 1) without a task."""
        interval = success_interval(self.reached, self.total)
        return (interval.low, interval.high)

    def __add__(self, other: Success) -> Success:
        return Success(reached=self.reached + other.reached, total=self.total + other.total)


class ErrorNumbers(_Record):
    """One error table boiled down to its totals, over `windows` windows (or whole episodes)."""

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


class LeadTimes(_Record):
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
        rows = np.arange(len(lead.seconds))[::-1][::stride][::-1]
        return cls(
            seconds=tuple(lead.seconds[rows].tolist()),
            e_pos_mse=tuple(lead.e_pos_mse[rows].tolist()),
            e_pos_rmse=tuple(lead.e_pos_rmse[rows].tolist()),
            e_rot=tuple(lead.e_rot[rows].tolist()),
        )


class Errors(_Record):
    """A dynamics model's errors on one set of episodes. `full` is None where it was not run."""

    short: ErrorNumbers
    full: ErrorNumbers | None = None
    by_lead_time: LeadTimes | None = None

    @classmethod
    def of(cls, short: ErrorTable, full: ErrorTable | None = None) -> Self:
        """From the tables of `evaluation.score` and `evaluation.score_full`."""
        return cls(
            short=ErrorNumbers.of(short),
            full=None if full is None else ErrorNumbers.of(full),
            by_lead_time=LeadTimes.of(short),
        )


class Walk(_Record):
    """One evaluation episode seen from above.

    Attributes:
      path: (x, y) of the CoM [m], thinned to about two per second.
      goal: (x, y) [m].
      reached: in time.
      seconds: to the goal, or to the end of the episode [s].
      distance: to the goal at the end [m].
    """

    path: tuple[tuple[float, float], ...] = ()
    goal: tuple[float, float]
    reached: bool
    seconds: float
    distance: float
    seed: int = 0


class Navigation(_Record):
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
        """Reached and total."""
        return Success(reached=sum(w.reached for w in self.walks), total=len(self.walks))

    @property
    def seconds_to_goal(self) -> tuple[float, ...]:
        """Of the episodes that reached it, ascending [s]."""
        return tuple(sorted(w.seconds for w in self.walks if w.reached))

    @property
    def median_seconds(self) -> float:
        """Median time to the goal of the episodes that reached it [s]; NaN if none did."""
        reached = self.seconds_to_goal
        return float(np.median(reached)) if reached else math.nan

    def plan_quantile(self, q: float) -> float:
        """Quantile of the planning time [s]; NaN where none was recorded."""
        return float(np.quantile(self.plan_seconds, q)) if self.plan_seconds else math.nan


class TrainingPoint(_Record):
    """One point of the training curve; `validation_*` where a validation was due."""

    step: int
    loss: float
    learning_rate: float | None = None
    validation_e_pos_rmse: float | None = None
    validation_e_rot: float | None = None
    seconds: float = 0.0


class GateDecision(_Record):
    """Whether this iteration's model became the champion.

    Attributes:
      promoted: the alias was moved.
      measure: what was compared, with its unit ("validation e_rot at 2 s [deg]").
      number: of the candidate.
      reference: of the champion so far; None for the first.
      reason: one sentence for people.
    """

    promoted: bool
    measure: str
    number: float
    reference: float | None = None
    reason: str = ""


class Overlay(_Record):
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


class IterationResult(_Record):
    """One turn of the flywheel in one arm.

    Attributes:
      iteration: 0 is gaits, random controls and drops.
      arm: "mppi", or "control" (as many episodes and optimiser steps, but random controls).
      snapshot, parent_snapshot: digests of the data the model was trained on, and of the one before.
      model: digest of the weights.
      validation, test: errors; None where not run.
      navigation: closed-loop evaluation with this model; None where not run.
      episodes, steps: of training data in the snapshot, in all.
      new_episodes, new_steps: collected by this iteration.
      restarts, quarantined, invalid: workers restarted, tasks set aside, episodes thrown away.
      seconds: wall time per stage ("collect", "snapshot", "train", "evaluate", "decide") [s].
      video: path relative to the run folder, or "".
    """

    iteration: int
    arm: Arm = "mppi"
    snapshot: str
    parent_snapshot: str = ""
    model: str
    validation: Errors | None = None
    test: Errors | None = None
    navigation: Navigation | None = None
    episodes: int = 0
    steps: int = 0
    new_episodes: int = 0
    new_steps: int = 0
    restarts: int = 0
    quarantined: int = 0
    invalid: int = 0
    seconds: dict[str, float] = Field(default_factory=dict)
    curve: tuple[TrainingPoint, ...] = ()
    gate: GateDecision | None = None
    overlay: Overlay | None = None
    video: str = ""


class PooledTest(_Record):
    """Errors of one iteration's model on the test episodes of *all* iterations."""

    arm: Arm
    iteration: int
    model: str
    errors: Errors


class RunResult(_Record):
    """A run so far. The loop saves it after every iteration; reports read it, finished or not.

    Attributes:
      name, key: for people; and the unique key that resume and MLflow find the run by.
      config, config_digest: as resolved and validated; sha256 of it.
      code, versions: of this project; of the engines it stands on.
      robot, robot_digest, length: L is the characteristic length [m].
      iterations: in the order in which they ended, both arms.
      pooled: every model on the pooled test set (filled at the end).
      floor: MuJoCo restarted from the same partial observations, on the pooled test set.
      persistence: "nothing moves", on the same set.
      oracle: MPPI on the plant itself; the ceiling of success.
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
    persistence: Errors | None = None
    oracle: Navigation | None = None
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

    def test_errors(self, result: IterationResult) -> Errors | None:
        """On the pooled test set if that was run, else on the iteration's own test episodes."""
        for pooled in self.pooled:
            if (pooled.arm, pooled.iteration) == (result.arm, result.iteration):
                return pooled.errors
        return result.test

    def save(self, folder: str | Path) -> Path:
        """Write `<folder>/result.json` in one atomic step."""
        return save(self, Path(folder) / RESULT_FILE)

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read `<folder>/result.json`.

        Raises:
          DataError: there is none, or it is not one of ours.
        """
        return load(cls, Path(folder) / RESULT_FILE)


R = TypeVar("R", bound=_Record)


def save(record: _Record, path: Path) -> Path:
    """Write any of these records as JSON, in one atomic and durable step."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with temporary.open("w") as file:
        file.write(record.model_dump_json(indent=1))
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)
    return path


def load(kind: type[R], path: Path) -> R:
    """Read a record that `save` wrote.

    Raises:
      DataError: no such file, or its contents are not such a record.
    """
    try:
        return kind.model_validate_json(path.read_text())
    except FileNotFoundError:
        raise DataError(f"There is no {path.name} in {path.parent}; has the run begun?") from None
    except ValueError as error:
        raise DataError(f"{path} is not a {kind.__name__}: {error}") from None
