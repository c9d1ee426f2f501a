"""The parts of a result: errors, success, walks, training curves and decisions, as plain numbers.

Frozen pydantic records with a JSON round trip. Paths and overlays are thinned in time. A value that
could not be measured is None; one that came out non-finite is kept as it is (JSON "NaN"). Position
errors are given as MSE/L and as RMSE/L [%], as defined in `flywheel.evaluation.errors`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import PurePosixPath
from types import MappingProxyType
from typing import Annotated, Any, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict

from flywheel.effects import WrittenTerm
from flywheel.evaluation.errors import ErrorTable
from flywheel.evaluation.intervals import success_interval
from flywheel.robots import Box


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


class DiagnosisNote(ResultRecord):
    """What a diagnosis between two iterations said, and what came of it.

    Attributes:
      verdict: in a word.
      effects: of the plant from here on.
      adopted: they are not those of before.
      reason: for people.
      noise, baseline, augmented: root mean square of measured minus predicted, starts fitted, with
        the plant as it was and with the answer; on the recordings that were fitted [m].
      held_out_baseline, held_out_augmented: on those kept for tests; None without any [m].
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

    @property
    def diverged(self) -> bool:
        """Whether a rollout was not finite, so that there is no error to speak of."""
        return math.isnan(self.e_pos_rmse)

    @property
    def turnless(self) -> bool:
        """Whether nothing tells how bodies are turned, where each has one tracked point: no `e_rot`."""
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
        rows = np.arange(len(lead.seconds))[::-1][::stride][::-1]
        return cls(
            seconds=tuple(lead.seconds[rows].tolist()),
            e_pos_mse=tuple(lead.e_pos_mse[rows].tolist()),
            e_pos_rmse=tuple(lead.e_pos_rmse[rows].tolist()),
            e_rot=tuple(lead.e_rot[rows].tolist()),
        )


class Errors(ResultRecord):
    """A dynamics model's errors on one set of episodes.

    Attributes:
      short: from random starts.
      full: over whole episodes; None where it was not run.
      by_lead_time: of the short horizon.
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
        """From the tables of `evaluation.score` and `evaluation.score_full`."""
        return cls(
            short=ErrorNumbers.of(short),
            full=None if full is None else ErrorNumbers.of(full),
            by_lead_time=LeadTimes.of(short),
            by_episode={name: table.e_pos_mse for name, table in by_episode.items()},
        )


class Walk(ResultRecord):
    """One evaluation episode seen from above.

    Attributes:
      path: (x, y) of the CoM [m], thinned to about two per second.
      goal: (x, y) [m].
      reached: in time.
      seconds: to the goal, or to the end of the episode [s].
      distance: to the goal at the end [m].
      obstacles: that it went among.
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


class TrainingPoint(ResultRecord):
    """One point of the training curve; `validation_*` where a validation was due."""

    step: int
    loss: float
    learning_rate: float | None = None
    validation_e_pos_rmse: float | None = None
    validation_e_rot: float | None = None
    seconds: float = 0.0


class GateDecision(ResultRecord):
    """Whether this iteration's model became the champion.

    Attributes:
      promoted: the alias was moved.
      measure: what was compared, with its unit ("validation e_rot at 2 s [deg]").
      number: of the candidate.
      reference: of the champion so far; None for the first.
      ratio, low, high: number over reference, with its 95 % interval; None where unknown.
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
