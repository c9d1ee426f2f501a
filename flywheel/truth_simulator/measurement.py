"""Measurement of the truth by cameras and encoders: noise, markers lost, markers mixed up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.errors import ConfigError
from flywheel.records import Floats


@dataclass(frozen=True)
class Measurement:
    """Settings of a recording.

    Attributes:
      dt: time between two rows, and duration of a command [s].
      noise: standard deviation of each coordinate, as a fraction of `robot.length` [-].
      dropout: fraction of missing markers [-].
      burst: mean duration of a dropout [s]; 0 for each row by itself.
      swap: two markers are swapped from some time on.
      winch_noise: standard deviation of measured motor positions [m]; None without encoders.
    """

    dt: float = 0.01
    noise: float = 0.003
    dropout: float = 0.0
    burst: float = 0.0
    swap: bool = False
    winch_noise: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.dropout < 1:
            raise ConfigError(f"dropout must be a share from 0 to below 1, got {self.dropout!r}.")
        for name in ("noise", "burst", "winch_noise"):
            if (getattr(self, name) or 0.0) < 0:
                raise ConfigError(f"{name} must not be negative, got {getattr(self, name)!r}.")
        if not self.dt > 0:
            raise ConfigError(f"dt must be positive seconds, got {self.dt!r}.")

    def points(self, seen: Floats, length: float, rng: np.random.Generator) -> Floats:
        """Measured positions (T + 1, P, 3) [m] of markers with visible positions `seen`; NaN: missing.

        Args:
          length: `robot.length` [m].
        """
        measured = seen + rng.normal(size=seen.shape) * (self.noise * length)
        measured[self._missing(seen.shape[:2], rng)] = np.nan
        if self.swap and seen.shape[1] > 1:
            begin = int(rng.uniform(0.2, 0.7) * len(seen))
            pair = rng.choice(seen.shape[1], 2, replace=False)
            measured[begin:, pair] = measured[begin:, pair[::-1]]
        return measured

    def winch(self, motor: Floats, rng: np.random.Generator) -> Floats:
        """Measured motor positions (T + 1, W) [m]; NaN without a channel."""
        if self.winch_noise is None:
            return np.full_like(motor, np.nan)
        return motor + rng.normal(size=motor.shape) * self.winch_noise

    def _missing(self, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
        """(T + 1, P) bool. Markers disappear and reappear at random, at rates that give the
        required fraction.
        """
        chance = rng.random(shape)
        if not self.dropout:
            return np.zeros(shape, bool)
        # The chance to come back makes the mean burst; that to go makes the share.
        back = min(1.0 - self.dropout, self.dt / self.burst) if self.burst else 1.0 - self.dropout
        go = min(1.0, back * self.dropout / (1.0 - self.dropout))
        missing = np.empty(shape, bool)
        missing[0] = chance[0] < self.dropout
        for t in range(1, shape[0]):
            missing[t] = np.where(missing[t - 1], chance[t] >= back, chance[t] < go)
        return missing
