"""What a plant leaves where no start is guessed: windows begin where they fit best."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from flywheel.diagnosis.checks.adequacy import adequacy
from flywheel.diagnosis.comparison.forecast_windows import Moments
from flywheel.diagnosis.fitting.baseline import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.results.limits import THRESHOLD
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.stepwise import Selection
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS

ANY = "winch_gain"  # the test needs a candidate; which one does not matter here


@dataclass(frozen=True)
class FittedStarts:
    """A plant's error where no start is guessed; as at the beginning of `diagnose`.

    Attributes:
      rms: [m], with the starts counted as degrees of freedom.
      noise: variance of what is left; 1 for nothing but noise.
      correlation: of what is left, from sample to sample; 0 for noise.
    """

    rms: float
    noise: float
    correlation: float

    def summary(self) -> dict[str, Any]:
        """As in JSON."""
        return asdict(self)


def fitted_starts(plant: Plant, moments: Moments, seed: int) -> FittedStarts:
    """Fit the starts of windows that tile the recordings.

    Args:
      plant: to be tested.
      moments: whose recordings, window length and noise to use.
      seed: of the search for starts.
    """
    used = [moments.recordings[i].trajectory for i in sorted(set(moments.log))]
    seconds = moments.steps * moments.dt
    windows = Windows.cut(plant.robot, used, seconds, moments.sigma)
    fitter = fitter_of(windows, plant)
    fit = fitted(fitter, plant.terms, seed=seed)
    some = candidates(plant.robot, {ANY: EFFECTS[ANY]})
    selection = Selection(fitter, some, THRESHOLD)
    step = selection.look(fit)
    left = adequacy(fitter, fit, step.test, selection.known(fit))
    return FittedStarts(fitter.rms(fit), left.noise, left.correlation)
