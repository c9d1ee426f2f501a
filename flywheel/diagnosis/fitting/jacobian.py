"""Finite differences: how what a plant predicts depends on how its windows begin."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.jacobian_cache import Linear
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.simulation import Predictor
from flywheel.records import Floats, State

STEP = 2e-3  # of a difference of a start, in natural units
WINCH_STEP = 1e-3  # of one of a winch's offset [L]


class Differences:
    """Sensitivities of a plant's predictions, precise ones or rough ones.

    Precise ones are differences of both sides, in the time steps of each window. Rough ones, for a fit
    on its way, are of one side and in `hasty` steps of the plant's own length: less than half the price, and
    half of that again where windows have steps of half the length. They only say which way to go; what is
    left is simulated as it has to be.

    Args:
      predictor: of the windows.
      first: (K,) the starts that changes count from.
    """

    def __init__(self, predictor: Predictor, first: State) -> None:
        self._predictor, self._first = predictor, first
        self._rough = predictor.roughly()

    def precise(self, fit: Fit, members: np.ndarray) -> Linear:
        """Of windows `members` (n,) around a fit."""
        predictor, change = self._predictor, fit.change[members]
        ahead, behind = (self._aside(predictor, fit, members, change, s) for s in (STEP, -STEP))
        by_start = predictor.windows.slope(ahead - behind, 2 * STEP, members)
        return Linear(by_start, self._by_winch(predictor, fit, members, fit.points[members]))

    def rough(self, fit: Fit, members: np.ndarray, step: float) -> Linear:
        """The same, roughly, with differences of a `step`."""
        change = fit.change[members]
        predictor, here = self._begun(fit, members, change)
        by_start = self._of_one_side(predictor, fit, members, change, here, step)
        return Linear(by_start, self._by_winch(predictor, fit, members, here))

    def roughly_by_start(
        self, fit: Fit, members: np.ndarray, change: Floats, step: float
    ) -> Floats:
        """(n, D, X) of windows `members` (n,) at changes (n, X), with differences of a `step`."""
        predictor, here = self._begun(fit, members, change)
        return self._of_one_side(predictor, fit, members, change, here, step)

    def _begun(self, fit: Fit, members: np.ndarray, change: Floats) -> tuple[Predictor, Floats]:
        """What rough differences are taken with, and the points of windows at changes there.

        Windows that diverge in such steps keep their own.
        """
        predictor, states = self._rough, self._predictor.moved(self._first[members], change)
        here = predictor.parallel(states, fit.carried, fit.terms, members)
        lost = ~np.isfinite(here).all(axis=(1, 2, 3))
        if lost.any():
            able = ~np.isin(np.arange(len(predictor.windows)), members[lost])
            predictor = self._predictor.roughly(able)
            here = predictor.parallel(states, fit.carried, fit.terms, members)
        return predictor, here

    def _of_one_side(
        self,
        predictor: Predictor,
        fit: Fit,
        members: np.ndarray,
        change: Floats,
        here: Floats,
        step: float,
    ) -> Floats:
        """(n, D, X) of windows that a predictor predicts `here`."""
        aside = self._aside(predictor, fit, members, change, step)
        return predictor.windows.slope(aside - here[:, None], step, members)

    def _aside(
        self, predictor: Predictor, fit: Fit, members: np.ndarray, change: Floats, step: float
    ) -> Floats:
        """(n, X, steps + 1, P, 3) points of windows at changes (n, X), with a step in each entry [m]."""
        size = predictor.tangent
        rows = np.repeat(members, size)
        tried = (change[:, None] + step * np.eye(size)).reshape(-1, size)
        states = predictor.moved(self._first[rows], tried)
        points = predictor.parallel(states, fit.carried, fit.terms, rows)
        return points.reshape(len(members), size, *points.shape[1:])

    def _by_winch(
        self, predictor: Predictor, fit: Fit, members: np.ndarray, here: Floats
    ) -> Floats:
        """(n, D, W) with winches aside from where windows, predicted `here`, begin."""
        winches, offset = fit.starts.winch.shape[1], WINCH_STEP * predictor.length
        rows = np.repeat(members, winches)
        shifted = fit.carried.winch[rows] + offset * np.tile(np.eye(winches), (len(members), 1))
        starts = fit.starts.mechanics[rows]
        points = predictor.parallel(starts, fit.carried, fit.terms, rows, shifted)
        points = points.reshape(len(members), winches, *points.shape[1:])
        return predictor.windows.slope(points - here[:, None], offset, members)
