"""One turn of a selection."""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.diagnosis.fit import Fit
from flywheel.diagnosis.held import Linear
from flywheel.diagnosis.score import Score, ScoreTest
from flywheel.records import Floats


@dataclass(frozen=True)
class Step:
    """One turn of the selection: the model so far, and what the test says of it.

    Attributes:
      fit: the model.
      linear: its sensitivities.
      sizes: (K, D, n) its sensitivities to its values; None without any.
      test: of every candidate and every probe on top of it.
      scores: of every candidate, best first.
      probes: of every probe, see `probes`.
    """

    fit: Fit
    linear: Linear
    sizes: Floats | None
    test: ScoreTest
    scores: tuple[Score, ...]
    probes: tuple[Score, ...]

    @property
    def beyond_noise(self) -> float:
        """What the model leaves, beyond noise: sum of squares [sigma^2]; may be a little below zero."""
        return (self.test.noise - 1.0) * self.test.freedom

    def explained(self, share: float) -> bool:
        """Whether some candidate promises to explain that share of what is left beyond noise."""
        return max(score.power for score in self.scores) >= share * self.beyond_noise
