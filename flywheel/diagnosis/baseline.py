"""Start a fit: first estimates, and another try where a window got stuck."""

from __future__ import annotations

from collections.abc import Callable

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.prediction import Predictor
from flywheel.diagnosis.start_fit import StartFitter
from flywheel.diagnosis.starts import estimated_starts
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant, refined
from flywheel.effects import Terms


def fitter_of(
    windows: Windows, plant: Plant, busy: Callable[[], None] = lambda: None
) -> StartFitter:
    """A fitter that begins with starts estimated from the measurements.

    Args:
      busy: called before every simulation.
    """
    coarse, finer = (Predictor(windows, each, busy) for each in (plant, refined(plant)))
    return StartFitter(coarse, estimated_starts(windows, plant), finer)


def fitted(fitter: Fitter, terms: Terms = (), rounds: int = 4, seed: int = 0) -> Fit:
    """Starts that fit, under terms that stay as they are."""
    return settled(fitter, fitter.beginning(terms), rounds, seed)


def settled(fitter: Fitter, fit: Fit, rounds: int = 4, seed: int = 0) -> Fit:
    """A fit whose starts were fitted under its terms, those that got stuck from elsewhere."""
    fit = fitter.elsewhere(fitter.fit(fit, rounds=2), seed)
    return fitter.fit(fit, rounds=rounds)
