"""One turn of a selection."""

from __future__ import annotations

from dataclasses import dataclass

from flywheel.diagnosis.fitting.jacobian_cache import Linear
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.selection.score_test import Score, ScoreTest
from flywheel.records import Floats

BY_CHANCE = 0.1  # of what a fit leaves beyond noise, that other starts may explain as well


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

    @property
    def left(self) -> float:
        """The same of what the fit left in fact, which promised to become `beyond_noise` and did not."""
        return self.fit.cost - self.test.freedom

    def explained(self, share: float) -> bool:
        """Whether some candidate promises to explain that share of what is left beyond noise.

        And more than a fit that got stuck in cliffs of its cost may win by chance.
        """
        best = max(score.power for score in self.scores)
        return best >= max(share * self.beyond_noise, BY_CHANCE * self.left)
