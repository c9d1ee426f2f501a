"""Held-out gain: error reduction by effects on windows that were not fitted.

Windows of held-out recordings are evaluated directly. Of the fitted ones, each is left out in turn:
the shared values without it follow from the linearisation of the fit, without another fit. The
remaining squares are the predicted residual sum of squares (PRESS, Allen 1974).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.held_out import HeldOut, beyond_noise
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.selection.scores import Linearised
from flywheel.records import Floats

RESAMPLES = 4000
ENDS = (0.025, 0.975)
# Of what the model as it was leaves beyond noise, what a draw of windows has at least: some may have none.
LEAST_DRAWN = 0.5
# A value that no other window tells anything of is taken to be within so many typical sizes of zero.
WIDE = 10.0


@dataclass(frozen=True)
class Gain:
    """Error reduction by effects on windows that were not fitted.

    Attributes:
      share: of the initial model's error beyond noise there, as mean squares; NaN if that is zero.
      low, high: ends of its 95 % interval, by a bootstrap over windows.
      clear: it is above zero in 39 of 40 draws of that.
      windows: their number.
      held_out: number of windows in held-out recordings.
    """

    share: float
    low: float
    high: float
    clear: bool
    windows: int
    held_out: int

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        known = np.isfinite(self.share)
        return {
            "share": self.share if known else None,
            "low": self.low if known else None,
            "high": self.high if known else None,
            "clear": self.clear,
            "windows": self.windows,
            "held_out_windows": self.held_out,
        }


class UnseenWindows:
    """Windows outside the fit: each of the fitted ones, left out in turn, and those held out.

    Args:
      fitter: of the fitted ones.
      first: the initial model.
      held_out: held-out recordings.
      seed: of the bootstrap.
    """

    def __init__(self, fitter: Fitter, first: Linearised, held_out: HeldOut, seed: int = 0) -> None:
        self._fitter, self._first, self._held_out, self._seed = fitter, first, held_out, seed
        self._known: list[tuple[Linearised, Floats]] = []

    def gain(self, without: Linearised, model: Linearised) -> Gain:
        """Gain of a model over one without some of its effects, on windows left out in turn."""
        first, less, more = (self._left_out(each) for each in (self._first, without, model))
        return _gain(first, less - more, 0, self._seed)

    def gain_everywhere(self, simpler: Linearised, model: Linearised) -> Gain:
        """Gain of a model over a simpler one, or the initial one, including held-out windows.

        Relative to the better of the two there: the simpler one has numbers of a robot as built,
        which may do harm on windows that were not fitted.
        """
        first, less, more = (self._everywhere(each) for each in (self._first, simpler, model))
        better = min(first, less, key=lambda each: float(each.sum()))
        return _gain(first, better - more, len(first) - len(self._fitter.windows), self._seed)

    def _everywhere(self, model: Linearised) -> Floats:
        """(H + K,) squares of every held-out window, and of every fitted one, left out in turn."""
        return np.concatenate([self._held_out.squares(model.fit.terms), self._left_out(model)])

    def _left_out(self, model: Linearised) -> Floats:
        """(K,) squares of every fitted window, left out in turn; computed once for each model."""
        for known, squares in self._known:
            if known is model:
                return squares
        squares = left_out_squares(self._fitter, model.fit, model.jacobian, model.by_value)
        self._known.append((model, squares))
        return squares


def _gain(first: Floats, gained: Floats, held_out: int, seed: int) -> Gain:
    """Relative reduction of squared error, with a bootstrap interval over K windows."""
    whole, count = float(first.sum()), len(first)
    if not whole > 0.0 or not np.isfinite(gained).all():
        return Gain(np.nan, np.nan, np.nan, False, count, held_out)
    drawn = np.random.default_rng(seed).integers(0, count, (RESAMPLES, count))
    some = gained[drawn].sum(axis=1)
    shares = some / np.maximum(first[drawn].sum(axis=1), LEAST_DRAWN * whole)
    low, high = np.quantile(shares, ENDS)
    clear = bool(np.quantile(some, ENDS[0]) > 0.0)
    return Gain(float(gained.sum()) / whole, float(low), float(high), clear, count, held_out)


def left_out_squares(fitter: Fitter, fit: Fit, jacobian: Jacobian, by_value: Floats) -> Floats:
    """(K,) squares beyond noise of every window, predicted by values fitted to all others.

    Args:
      fitter, fit, jacobian: of the model.
      by_value: (K, D, n) sensitivities to its values.
    """
    alone = Projection.of(fitter, jacobian)
    count = len(fit.local)
    residual = alone(fit.residual[..., None]).reshape(count, -1)
    free = fitter.free(fit.terms)
    columns = alone(by_value).reshape(count, residual.shape[1], len(free))
    values = np.array([f.value(fit.terms) for f in free])
    known = np.array([1.0 / min(f.prior, WIDE) ** 2 for f in free])
    own = np.einsum("kds,kdt->kst", columns, columns, optimize=True)
    right = np.einsum("kds,kd->ks", columns, residual)
    others = own.sum(axis=0) - own + np.diag(known)
    wanted = right.sum(axis=0) - right - known * values
    moved = np.linalg.solve(others, wanted[..., None])
    residual = residual - (columns @ moved)[..., 0]
    return beyond_noise(fitter, (residual**2).sum(axis=1))
