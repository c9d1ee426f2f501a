"""Sensitivities of a fit that are held while it moves on, and what is known of them by then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from flywheel.records import Floats

SHARED_DAMPING = (0.0, 0.1, 1.0, 10.0, 100.0, np.inf)  # of what windows share, one after the other
# Of a window's own steps: at first, and at most with new sensitivities.
OWN_DAMPING, FRESH_DAMPING = 0.1, 1.0
# Where a window went otherwise than its sensitivities said: share of the way, and square [sigma^2].
ASTRAY, UNNOTICED = 0.3, 0.3


@dataclass(frozen=True)
class Linear:
    """How residuals depend on what is unknown about windows, in sigmas; X unknowns per window.

    Attributes:
      by_start: (K, D, X) change of the prediction with each of them.
      by_winch: (K, D, W) with the offsets of the winches of the window's log.
    """

    by_start: Floats
    by_winch: Floats


@dataclass(frozen=True)
class Held:
    """Sensitivities that were computed somewhere on the way to a fit, and how far they were followed.

    Attributes:
      linear: they.
      stale: (K,) windows that went otherwise than they said.
      own: (K,) damping that suited each window's last step.
      common: index of the damping that suited the last step of what windows share.
      bold: no such step was taken with these sensitivities yet.
      number: how often they were computed anew.
    """

    linear: Linear
    stale: np.ndarray
    own: Floats
    common: int = 0
    bold: bool = True
    number: int = 0

    @classmethod
    def fresh(cls, linear: Linear, before: Held | None = None) -> Held:
        """Of which nothing is known against them; windows that were damped less `before` still are."""
        fresh = np.zeros(len(linear.by_start), bool)
        if before is None:
            return cls(linear, fresh, np.full(len(fresh), OWN_DAMPING))
        own = np.minimum(before.own, FRESH_DAMPING)
        return cls(linear, fresh, own, before.common, number=before.number + 1)

    def __or__(self, stale: np.ndarray) -> Held:
        """With further stale windows (K,)."""
        return replace(self, stale=self.stale | stale)

    @property
    def tried(self) -> list[int]:
        """Indices of the dampings of what windows share, in the order in which they are tried.

        From a little less than suited the last time; before that, with new sensitivities, the least of all.
        """
        usual = list(range(max(0, self.common - 1), len(SHARED_DAMPING)))
        return [0, *usual] if self.bold and usual[0] > 0 else usual


def astray(before: Floats, promised: Floats, after: Floats) -> np.ndarray:
    """(K,) windows whose residuals (K, D) are not what was promised."""
    off, went = ((after - x) ** 2 for x in (promised, before))
    return np.asarray(off.sum(axis=1) > np.maximum(ASTRAY**2 * went.sum(axis=1), UNNOTICED))
