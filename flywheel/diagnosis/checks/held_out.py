"""Errors on recordings that nothing was fitted to but their starts."""

from __future__ import annotations

from collections.abc import Sequence

from flywheel.diagnosis.fitting.baseline import AFTER, refined_fit
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import UnderTest
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.results.diagnosis import Errors
from flywheel.diagnosis.selection.deduplication import places
from flywheel.effects import Terms
from flywheel.records import Trajectory


class HeldOut:
    """Recordings on which answers are only judged.

    Args:
      under_test: what is judged.
      recordings: maybe none.
      fitted_on: windows like which they are cut.
    """

    def __init__(
        self, under_test: UnderTest, recordings: Sequence[Trajectory], fitted_on: Windows
    ) -> None:
        self._under_test, self._recordings = under_test, recordings
        self._seconds, self._sigma = fitted_on.steps * fitted_on.dt, fitted_on.sigma
        self._plant: tuple[Fitter, Fit] | None = None
        self._last: tuple[Fitter, Fit] | None = None

    def errors(self, terms: Terms) -> Errors | None:
        """With terms that stay as they are; None without recordings.

        Starts of a model with all effects of the one before, and more, begin where those ended.
        """
        if not self._recordings:
            return None
        fitter, before = self._fitted(terms)
        self._last = self._with(fitter, before, terms)
        return errors(fitter, before, self._last[1])

    def _fitted(self, terms: Terms) -> tuple[Fitter, Fit]:
        """The model as it was; that of a plant does not depend on the terms, and is kept."""
        if self._plant is not None:
            return self._plant
        under_test = self._under_test
        found = under_test.fitted(self._recordings, self._seconds, self._sigma, around=terms)
        if under_test.model is None:
            self._plant = found
        return found

    def _with(self, fitter: Fitter, before: Fit, terms: Terms) -> tuple[Fitter, Fit]:
        """Starts that fit under other terms, in time steps that will do for them."""
        if terms == before.terms:
            return fitter, before
        if self._plant and self._last and places(self._last[1].terms) < places(terms):
            fitter, fit = self._last
            return fitter, fitter.fit(fitter.under(fit, terms), rounds=AFTER)
        begun = fitter.under_or_anew(before, terms)
        return refined_fit(fitter, begun, self._under_test.seed)


def errors(fitter: Fitter, before: Fit, after: Fit) -> Errors:
    """Of two fits of the same windows."""
    return Errors(fitter.windows.sigma, fitter.rms(before), fitter.rms(after))
