"""Start a fit: first estimates, time steps as short as they have to be, other starts for stuck windows."""

from __future__ import annotations

from collections.abc import Callable

from flywheel.diagnosis.fitting.initial_states import estimated_starts
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.multistart import begun_elsewhere
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.refinement import F, shorter_steps
from flywheel.diagnosis.fitting.simulation import Predictor
from flywheel.diagnosis.fitting.stopping import worth_a_round
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import Terms

BEFORE, AFTER = 2, 4  # rounds of a fit before stuck windows begin elsewhere, and after


def fitter_of(
    windows: Windows, plant: Plant, busy: Callable[[], None] = lambda: None
) -> StartFitter:
    """A fitter that begins with starts estimated from the measurements.

    Args:
      busy: called before every simulation.
    """
    return StartFitter(Predictor(windows, plant, busy), estimated_starts(windows, plant))


def refined_fit(fitter: F, begun: Fit, seed: int = 0) -> tuple[F, Fit]:
    """Starts that fit, under terms that stay as they are, and a fitter with time steps that will do."""
    fitter, fit = shorter_steps(fitter, fitter.fit(begun, rounds=BEFORE))
    return fitter, fitter.fit(fitter.elsewhere(fit, seed), rounds=AFTER)


def baseline_fit(fitter: F, begun: Fit, seed: int = 0, calibrated: bool = True) -> tuple[F, Fit]:
    """The same of a model that may lack an effect.

    If it is clearly wrong, its starts are not sought everywhere, nor fitted to the last digit; nor are
    time steps, if it is yet to be `calibrated`.
    """
    fit = fitter.fit(begun, rounds=BEFORE)
    if not calibrated and worth_a_round(fitter, fit):
        return fitter, fit
    fitter, fit = shorter_steps(fitter, fit)
    fit = begun_elsewhere(fitter, fit, seed)
    return fitter, fitter.fit(fit, rounds=AFTER, enough=worth_a_round(fitter, fit))


def fitted(fitter: Fitter, terms: Terms = (), rounds: int = AFTER, seed: int = 0) -> Fit:
    """Starts that fit, under terms that stay as they are, in the time steps that the fitter has."""
    fit = fitter.fit(fitter.beginning(terms), rounds=BEFORE)
    return fitter.fit(fitter.elsewhere(fit, seed), rounds=rounds)
