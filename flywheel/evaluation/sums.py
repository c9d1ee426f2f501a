"""Sums independent of the order of their terms, so that partial sums add exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.records import Floats

LARGEST = 2.0**300  # a larger value counts as this: squares of what float32 holds are smaller
_UNIT_BITS = 60  # fraction bits of a sum
_PART_BITS = 40  # of a value that are summed at once; so int64 has room for 2**23 values


@dataclass(frozen=True)
class ExactSum:
    """Sums of numbers >= 0, and the count of these numbers.

    Floating-point addition depends on the order; integers do not. Each value is cut to a multiple
    of 2**-60, and sums are Python's integers, large enough for any number of the largest values.

    Attributes:
      sums: (...) Python integers (dtype object), in units of 2**-60.
      count: (...) int64, the number of present values.
    """

    sums: NDArray[np.object_]
    count: NDArray[np.int64]

    @classmethod
    def zeros(cls, shape: tuple[int, ...]) -> ExactSum:
        """The empty sum."""
        return cls(np.zeros(shape, object), np.zeros(shape, np.int64))

    @classmethod
    def of(cls, values: Floats, axis: int = 0) -> ExactSum:
        """Sum `values` over `axis`. NaN is missing; values are >= 0 and cut off at `LARGEST`."""
        values = np.asarray(values, np.float64)
        present = ~np.isnan(values)
        left = np.clip(np.where(present, values, 0.0), 0.0, LARGEST)
        count = np.asarray(present.sum(axis=axis))
        sums = np.zeros(count.shape, object)
        bits = int(np.frexp(left.max(initial=0.0))[1]) + _UNIT_BITS  # of the largest, in units
        for place in reversed(range(0, bits, _PART_BITS)):
            part = np.floor(np.ldexp(left, _UNIT_BITS - place))
            left = left - np.ldexp(part, place - _UNIT_BITS)
            sums = sums + part.astype(np.int64).sum(axis=axis).astype(object) * (1 << place)
        return cls(np.asarray(sums, object), count)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the sums."""
        return self.count.shape

    @property
    def total(self) -> Floats:
        """The sums as floats, rounded once."""
        return np.asarray(self.sums / (1 << _UNIT_BITS), np.float64)

    @property
    def mean(self) -> Floats:
        """Sum over count; NaN without values."""
        return np.divide(
            self.total, self.count, out=np.full(self.shape, np.nan), where=self.count > 0
        )

    def over(self, axis: int | tuple[int, ...]) -> ExactSum:
        """Add up along `axis`."""
        return ExactSum(
            np.asarray(self.sums.sum(axis=axis), object), np.asarray(self.count.sum(axis=axis))
        )

    def __add__(self, other: ExactSum) -> ExactSum:
        """Element-wise. The shorter of the two is extended by zeros along the first axis."""
        length = max(self.shape[0], other.shape[0])
        mine, theirs = self._lengthened(length), other._lengthened(length)
        return ExactSum(mine.sums + theirs.sums, mine.count + theirs.count)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ExactSum):
            return NotImplemented
        return np.array_equal(self.sums, other.sums) and np.array_equal(self.count, other.count)

    __hash__ = None  # type: ignore[assignment]

    def _lengthened(self, length: int) -> ExactSum:
        more = ExactSum.zeros((length - self.shape[0], *self.shape[1:]))
        return ExactSum(
            np.concatenate([self.sums, more.sums]), np.concatenate([self.count, more.count])
        )
