"""Intervals: uncertainty of a success rate or of a median time, from few episodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from flywheel.errors import DataError
from flywheel.records import Floats

CONFIDENCE = 0.95  # of every interval


@dataclass(frozen=True)
class Interval:
    """An estimate with the ends of its confidence interval."""

    value: float
    low: float
    high: float


def success_interval(
    successes: int, trials: int, method: Literal["wilson", "exact"] = "wilson"
) -> Interval:
    """Success rate with its binomial interval (Wilson's score, or Clopper and Pearson's exact one).

    Without trials the value is NaN and the interval is [0, 1].

    Raises:
      DataError: more successes than trials, or negative numbers.
    """
    if not 0 <= successes <= trials:
        raise DataError(f"Of {trials} trials between 0 and {trials} can succeed, got {successes}.")
    if trials == 0:
        return Interval(float("nan"), 0.0, 1.0)
    ends = stats.binomtest(successes, trials).proportion_ci(CONFIDENCE, method=method)
    return Interval(successes / trials, float(ends.low), float(ends.high))


def rmse_ratio_interval(
    squared: Floats, reference: Floats, seed: int, resamples: int = 2000
) -> Interval:
    """Ratio of one model's RMSE to another's, with an interval by a bootstrap over episodes.

    Whole episodes are drawn, because errors within one are correlated; and both models' errors
    together, because an episode that is hard for one is hard for the other.

    Args:
      squared, reference: (E,) mean squared errors in the same E >= 2 episodes of equal weight.
      seed: of the resampling.

    Raises:
      DataError: shapes differ, or fewer than two episodes.
    """
    both = np.asarray([squared, reference], np.float64)
    if both.ndim != 2 or both.shape[1] < 2:
        raise DataError(f"An interval needs errors of at least 2 episodes, got {both.shape[1:]}.")
    drawn = np.random.default_rng(seed).integers(0, both.shape[1], (resamples, both.shape[1]))
    new, old = both[:, drawn].mean(axis=-1)
    low, high = np.quantile(np.sqrt(new / old), [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    value = np.sqrt(both[0].mean() / both[1].mean())
    return Interval(float(value), float(low), float(high))
