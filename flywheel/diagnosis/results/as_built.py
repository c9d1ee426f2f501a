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

    Each is known to its standard deviation before (`AsBuiltSettings`). Together they explain more than any
    effect did; one by one these recordings say little of most of them.

    Attributes:
      numbers: each with its value and its 95 % interval.
    """

    numbers: Alternative

    @property
    def count(self) -> int:
        """How many values there are."""
        return len(self._off)

    @property
    def root_mean_square(self) -> float:
        """Of all values, each in its own standard deviations: about 1 or less where these are believable."""
        return float(np.sqrt(np.mean(self._off**2)))

    @property
    def farthest(self) -> Alternative:
        """All numbers, the one that is off by the most of its standard deviations first."""
        return tuple(sorted(self.numbers, key=lambda each: -_farthest(each)))

    @property
    def _off(self) -> Floats:
        """(n,) values in standard deviations of what was known of them."""
        return np.concatenate([_off(each) for each in self.numbers])

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "root_mean_square": self.root_mean_square,
            "numbers": [
                {**each.summary(), "deviations": _farthest(each)} for each in self.farthest
            ],
        }


def _off(number: Found) -> Floats:
    return np.array(number.term.values) / np.array(number.term.known)


def _farthest(number: Found) -> float:
    return float(np.abs(_off(number)).max())
