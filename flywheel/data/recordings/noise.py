"""Noise of measured values, told from their digits and from motion."""

from __future__ import annotations

import numpy as np

from flywheel.data.recordings.report import Finding
from flywheel.data.recordings.tables.columns import Log, control_names
from flywheel.records import Floats
from flywheel.robots import Robot

MANY = 20_000  # samples of which the digits are looked at
WINDOW = 16  # samples over which noise is looked at
QUIET = 0.25  # share of the windows, those with the least noise
WHITE = 0.7  # least ratio of sixth to fourth differences, of white noise 1; below it is motion
SQUARES = {4: 70.0, 6: 924.0}  # variance of white noise's differences of that order
FINEST = 1e-6  # share of a command's range: a smaller change is none
EVERY = 0.9  # share of the rows in which a command changes, if it is by noise
NOISY = 0.01  # share of a command's range from which its noise is told


def noisy_commands(log: Log, robot: Robot) -> list[Finding]:
    """A note for each command that changes at random in every row, as one that was measured does."""
    span = robot.control_high - robot.control_low
    used = log.controls[:-1] / span
    digit = last_digit(used, FINEST)
    each = (np.abs(np.diff(used, axis=0)) > digit).mean(axis=0) > EVERY
    if not each.any():
        return []
    share = white_noise(used, digit)
    told = (
        "changes at random in every row, by a standard deviation of {:.3g} {}: was it measured? What the "
        "winch was told belongs here; noise on it makes a right model look wrong"
    )
    return [
        Finding(
            "channel",
            "noted",
            control_names(robot)[index],
            len(used),
            words=told.format(share[index] * span[index], robot.winches[index].unit),
        )
        for index in np.flatnonzero(each & (share > NOISY))
    ]


def last_digit(values: Floats, finest: float) -> Floats:
    """(k,) least change of each coordinate from one of its values (M, k) to the next [m]."""
    found = np.full(values.shape[1], finest)
    for axis, column in enumerate(values[:: 1 + len(values) // MANY].T):
        steps = np.diff(np.unique(column))
        steps = steps[steps > finest]
        if len(steps):
            found[axis] = max(finest, min(float(steps.min()), _decimal(column, finest)))
    return found


def _decimal(values: Floats, finest: float) -> float:
    """The largest power of ten that all values (M,) are multiples of; else about `finest` [m]."""
    found = 1.0
    while found > finest and (np.abs(values - found * np.rint(values / found)) > finest / 2).any():
        found /= 10
    return found


def white_noise(values: Floats, digit: Floats) -> Floats:
    """(k,) standard deviation of the noise on values (M, k) in their quietest parts; 0 where there is none.

    Rounding to a last digit (k,) is none, nor is a motion that is smooth from sample to sample.
    """
    levels = []
    for order, square in SQUARES.items():
        rough = np.diff(values, n=order, axis=0) / np.sqrt(square)
        if len(rough) < WINDOW // 2:
            return np.zeros(values.shape[1])
        size = min(WINDOW, len(rough))
        count = len(rough) // size
        parts = rough[: count * size].reshape(count, size, values.shape[1])
        levels.append(np.quantile(np.sqrt((parts**2).mean(axis=1)), QUIET, axis=0))
    fourth, sixth = levels
    beyond = np.sqrt(np.maximum(fourth**2 - digit**2 / 12, 0))
    return np.where((sixth > WHITE * fourth) & (beyond > digit / 2), beyond, 0.0)
