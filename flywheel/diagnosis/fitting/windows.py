"""Recordings cut into windows, each with its own initial state, and the noise of the recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from flywheel.diagnosis.settings import WindowSettings
from flywheel.effects import Scales
from flywheel.errors import DataError
from flywheel.noise import filled_in, noise_doubt, noise_floor
from flywheel.records import ChannelKind, Floats, MeasuredChannel, Trajectory
from flywheel.robots import Robot


@dataclass(frozen=True)
class Recording:
    """Measurements on the model's time grid.

    Attributes:
      points: (T + 1, P, 3) measured points [m]; NaN where missing.
      controls: (T, W) commands.
      winch: (T + 1, W) measured winch positions [m]; NaN if not measured.
    """

    points: Floats
    controls: Floats
    winch: Floats

    @classmethod
    def of(cls, trajectory: Trajectory) -> Recording:
        """From an unbatched trajectory."""
        seen = trajectory.observations
        return cls(seen.points, trajectory.controls, seen.winch)

    def cut(self, begin: int, end: int) -> Recording:
        """Its steps from one to another."""
        last = end + 1
        return Recording(self.points[begin:last], self.controls[begin:end], self.winch[begin:last])


@dataclass(frozen=True)
class ChannelNoise:
    """A channel beside the points, and the noise of its measurements.

    Attributes:
      key: kind, and name of the cable or winch.
      sigma: standard deviation [m or N].
    """

    key: tuple[ChannelKind, str]
    sigma: float

    @property
    def label(self) -> str:
        """For people."""
        return " ".join(self.key)

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return {"kind": self.key[0], "name": self.key[1], "noise": self.sigma}


@dataclass(frozen=True)
class Windows:
    """Equally long windows that tile each recording, one after the other.

    Attributes:
      robot: of the recordings.
      recordings: all of them.
      dt: control step [s].
      steps: of each window.
      recording: (K,) index of each window's recording.
      first: (K,) first step of each in its recording.
      measured: (K, steps + 1, P + C, 3) [m]: the points, and C channels as `widened`.
      filled: (K, P + C, 3) bool, coordinates of it that were `filled_in`.
      sigma: standard deviation of a coordinate's error: by noise, and by model discrepancy [m].
      doubt: standard deviation of one over the noise's square, relative to that; 0 if it was given.
      discrepancy: model discrepancy, see `with_discrepancy` [m].
      channels: measured beside the points.
    """

    robot: Robot
    recordings: tuple[Recording, ...]
    dt: float
    steps: int
    recording: np.ndarray
    first: np.ndarray
    measured: Floats
    filled: np.ndarray
    sigma: float
    doubt: float = 0.0
    discrepancy: float = 0.0
    channels: tuple[ChannelNoise, ...] = ()

    @classmethod
    def cut(
        cls,
        robot: Robot,
        trajectories: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
        settings: WindowSettings = WindowSettings(),
    ) -> Windows:
        """Cut trajectories into windows of about `seconds`.

        Args:
          robot: of the trajectories.
          trajectories: unbatched, of one control step.
          seconds: of a window; None for one that suits the robot's size.
          sigma: noise of a coordinate [m]; None for that of the settings, or to estimate it.
          settings: of the diagnosis.

        Raises:
          DataError: no recording, different control steps, or too few measurements.
        """
        if not trajectories:
            raise DataError("There is no recording to look at.")
        steps_of = {round(t.dt, 9) for t in trajectories}
        if len(steps_of) > 1:
            raise DataError(f"Recordings need one control step, got {sorted(steps_of)} s.")
        dt, sigma = trajectories[0].dt, sigma or settings.noise or None
        wanted = seconds or settings.seconds * Scales.of(robot).time
        recordings = tuple(Recording.of(t) for t in trajectories)
        lengths = [len(log.controls) for log in recordings]
        # What is left behind a gap may be too short for a window, and does not shorten all others.
        shortest = min([n for n in lengths if n * dt >= settings.remnant * wanted] or lengths)
        steps = shortest // max(1, round(shortest * dt / wanted))
        if steps < 2:
            span = f"{wanted:.3g} s of a recording of {shortest * dt:.4g} s"
            raise DataError(f"A window of {span} has {steps} steps of {dt:g} s, not 2 or more.")
        places = [
            (index, first)
            for index, log in enumerate(recordings)
            for first in range(0, len(log.controls) - steps + 1, steps)
        ]
        measured = np.stack([recordings[i].points[f : f + steps + 1] for i, f in places])
        full = np.isfinite(measured).all(axis=-1).mean(axis=(1, 2))
        if (full < settings.least_measured).all():
            raise DataError(
                f"No window has {settings.least_measured:.0%} of its points measured; the fullest has "
                f"{full.max():.0%}."
            )
        filled = filled_in([log.points for log in recordings])[[i for i, _ in places]]
        return cls(
            robot=robot,
            recordings=recordings,
            dt=dt,
            steps=steps,
            recording=np.array([i for i, _ in places]),
            first=np.array([f for _, f in places]),
            measured=measured,
            filled=filled,
            sigma=noise_floor([log.points for log in recordings]) if sigma is None else sigma,
            doubt=noise_doubt([log.points for log in recordings]) if sigma is None else 0.0,
        )._with_channels(trajectories)

    def _with_channels(self, trajectories: Sequence[Trajectory]) -> Windows:
        """The same, which have points only, with the channels of their recordings."""
        channels = channels_of(trajectories)
        tables = [channel_table(track, channels) for track in trajectories]
        places = zip(self.recording, self.first, strict=True)
        beside = np.stack([tables[i][f : f + self.steps + 1] for i, f in places])
        more = np.zeros((len(self), len(channels), 3), bool)
        wide = replace(self, channels=channels, filled=np.concatenate([self.filled, more], axis=1))
        return replace(wide, measured=wide.widened(self.measured, beside, missing=np.nan))

    def widened(self, points: Floats, beside: Floats, missing: float = 0.0) -> Floats:
        """(n, T, P + C, 3) points (n, T, P, 3) with channels (n, T, C) [m].

        A channel counts as the first coordinate of one more point, in the unit that gives it the points'
        noise; the two others are `missing`.
        """
        rows = np.full((*beside.shape, 3), missing)
        rows[..., 0] = beside * self.noise / np.array([each.sigma for each in self.channels])
        return np.concatenate([points, rows], axis=2)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the points and channels."""
        points = (point.name for point in self.robot.points)
        return (*points, *(channel.label for channel in self.channels))

    def with_discrepancy(self, discrepancy: float) -> Windows:
        """The same, with a model discrepancy in addition to noise [m], whatever they have."""
        sigma = float(np.hypot(self.noise, discrepancy))
        return replace(self, sigma=sigma, discrepancy=discrepancy)

    def apart(self) -> Windows:
        """The same as recordings of their own, so that each begins where its winches were measured."""
        begun = zip(self.recording, self.first, strict=True)
        own = (self.recordings[i].cut(f, f + self.steps) for i, f in begun)
        numbers = np.arange(len(self))
        return replace(self, recordings=tuple(own), recording=numbers, first=np.zeros_like(numbers))

    def without(self, some: np.ndarray) -> Windows:
        """The same with nothing measured in windows `some` (K,) bool, in which the model still moves."""
        return replace(self, measured=np.where(some[:, None, None, None], np.nan, self.measured))

    @property
    def noise(self) -> float:
        """Noise of each coordinate [m]."""
        return float(np.sqrt(max(0.0, self.sigma**2 - self.discrepancy**2)))

    def __len__(self) -> int:
        return len(self.recording)

    @property
    def ranks(self) -> list[np.ndarray]:
        """The first windows of all recordings, then the second ones, and so on."""
        number = self.first // self.steps
        return [np.flatnonzero(number == rank) for rank in range(number.max() + 1)]

    def squares(self, off: Floats) -> Floats:
        """(K, D, ...) squares of errors (K, D, ...); 0 for coordinates without noise."""
        noisy = self.noisy.reshape(*off.shape[:2], *(1,) * (off.ndim - 2))
        return np.where(noisy, off**2, 0.0)

    def mean_square(self, off: Floats) -> Floats:
        """(K, ...) mean over each window of errors (K, D, ...), per coordinate with noise."""
        whole: Floats = self.squares(off).sum(axis=1)
        return (whole.T / np.maximum(self.noisy_in_each, 1)).T

    @cached_property
    def noisy(self) -> np.ndarray:
        """(K, steps + 1, P, 3) bool: True for noisy coordinates, neither missing nor filled in.

        Filled-in coordinates hold the model in its plane, for example, and contain no information
        on its error.
        """
        return np.isfinite(self.measured) & ~self.filled[:, None]

    @cached_property
    def noisy_in_each(self) -> np.ndarray:
        """(K,) number of coordinates with noise in each window."""
        return np.asarray(self.noisy.sum(axis=(1, 2, 3)))

    def residual(self, points: Floats) -> Floats:
        """(K, D) measured minus predicted (K, steps + 1, P, 3), in sigmas; 0 where missing."""
        return self.residual_of(np.arange(len(self)), points)

    def residual_of(self, members: np.ndarray, points: Floats) -> Floats:
        """The same of windows `members` (n,): (n, D) of (n, steps + 1, P, 3)."""
        off = (self.measured[members] - points) / self.sigma
        return np.nan_to_num(off, nan=0.0).reshape(len(members), -1)

    def slope(self, difference: Floats, step: float, members: np.ndarray) -> Floats:
        """(n, D, m) in sigmas, of windows `members` (n,) that differ by (n, m, steps + 1, P, 3) in a step.

        0 for missing measurements or predictions.
        """
        seen = np.isfinite(self.measured[members])[:, None]
        slope = np.where(seen, difference / (step * self.sigma), 0.0)
        numbers = int(np.prod(slope.shape[2:]))
        flat = np.nan_to_num(slope.reshape(*slope.shape[:2], numbers), nan=0.0)
        return flat.swapaxes(1, 2)


