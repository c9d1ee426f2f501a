"""Result of a comparison."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from flywheel.diagnosis.comparison.bins import Bins
from flywheel.diagnosis.comparison.channel_errors import ChannelError
from flywheel.diagnosis.comparison.fitted_starts import LOUD, FittedStarts
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.windows import ChannelNoise
from flywheel.evaluation import ExactSum
from flywheel.records import Floats

LEVEL = 0.05  # probability below which an error is more than noise


class Outcome(StrEnum):
    """Verdict on the error of a model; `NOT_CONVERGED` if most fits of starts ended far off."""

    NOISE_ONLY = "NOISE_ONLY"
    MORE_THAN_NOISE = "MORE_THAN_NOISE"
    NOT_CONVERGED = "NOT_CONVERGED"


EXIT_CODES = {Outcome.NOISE_ONLY: 0, Outcome.MORE_THAN_NOISE: 1, Outcome.NOT_CONVERGED: 21}


@dataclass(frozen=True)
class Judgement:
    """Result for one model. Squares are in noise variances; K windows, P tracked points.

    Attributes:
      name: of the model.
      points: (K, steps + 1, P, 3) predicted; the first is the model's present [m].
      winch: (K, steps + 1, W) predicted [m].
      by_lead: (steps,) mean square at each lead time.
      band: (2, steps) 95 % band of noise alone.
      squares: (K, P) sums of squares.
      cables: of the distances between the ends of cables, over everything.
      bins: the squares sorted by everything else.
      noise_rms: root mean square of the model's error due to noise alone: lower bound of 95 %,
        median, upper bound [sigma].
      excess: mean square of windows beyond the influence of noise on starts, relative to that of
        noise alone.
      probability: of as much excess by noise alone.
      fitted: error with fitted starts; None if not requested, or not possible.
      channels: errors of what was measured beside the points; of other models than plants, of winches only.
    """

    name: str
    points: Floats
    winch: Floats
    by_lead: Floats
    band: Floats
    squares: ExactSum
    cables: ExactSum
    bins: tuple[Bins, ...]
    noise_rms: tuple[float, float, float]
    excess: float
    probability: float
    fitted: FittedStarts | None
    channels: tuple[ChannelError, ...] = ()

    @property
    def whole(self) -> ExactSum:
        """Squared errors of all points in all windows."""
        return self.squares.over((0, 1))

    @property
    def rms(self) -> float:
        """Root mean square of measured minus predicted, of a coordinate [sigma]."""
        return float(np.sqrt(self.whole.mean))

    @property
    def outcome(self) -> Outcome:
        """By the error with fitted starts, if that was requested; else by the predictions."""
        if self.fitted is not None and not self.fitted.converged:
            return Outcome.NOT_CONVERGED
        more = self.forecast_is_off if self.fitted is None else not self.fitted.only_noise
        return Outcome.MORE_THAN_NOISE if more else Outcome.NOISE_ONLY

    @property
    def forecast_is_off(self) -> bool:
        """True if predictions from measured pasts have more error, and of another kind, than noise
        causes.
        """
        return self.probability < LEVEL and self.excess > LOUD

    @property
    def worst(self) -> int:
        """The window with the largest mean square."""
        return int(np.nanargmax(self.squares.over(1).mean))

    def summary(self, sigma: float) -> dict[str, Any]:
        """In JSON form.

        Args:
          sigma: noise of a coordinate [m].
        """
        return {
            "model": self.name,
            "verdict": str(self.outcome),
            "error": {
                "rms": self.rms * sigma,
                "by_noise_alone": [value * sigma for value in self.noise_rms],
                "unit": "m",
            },
            "excess": self.excess,
            "probability": self.probability,
            "fitted_starts": None if self.fitted is None else self.fitted.summary(),
            "by_lead_time": {
                "mean_square": self.by_lead.tolist(),
                "by_noise_alone": self.band.tolist(),
            },
            "where": {f"{b.of} by {b.by}": b.summary() for b in self.bins},
            "window_by_point": self.squares.total.tolist(),
            "channels": [error.summary() for error in self.channels],
        }


@dataclass(frozen=True)
class Comparison:
    """Models compared with the same recordings.

    Attributes:
      windows: of the recordings, predicted by all models.
      models: result of each.
      persistence: (steps,) mean square, at each lead time, of a model without motion.
      draws: of the noise.
      seed: of the draws.
      seconds: duration.
    """

    windows: ForecastWindows
    models: tuple[Judgement, ...]
    persistence: Floats
    draws: int
    seed: int
    seconds: float

    @property
    def exit_code(self) -> int:
        """0 if the error of the last model is noise only; see `EXIT_CODES`."""
        return EXIT_CODES[self.models[-1].outcome]

    @property
    def channels(self) -> list[tuple[ChannelNoise, list[ChannelError | None]]]:
        """Each channel with the error of every model, None for one that does not predict it."""
        told = [{error.channel.key: error for error in model.channels} for model in self.models]
        every = {key: error.channel for errors in told for key, error in errors.items()}
        return [(channel, [errors.get(key) for errors in told]) for key, channel in every.items()]

    @property
    def persistence_rms(self) -> float:
        """Root mean square error without motion [sigma]."""
        return float(np.sqrt(np.nanmean(self.persistence)))

    @property
    def lead_seconds(self) -> Floats:
        """(steps,) lead times [s]."""
        return self.windows.dt * np.arange(1, self.windows.steps + 1)

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        windows = self.windows
        return {
            "verdict": str(self.models[-1].outcome),
            "robot": {"name": windows.robot.name, "digest": windows.robot.digest},
            "recordings": list(windows.names),
            "recordings_too_short": list(windows.unused),
            "first_lengths": {
                "fitted": windows.begun is not None,
                "from_keyframe": windows.moved.tolist(),
                "unit": "m",
            },
            "windows": list(windows.labels),
            "noise": {"sigma": windows.sigma, "unit": "m"},
            "lead_time": {"values": self.lead_seconds.tolist(), "unit": "s"},
            "persistence": self.persistence.tolist(),
            "models": [model.summary(windows.sigma) for model in self.models],
            "dt": windows.dt,
            "draws": self.draws,
            "seed": self.seed,
            "seconds": self.seconds,
        }
