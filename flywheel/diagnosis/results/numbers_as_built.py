"""The numbers of a robot as built, as fitted together with an answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.results.verdict import Alternative, Found
from flywheel.records import Floats


@dataclass(frozen=True)
class AsBuiltNumbers:
    """Numbers of the MJCF that are all slightly off.

    The usual standard deviation of each is known before (`AsBuiltSettings`). Together they explain
    more than any effect did; individually most of them are hardly determined by these recordings.

    Attributes:
      numbers: each with its value and its 95 % interval.
      share: most likely fraction of the usual standard deviations.
    """

    numbers: Alternative
    share: float = 1.0

    @property
    def count(self) -> int:
        """Number of values."""
        return len(self._off)

    @property
    def root_mean_square(self) -> float:
        """Of all values, each relative to its usual standard deviation: plausible if about 1 or less."""
        return float(np.sqrt(np.mean(self._off**2)))

    @property
    def farthest(self) -> Alternative:
        """All numbers, largest relative deviation first."""
        return tuple(sorted(self.numbers, key=lambda each: -self._farthest(each)))

    @property
    def _off(self) -> Floats:
        """(n,) all values."""
        return np.concatenate([self._off_by(each) for each in self.numbers])

    def _off_by(self, number: Found) -> Floats:
        """Values of a number relative to its usual standard deviations; a term contains those of
        its fit.
        """
        return self.share * np.array(number.term.values) / np.array(number.term.known)

    def _farthest(self, number: Found) -> float:
        return float(np.abs(self._off_by(number)).max())

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "root_mean_square": self.root_mean_square,
            "share": self.share,
            "numbers": [
                {**each.summary(), "deviations": self._farthest(each)} for each in self.farthest
            ],
        }
