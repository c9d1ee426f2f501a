"""What a plant leaves where no initial state is guessed: windows begin where they fit best."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from flywheel.diagnosis.checks.adequacy import adequacy
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS

ANY = "winch_gain"  # the test needs a candidate; which one does not matter here


@dataclass(frozen=True)
class FittedStarts:
    """A plant's error where no initial state is guessed; as at the beginning of `diagnose`.

    Attributes:
      rms: [m], with the initial states counted as degrees of freedom.
      noise: variance of what is left; 1 for nothing but noise.
      correlation: of what is left, from sample to sample; 0 for noise.
    """

    rms: float
    noise: float
    correlation: float

    def summary(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)


def fitted_starts(
    plant: Plant, windows: ForecastWindows, seed: int, settings: Settings = Settings()
) -> FittedStarts:
    """Fit the initial states of windows that tile the recordings.

    Args:
      plant: to be tested.
      windows: whose recordings, window length and noise to use.
      seed: of the search for initial states.
      settings: tuned numbers, as of a diagnosis.
    """
    used = [windows.recordings[i].trajectory for i in sorted(set(windows.recording))]
    seconds = windows.steps * windows.dt
    cut = Windows.cut(plant.robot, used, seconds, windows.sigma, settings.windows)
    fitter = fitter_of(cut, plant, settings=settings.fitting)
    fit = fitted(fitter, plant.terms, seed=seed)
    some = candidates(plant.robot, {ANY: EFFECTS[ANY]})
    search = Search(fitter, some, settings.limits.threshold, settings.selection, seed=seed)
    model = search.score_all(fit)
    left = adequacy(fitter, fit, model.test, model.by_value, settings.checks)
    return FittedStarts(fitter.rms(fit), left.noise, left.correlation)
