"""The numbers of a robot as it was built, as fitted beside an answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.results.verdict import Alternative, Found
from flywheel.records import Floats


@dataclass(frozen=True)
class AsBuiltNumbers:
    """Numbers of the MJCF that are all a little off.

    Of each its usual standard deviation is known before (`AsBuiltSettings`). Together they explain more than
    any effect did; one by one these recordings say little of most of them.

    Attributes:
      numbers: each with its value and its 95 % interval.
      share: of the usual deviations, that these recordings are most likely with.
    """

    numbers: Alternative
    share: float = 1.0

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self._off)

    @property
    def root_mean_square(self) -> float:
        """Of all values, each in its usual deviations: about 1 or less where these are believable."""
        return float(np.sqrt(np.mean(self._off**2)))

    @property
    def farthest(self) -> Alternative:
        """All numbers, the one that is off by the most of its standard deviations first."""
        return tuple(sorted(self.numbers, key=lambda each: -self._farthest(each)))

    @property
    def _off(self) -> Floats:
        """(n,) all values."""
        return np.concatenate([self._off_by(each) for each in self.numbers])

    def _off_by(self, number: Found) -> Floats:
        """Values of a number in its usual standard deviations; a term has those that it was fitted with."""
        return self.share * np.array(number.term.values) / np.array(number.term.known)

    def _farthest(self, number: Found) -> float:
        return float(np.abs(self._off_by(number)).max())

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "root_mean_square": self.root_mean_square,
            "share": self.share,
            "numbers": [
                {**each.summary(), "deviations": self._farthest(each)} for each in self.farthest
            ],
        }
