"""What a plant leaves where no initial state is guessed: windows begin where they fit best."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from flywheel.diagnosis.checks.adequacy import adequacy
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.model import fitted, fitter_of
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.results.verdict import only_noise
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS

# Times the noise, below which it is no physics: the robot of a simulator with another time step has as much.
LOUD = 1.10
ANY = "winch_gain"  # the test needs a candidate; which one does not matter here


@dataclass(frozen=True)
class FittedStarts:
    """A plant's error where no initial state is guessed; as at the beginning of `diagnose`.

    Attributes:
      rms: [m], with the initial states counted as degrees of freedom.
      noise: variance of what is left; 1 for nothing but noise.
      correlation: of what is left, from sample to sample; 0 for noise.
      only_noise: nothing but noise is left, by the limits of a diagnosis.
    """

    rms: float
    noise: float
    correlation: float
    only_noise: bool

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
    tracks = windows.tracks
    used = [tracks[i] for i in sorted(set(windows.recording.tolist()))]
    seconds = windows.steps * windows.dt
    cut = Windows.cut(plant.robot, used, seconds, windows.sigma, settings.windows)
    fitter = fitter_of(cut, plant, settings=settings.fitting)
    fit = fitted(fitter, plant.terms, seed=seed)
    some, limits = candidates(plant.robot, {ANY: EFFECTS[ANY]}), settings.limits
    search = Search(fitter, some, limits.threshold, settings.selection, seed=seed)
    model = search.score_all(fit)
    left = adequacy(fitter, fit, model.test, model.by_value, settings.checks)
    only = only_noise(replace(limits, max_residual_variance=LOUD), left)
    return FittedStarts(fitter.rms(fit), left.noise, left.correlation, only)
