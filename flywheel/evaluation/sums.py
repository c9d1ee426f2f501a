"""Sums that do not depend on the order of their terms, so that partial sums add exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.records import Floats

LARGEST = 2.0**20  # a single value beyond this is counted as this: its model is useless anyway
_HIGH_BITS, _LOW_BITS = 20, 40  # fraction bits of `high`, and further ones of `low`
_LOW_ONE = 1 << _LOW_BITS


@dataclass(frozen=True)
class ExactSum:
    """Sums of numbers >= 0 and how many numbers they are of.

    Floating-point addition depends on the order; integers do not. Each value is cut to a multiple
    of 2**-60 and kept as `high * 2**-20 + low * 2**-60`. Room for 2**23 of the largest values.

    Attributes:
      high: (...) int64, in units of 2**-20.
      low: (...) int64, in units of 2**-60, in [0, 2**40).
      count: (...) int64, the weights: how many values were present.
    """

    high: NDArray[np.int64]
    low: NDArray[np.int64]
    count: NDArray[np.int64]

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> ExactSum:
        """The empty sum."""
        return cls(*(np.zeros(shape, np.int64) for _ in range(3)))

    @classmethod
    def of(cls, values: Floats, axis: int = 0) -> ExactSum:
        """Sum `values` over `axis`. NaN is missing; values are >= 0 and cut off at `LARGEST`."""
        values = np.asarray(values, np.float64)
        present = ~np.isnan(values)
        scaled = np.clip(np.where(present, values, 0.0), 0.0, LARGEST) * (1 << _HIGH_BITS)
        high = np.floor(scaled)
        low = np.floor((scaled - high) * _LOW_ONE)
        parts = (high.astype(np.int64), low.astype(np.int64), present.astype(np.int64))
        return _carried(*(part.sum(axis=axis) for part in parts))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the sums."""
        return self.count.shape

    @property
    def total(self) -> Floats:
        """The sums as floats, rounded once."""
        return self.high / (1 << _HIGH_BITS) + self.low / (1 << (_HIGH_BITS + _LOW_BITS))

    @property
    def mean(self) -> Floats:
        """Sum over count; NaN where nothing was present."""
        return np.divide(
            self.total, self.count, out=np.full(self.shape, np.nan), where=self.count > 0
        )

    def over(self, axis: int | tuple[int, ...]) -> ExactSum:
        """Add up along `axis`."""
        return _carried(*(part.sum(axis=axis) for part in (self.high, self.low, self.count)))

    def __add__(self, other: ExactSum) -> ExactSum:
        """Element-wise. The shorter of the two is continued by zeros along the first axis."""
        length = max(self.shape[0], other.shape[0])
        mine, theirs = self._lengthened(length), other._lengthened(length)
        return _carried(mine.high + theirs.high, mine.low + theirs.low, mine.count + theirs.count)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ExactSum):
            return NotImplemented
        mine, theirs = (self.high, self.low, self.count), (other.high, other.low, other.count)
        return all(np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def _lengthened(self, length: int) -> ExactSum:
        pad = [(0, length - self.shape[0])] + [(0, 0)] * (len(self.shape) - 1)
        return ExactSum(*(np.pad(part, pad) for part in (self.high, self.low, self.count)))


def _carried(high: NDArray, low: NDArray, count: NDArray) -> ExactSum:
    return ExactSum(
        np.asarray(high + (low >> _LOW_BITS)), np.asarray(low & (_LOW_ONE - 1)), np.asarray(count)
    )
