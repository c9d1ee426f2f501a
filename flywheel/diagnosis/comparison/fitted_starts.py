"""Error of a plant without guessed initial states: windows start where they fit best."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.checks.adequacy import adequacy, astray, mostly
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.initial_states import estimated_initial_states
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.fitting.model import fitted
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.simulation import WindowSimulator
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.results.verdict import only_noise
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.records import Floats

# Times the noise, below which it is no physics: the robot of a simulator with another time step has as much.
LOUD = 1.10
ANY = "winch_gain"  # the test needs a candidate; which one does not matter here


@dataclass(frozen=True)
class FittedStarts:
    """A plant's error with fitted initial states, as at the beginning of `diagnose`.

    Attributes:
      rms: [m], with the initial states counted as degrees of freedom.
      noise: variance of the residual; 1 for pure noise.
      correlation: of the residual, from sample to sample; 0 for noise.
      only_noise: the residual is noise, by the limits of a diagnosis.
      windows: number of fitted ones.
      left_out: number of those whose fits did not converge: they end far worse than from measured
        pasts.
      converged: most of them did.
    """

    rms: float
    noise: float
    correlation: float
    only_noise: bool
    windows: int
    left_out: int
    converged: bool

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return asdict(self)


def fitted_starts(
    plant: Plant,
    windows: ForecastWindows,
    squares: Floats,
    seed: int,
    settings: Settings = Settings(),
) -> FittedStarts:
    """Fit the initial states of windows that tile the recordings.

    Args:
      plant: to be tested.
      windows: whose recordings, window length and noise to use.
      squares: (K, steps, P, 3) errors of its predictions there, from measured pasts [sigma^2].
      seed: of the search for initial states.
      settings: tuned numbers, as of a diagnosis.
    """
    tracks, used = windows.tracks, sorted(set(windows.recording.tolist()))
    seconds = windows.steps * windows.dt
    tiled = [tracks[i] for i in used]
    cut = Windows.cut(plant.robot, tiled, seconds, windows.sigma, settings.windows)
    begun = [cut.recordings[i].winch[f] for i, f in zip(cut.recording, cut.first, strict=True)]
    known = bool(np.isfinite(begun).all()) and not plant.terms  # which may remember what was before
    first = estimated_initial_states(cut, plant, settings.fitting.initial_states)

    def fitted_in(some: Windows) -> tuple[PlantFitter, Fit]:
        fitter = PlantFitter(WindowSimulator(some, plant), first, settings.fitting)
        return fitter, fitted(fitter, plant.terms, seed=seed)

    fitter, fit = fitted_in(cut.apart() if known else cut)
    unfitted = _mean_squares(cut, np.array(used), windows, squares)
    stuck = astray(fitter, fit, unfitted)
    if stuck.any() and not stuck.all():
        fitter, fit = fitted_in(fitter.windows.without(stuck))
    some, limits = candidates(plant.robot, {ANY: EFFECTS[ANY]}), settings.limits
    search = Search(fitter, some, limits, settings.selection, seed=seed)
    model = search.score_all(fit)
    left = adequacy(fitter, fit, model.test, model.by_value)
    only = only_noise(replace(limits, max_residual_variance=LOUD), left)
    return FittedStarts(
        rms=fitter.rms(fit),
        noise=left.noise,
        correlation=left.correlation,
        only_noise=only,
        windows=len(stuck),
        left_out=int(stuck.sum()),
        converged=mostly(~stuck),
    )


def _mean_squares(
    tiled: Windows, used: np.ndarray, windows: ForecastWindows, squares: Floats
) -> Floats:
    """(n,) mean squares of the predictions that lie within each tile [sigma^2]; NaN without any."""
    means = np.nanmean(squares, axis=(1, 2, 3))
    found = np.full(len(tiled), np.nan)
    for k, (recording, first) in enumerate(zip(used[tiled.recording], tiled.first, strict=True)):
        there = (windows.recording == recording) & (np.abs(windows.first - first) < tiled.steps)
        if there.any():
            found[k] = means[there].max()
    return found