def channels_of(trajectories: Sequence[Trajectory]) -> tuple[ChannelNoise, ...]:
    """All channels of some recordings, each with the noise that it is told to have, or has.

    Raises:
      DataError: the noise of one cannot be estimated.
    """
    found: dict[tuple[ChannelKind, str], list[MeasuredChannel]] = {}
    for channel in (each for track in trajectories for each in track.channels):
        if np.isfinite(channel.values).any():
            found.setdefault(channel.key, []).append(channel)
    return tuple(ChannelNoise(key, _noise_of(each)) for key, each in found.items())


def _noise_of(channels: Sequence[MeasuredChannel]) -> float:
    told = [channel.noise for channel in channels if channel.noise is not None]
    if told:
        return max(told)
    one = channels[0]
    try:
        return noise_floor([channel.values[:, None, None] for channel in channels])
    except DataError as error:
        raise DataError(
            f"{error} They are of the {one.kind} of {one.name}: give its noise in the map."
        ) from None


def channel_table(trajectory: Trajectory, channels: Sequence[ChannelNoise]) -> Floats:
    """(T + 1, C) values of channels; NaN where a recording has none."""
    found = np.full((trajectory.steps + 1, len(channels)), np.nan)
    own = {channel.key: channel.values for channel in trajectory.channels}
    for column, channel in enumerate(channels):
        if channel.key in own:
            found[:, column] = own[channel.key]
    return found
