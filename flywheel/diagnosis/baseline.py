"""Start a fit: first estimates, time steps as short as they have to be, other starts for stuck windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flywheel.diagnosis.fit import Fit, Fitter
from flywheel.diagnosis.prediction import Predictor
from flywheel.diagnosis.start_fit import StartFitter
from flywheel.diagnosis.starts import estimated_starts
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import Terms

# Rounds of a fit before stuck windows begin elsewhere, and after; and in which halved steps must win.
BEFORE, AFTER, COMPARED = 2, 4, 2


def fitter_of(
    windows: Windows, plant: Plant, busy: Callable[[], None] = lambda: None
) -> StartFitter:
    """A fitter that begins with starts estimated from the measurements.

    Args:
      busy: called before every simulation.
    """
    return StartFitter(Predictor(windows, plant, busy), estimated_starts(windows, plant))


def refined_fit(fitter: StartFitter, terms: Terms = (), seed: int = 0) -> tuple[StartFitter, Fit]:
    """Starts that fit, under terms that stay as they are, and a fitter with time steps that will do.

    A plant's own may be too coarse where caps hit the ground. What it does in shorter ones is taken where
    that fits better: recordings of a simulation may well have been made in the plant's own.
    """
    fit, better = fitter.fit(fitter.beginning(terms), rounds=BEFORE), True
    while better and (coarse := fitter.coarse(fit)).any():
        finer = fitter.refined(coarse)
        held = None if fit.held is None else fit.held | coarse
        other = replace(finer.under(fit, terms), held=held)
        for _ in range(COMPARED):
            fit, other = fitter.fit(fit, rounds=1), finer.fit(other, rounds=1)
            if better := other.cost < fit.cost:
                fitter, fit = finer, other
                break
    return fitter, fitter.fit(fitter.elsewhere(fit, seed), rounds=AFTER)


def fitted(fitter: Fitter, terms: Terms = (), rounds: int = AFTER, seed: int = 0) -> Fit:
    """Starts that fit, under terms that stay as they are."""
    return settled(fitter, fitter.beginning(terms), rounds, seed)


def settled(fitter: Fitter, fit: Fit, rounds: int = AFTER, seed: int = 0) -> Fit:
    """A fit whose starts were fitted under its terms, those that got stuck from elsewhere."""
    fit = fitter.elsewhere(fitter.fit(fit, rounds=BEFORE), seed)
    return fitter.fit(fit, rounds=rounds)
