"""Errors of predicted channels: tensions and lengths of cables, and winch positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flywheel.diagnosis.comparison.bootstrap import repeated
from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import ChannelNoise, channel_table, channels_of
from flywheel.dynamics import RestartedPlant
from flywheel.dynamics.plant import AugmentedPlant, Plant
from flywheel.dynamics.protocol import Dynamics
from flywheel.records import Floats, Observation, Past

DRAWS = 10  # of the noise, for each window,
DRAWN = 200  # and in all: one of a winch in the start is one number

# Points (n, T + 1, P, 3) [m], winch positions (n, T + 1, W) and channels (n, T + 1, C) [m or N], from pasts.
Predict = Callable[[Past, Floats], tuple[Floats, Floats, Floats]]


@dataclass(frozen=True)
class ChannelError:
    """Error of a model's predictions of one channel, in its unit.

    Attributes:
      channel: the channel.
      rms: root mean square of measured minus predicted [m or N].
      by_noise: the same by noise alone, that of the channel, and that in the starts [m or N].
    """

    channel: ChannelNoise
    rms: float
    by_noise: float

    def summary(self) -> dict[str, Any]:
        """In JSON form."""
        return self.channel.summary() | {"rms": self.rms, "by_noise_alone": self.by_noise}


def channel_errors(
    subject: Subject, windows: ForecastWindows, rng: np.random.Generator
) -> tuple[ChannelError, ...]:
    """The errors of a plant, where anything was measured beside points; of other models, of winches only.

    Args:
      subject: the model.
      windows: to be predicted.
      rng: of the noise.
    """
    tracks, model = windows.tracks, subject.dynamics
    plant = model if isinstance(model, RestartedPlant) else None
    channels = [each for each in channels_of(tracks) if plant or each.key[0] == "winch"]
    if not channels:
        return ()
    predict = _of_plant(plant, channels) if plant else _of_winches(model, channels)
    past, controls = windows.past(subject), windows.controls()
    measured = windows.ahead([channel_table(track, channels) for track in tracks])
    off = measured - predict(past, controls)[2][:, 1:]
    # In its own world, whose points and winches are seen through noise.
    warmup = windows.warmup
    draws = max(DRAWS, DRAWN // len(windows))
    origin = repeated(windows.origin(subject), draws)
    points, winch, world = predict(origin, np.tile(windows.controls(warmup), (draws, 1, 1)))
    now = slice(warmup - model.history, warmup + 1)
    points, winch = points[:, now], winch[:, now]
    sigmas = {channel.key: channel.sigma for channel in channels}
    of_winches = [sigmas.get(("winch", each.name), 0.0) for each in model.robot.winches]
    points = points + rng.normal(0.0, windows.sigma, points.shape)
    winch = winch + of_winches * rng.normal(size=winch.shape)
    seen = replace(repeated(past, draws), observations=Observation(points, winch), winch=winch)
    wrong = world[:, warmup + 1 :] - predict(seen, np.tile(controls, (draws, 1, 1)))[2][:, 1:]
    return tuple(
        ChannelError(
            channel, _rms(off[..., i]), float(np.hypot(_rms(wrong[..., i]), channel.sigma))
        )
        for i, channel in enumerate(channels)
    )


def _of_plant(model: RestartedPlant, channels: Sequence[ChannelNoise]) -> Predict:
    plant = model.plant
    bare = Plant(plant.robot, *plant.arguments())
    augmented = AugmentedPlant(bare, [channel.key for channel in channels])

    def predict(past: Past, controls: Floats) -> tuple[Floats, Floats, Floats]:
        terms = [plant.terms] * len(controls)
        told = augmented.commands(controls, terms)
        motion = augmented.simulate(model.estimate(past), told, terms, steps=controls.shape[1])
        return motion.points, plant.winch(motion.states), motion.channels

    return predict


def _of_winches(model: Dynamics, channels: Sequence[ChannelNoise]) -> Predict:
    names = [winch.name for winch in model.robot.winches]
    which = [names.index(channel.key[1]) for channel in channels]

    def predict(past: Past, controls: Floats) -> tuple[Floats, Floats, Floats]:
        found = model.rollout(past, controls)
        return found.points, found.winch, found.winch[..., which]

    return predict


def _rms(off: Floats) -> float:
    known = off[np.isfinite(off)]
    return float(np.sqrt((known**2).mean())) if len(known) else float("nan")
