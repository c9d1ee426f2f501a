"""Quantiles that several parts of a diagnosis share."""

from __future__ import annotations

from functools import cache

from scipy.stats import chi2

INTERVAL = 1.96  # standard deviations from the middle to either end of a 95 % interval
POWER = (
    1.645  # standard deviations that 95 of 100 draws exceed the mean minus, or stay below it plus
)
RARE = 1e-3  # probability under pure noise below which something is not noise
EXTREMES = (
    1e-3,
    1e3,
)  # thresholds between which tails of chi-square are numbers: beyond, the nearest


@cache
def chance(sizes: int, threshold: float) -> float:
    """Factor on the explanation by several sizes, for the same significance as one.

    Args:
      sizes: degrees of freedom.
      threshold: score from which one size counts as visible.

    Returns:
      The ratio of the quantiles of chi-square with so many degrees of freedom and with one.
    """
    threshold = min(max(threshold, EXTREMES[0]), EXTREMES[1])
    return float(chi2.isf(chi2.sf(threshold, 1), sizes) / threshold)
