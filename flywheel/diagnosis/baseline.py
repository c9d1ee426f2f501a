"""Start a fit: first estimates, and another try where a window got stuck."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.prediction import Predictor
from flywheel.diagnosis.starts import estimated_starts
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant, refined, turning
from flywheel.effects import Terms
from flywheel.records import Floats

STUCK = 1.3  # mean square of a window, over the median one, from which its start is doubted
TRIES = 4  # other starts for such a window
TURN = 0.4  # standard deviation of their turns [rad]


def fitter_of(windows: Windows, plant: Plant) -> Fitter:
    """A fitter that begins with starts estimated from the measurements."""
    finer = Predictor(windows, refined(plant))
    return Fitter(Predictor(windows, plant), estimated_starts(windows, plant), finer)


def fitted(fitter: Fitter, terms: Terms = (), rounds: int = 4, seed: int = 0) -> Fit:
    """Starts that fit, under terms that stay as they are."""
    fit = unstuck(fitter, fitter.fit(fitter.beginning(terms), rounds=2), seed)
    return fitter.fit(fit, rounds=rounds)


def unstuck(fitter: Fitter, fit: Fit, seed: int = 0) -> Fit:
    """A fit in which windows that fit much worse than the others begin elsewhere, if that is better.

    They may have begun in a wrong place, or have been led there by a wrong model: they are tried from
    their first estimates, and with their bodies turned at random.
    """
    square = mean_squares(fitter, fit)
    stuck = np.flatnonzero(square > STUCK * max(1.0, float(np.median(square))))
    if not len(stuck):
        return fit
    members = np.repeat(stuck, TRIES)
    tried = turned(fitter, fit.change[members], seed)
    nowhere = np.zeros((len(stuck), tried.shape[1]))
    return fitter.searched(fit, np.concatenate([members, stuck]), np.concatenate([tried, nowhere]))


def turned(fitter: Fitter, change: Floats, seed: int) -> Floats:
    """Changes (n, X) with random turns of the bodies added."""
    angles = turning(fitter.predictor.plant)
    angles = np.concatenate([angles, np.zeros_like(angles)])
    noise = np.random.default_rng(seed).normal(0.0, TURN, change.shape)
    return change + np.where(angles, noise, 0.0)


def mean_squares(fitter: Fitter, fit: Fit) -> Floats:
    """(K,) mean square residual of each window [sigma^2]."""
    measured = np.isfinite(fitter.predictor.windows.measured).sum(axis=(1, 2, 3))
    return np.asarray((fit.residual**2).sum(axis=1) / np.maximum(measured, 1))
