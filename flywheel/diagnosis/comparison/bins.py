"""Squared errors sorted into bins whose parts add up to the whole, exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.evaluation import ExactSum
from flywheel.records import Floats


@dataclass(frozen=True)
class Bins:
    """Squared errors of one kind, in noise variances, sorted by one criterion.

    Attributes:
      of: kind of error: "points" or "cables".
      by: criterion.
      labels: of the bins.
      sums: (n,) of each bin; its mean is 1 for pure noise.
    """

    of: str
    by: str
    labels: tuple[str, ...]
    sums: ExactSum

    @classmethod
    def sort(
        cls, of: str, by: str, labels: Sequence[str], squares: Floats, place: np.ndarray
    ) -> Bins:
        """Sort squares (...), NaN where missing, by the index of each one's bin (...)."""
        place = np.broadcast_to(place, squares.shape)
        parts = [ExactSum.of(squares[place == i]) for i in range(len(labels))]
        sums = ExactSum(
            np.array([p.sums for p in parts], object), np.array([p.count for p in parts])
        )
        return cls(of, by, tuple(labels), sums)

    @property
    def whole(self) -> ExactSum:
        """Over all bins."""
        return self.sums.over(0)

    def worst(self, count: int) -> list[int]:
        """Indices of the bins with the largest means, up to a number."""
        there = np.flatnonzero(self.sums.count)
        order = np.argsort(-self.sums.mean[there], kind="stable")
        return [int(i) for i in there[order[:count]]]

    def summary(self) -> list[dict[str, Any]]:
        """In JSON form."""
        rows = zip(self.labels, self.sums.total, self.sums.count, self.sums.mean, strict=True)
        return [
            {
                "bin": label,
                "sum_of_squares": float(total),
                "count": int(count),
                "mean_square": float(mean) if count else None,
            }
            for label, total, count, mean in rows
        ]
