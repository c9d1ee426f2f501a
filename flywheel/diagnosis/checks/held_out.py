"""Errors on recordings with only the initial states fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import ModelUnderTest, fitted_and_refined
from flywheel.diagnosis.fitting.multistart import AFTER, restarted_where_loud
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import places
from flywheel.effects import Terms
from flywheel.records import Floats, Trajectory


@dataclass(frozen=True)
class Errors:
    """Root mean square of measured minus predicted, with fitted initial states [m].

    Attributes:
      noise: of the measurements.
      baseline: of the initial plant.
      augmented: with the identified effects.
    """

    noise: float
    baseline: float
    augmented: float

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {
            "noise": self.noise,
            "baseline": self.baseline,
            "augmented": self.augmented,
            "unit": "m",
        }


def errors(fitter: Fitter, before: Fit, after: Fit) -> Errors:
    """The errors of two fits of the same windows."""
    return Errors(fitter.windows.noise, fitter.rms(before), fitter.rms(after))


class HeldOut:
    """Recordings for the evaluation of answers.

    Args:
      under_test: model.
      recordings: may be empty.
      fitted_on: windows whose length is used.
    """

    def __init__(
        self, under_test: ModelUnderTest, recordings: Sequence[Trajectory], fitted_on: Windows
    ) -> None:
        self._under_test, self._recordings = under_test, recordings
        self._seconds, self._like = fitted_on.steps * fitted_on.dt, fitted_on
        self._plant: tuple[Fitter, Fit] | None = None
        self._last: tuple[Fitter, Fit, Fit] | None = None

    def errors(self, terms: Terms) -> Errors | None:
        """The errors with constant terms; None without recordings.

        Initial states of a model that extends the previous one start from its results.
        """
        return errors(*self._fits(terms)) if self._recordings else None

    def squares(self, terms: Terms) -> Floats:
        """(K,) squares of every window beyond noise, likewise [sigma^2]; (0,) without recordings."""
        if not self._recordings:
            return np.zeros(0)
        fitter, _, fit = self._fits(terms)
        return beyond_noise(fitter, (fit.residual**2).sum(axis=1) + fitter.local_cost(fit.local))

    def _fits(self, terms: Terms) -> tuple[Fitter, Fit, Fit]:
        """A fitter, the initial model, and the model with terms."""
        if self._last is None or self._last[2].terms != terms:
            fitter, before = self._fitted(terms)
            fitter, fit = self._with(fitter, before, terms)
            self._last = fitter, before, fit
        return self._last

    def _fitted(self, terms: Terms) -> tuple[Fitter, Fit]:
        """The initial model; that of a plant does not depend on the terms, and is cached."""
        if self._plant is not None:
            return self._plant
        under_test = self._under_test
        found = under_test.fitted(
            self._recordings,
            self._seconds,
            self._like.noise,
            around=terms,
            discrepancy=self._like.discrepancy,
        )
        if under_test.model is None:
            fitter, fit = found
            if not fitter.worthwhile(fit):  # of a clearly wrong model, other starts were tried
                fit = self._begun_elsewhere(fitter, fit)
            self._plant = found = fitter, fit
        return found

    def _with(self, fitter: Fitter, before: Fit, terms: Terms) -> tuple[Fitter, Fit]:
        """Initial states that fit under other terms, in sufficiently short time steps."""
        if terms == before.terms:
            return fitter, before
        fits = self._last if self._plant else None
        if fits and before.terms != fits[2].terms and places(fits[2].terms) < places(terms):
            fitter, _, fit = fits
            return fitter, fitter.fit(fitter.with_terms(fit, terms), rounds=AFTER)
        begun = fitter.warm_start(before, terms)
        fitter, fit = fitted_and_refined(fitter, begun, self._under_test.seed)
        return fitter, self._begun_elsewhere(fitter, fit)

    def _begun_elsewhere(self, fitter: Fitter, fit: Fit) -> Fit:
        """A fit whose windows with large residuals start elsewhere, if that helps."""
        begun = restarted_where_loud(fitter, fit, self._under_test.seed)
        return fit if begun is fit else fitter.fit(begun, rounds=AFTER)


def beyond_noise(fitter: Fitter, squares: Floats) -> Floats:
    """(K,) squares beyond those of noise with fitted local parameters [sigma^2]."""
    freedom = fitter.windows.noisy_in_each - fitter.taken
    noise = (fitter.windows.noise / fitter.windows.sigma) ** 2
    return np.asarray(squares - noise * np.maximum(freedom, 0.0))
