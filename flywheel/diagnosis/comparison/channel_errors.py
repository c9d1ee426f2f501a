"""Errors of predicted channels: tensions and lengths of cables, and winch positions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.comparison.bootstrap import repeated
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import ChannelNoise, channel_table, channels_of
from flywheel.dynamics import RestartedPlant
from flywheel.dynamics.plant import AugmentedPlant, Motion, Plant
from flywheel.records import Floats, Observation, State

DRAWS = 10  # of the noise, for each window


@dataclass(frozen=True)
class ChannelError:
    """Error of a plant's predictions of one channel, in its unit.

    Attributes:
      channel: the channel.
      rms: root mean square of measured minus predicted [m or N].
      by_noise: the same by noise alone, that of the channel and of the points in the starts [m or N].
    """

    channel: ChannelNoise
    rms: float
    by_noise: float

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        kind, name = self.channel.key
        numbers = {"rms": self.rms, "by_noise_alone": self.by_noise, "noise": self.channel.sigma}
        return {"kind": kind, "name": name, **numbers}


def channel_errors(
    subject: Subject, windows: ForecastWindows, rng: np.random.Generator
) -> tuple[ChannelError, ...]:
    """The errors of a plant, where anything was measured beside points; none of other models.

    Args:
      subject: the model.
      windows: to be predicted.
      rng: of the noise.
    """
    tracks, dynamics = windows.tracks, subject.dynamics
    channels = channels_of(tracks)
    if not channels or not isinstance(dynamics, RestartedPlant):
        return ()
    plant = dynamics.plant
    bare = Plant(plant.robot, *plant.arguments())
    augmented = AugmentedPlant(bare, [channel.key for channel in channels])

    def moved(start: State, controls: Floats) -> Motion:
        terms = [plant.terms] * len(controls)
        return augmented.simulate(start, augmented.commands(controls, terms), terms)

    past, controls = windows.past(subject), windows.controls()
    measured = windows.ahead([channel_table(track, channels) for track in tracks])
    off = measured - moved(dynamics.estimate(past), controls).channels[:, 1:]
    # In its own world, whose points are seen through noise.
    warmup = windows.warmup
    origin = dynamics.estimate(repeated(windows.origin(subject), DRAWS))
    world = moved(origin, np.tile(windows.controls(warmup), (DRAWS, 1, 1)))
    now = slice(warmup - dynamics.history, warmup + 1)
    points = world.points[:, now] + rng.normal(0.0, windows.sigma, world.points[:, now].shape)
    winch = plant.winch(world.states)[:, now]
    seen = replace(repeated(past, DRAWS), observations=Observation(points, winch), winch=winch)
    predicted = moved(dynamics.estimate(seen), np.tile(controls, (DRAWS, 1, 1))).channels[:, 1:]
    wrong = world.channels[:, warmup + 1 :] - predicted
    return tuple(
        ChannelError(
            channel, _rms(off[..., i]), float(np.hypot(_rms(wrong[..., i]), channel.sigma))
        )
        for i, channel in enumerate(channels)
    )


def _rms(off: Floats) -> float:
    known = off[np.isfinite(off)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")
