"""Effects between a command and the winch's motion."""

from __future__ import annotations

import numpy as np

from flywheel.effects.effect import RESTS, CommandEffect, Parameter, Values, WinchEffect, Winches
from flywheel.records import Floats
from flywheel.robots import Robot


class WinchBacklash(CommandEffect):
    """The rest length follows the motor with free play, starting in its middle.

    The motor of a position winch is assumed to rest at its first command.
    """

    name = "winch_backlash"
    stage = 3
    sizes = (Parameter("width", "m", lambda s: 0.01 * s.length),)
    winch_kinds = RESTS
    equation = "l0 = clip(l0, m - b / 2, m + b / 2), m: position of the motor"
    source = "play operator (Krasnosel'skii)"
    shown_by = "winches that turn round often"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        half = values["width"] / 2
        motor = drum = robot.holding(controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each position needs the one before
            motor = motor + robot.rates(motor, controls[:, step], dt) * dt
            after = np.clip(drum, motor - half, motor + half)
            told[:, step] = robot.telling(drum, (after - drum) / dt, dt)
            drum = after
        return np.where(half > 0, told.swapaxes(0, 1), controls.swapaxes(0, 1)).swapaxes(0, 1)


class CommandDelay(CommandEffect):
    """Commands that act a fixed time later; before the first one the winches hold."""

    name = "command_delay"
    stage = 0
    sizes = (Parameter("time", "s", lambda s: 0.1 * s.time),)
    equation = "u(t) -> u(t - d)"
    source = "transport delay"
    shown_by = "sudden commands"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return delayed(controls, values["time"] / dt, robot)


class ActuatorLag(CommandEffect):
    """Winches that accelerate slowly: a first-order lag between command and winch."""

    name = "actuator_lag"
    stage = 1
    sizes = (Parameter("time", "s", lambda s: 0.2 * s.time),)
    equation = "a dr/dt = u - r"
    source = "first-order motor"
    shown_by = "sudden commands, held for a while"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        lag = values["time"]
        # the mean over a step of the exact response
        kept = np.exp(-dt / np.maximum(lag, 1e-9))
        mean = lag / dt * (1 - kept)
        state = robot.holding(controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each rate needs the one before
            wanted = controls[:, step]
            told[:, step] = np.where(lag > 0, wanted + (state - wanted) * mean, wanted)
            state = wanted + (state - wanted) * kept
        return told


class WinchGain(CommandEffect):
    """Winches faster or slower than commanded: another drum radius, another gear.

    A position winch still reaches its command, but at another rate. Its motor is assumed to rest at
    its first command. A winch that takes tensions pulls more, or less, than commanded.
    """

    name = "winch_gain"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-5.0, high=5.0),)
    equation = "r -> (1 + g) r"
    source = "kinematics of the drum"
    shown_by = "long strokes"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        faster = 1.0 + values["share"]
        if robot.rate_driven.all() or robot.tension_driven:
            return controls * faster[:, None]
        drum = robot.holding(controls[:, 0])
        told = np.empty_like(controls)
        for step in range(controls.shape[1]):  # each rate of a position winch needs where it is
            rates = robot.rates(drum, controls[:, step], dt, faster)
            told[:, step] = robot.telling(drum, rates, dt)
            drum = drum + rates * dt
        return told


class TorqueSpeed(WinchEffect):
    """Winches that slow down under load: the motor loses speed in proportion to it while it hauls in."""

    name = "torque_speed"
    sizes = (Parameter("slope", "1/N", lambda s: 0.1 / s.weight),)
    winch_kinds = RESTS
    equation = "r -> r max(0, 1 - q T) where r < 0"
    source = "torque-speed line of a DC motor"
    shown_by = "fast hauling at high pretension"

    def rate(self, rate: Floats, winches: Winches, values: Values) -> Floats:
        slower = np.maximum(0.0, 1.0 - values["slope"] * winches.load)
        return np.where(rate < 0, rate * slower, rate)


def wound_on(controls: Floats, share: Floats, robot: Robot) -> Floats:
    """Commands (n, T, W) to winches whose drums are larger than nominal by a fraction (n, W).

    A rate winch is faster. A position winch winds another length than commanded, counted from its
    keyframe.
    """
    still = robot.holding(robot.winch_of(robot.keyframe))
    return np.asarray(controls + share[:, None] * (controls - still))


def delayed(controls: Floats, steps: Floats, robot: Robot) -> Floats:
    """Commands (n, T, W), `steps` (n, W) control steps later; fractions of a step are interpolated."""
    steps = np.round(steps, 9)  # 0.07 / 0.01 is a little more than seven
    total = controls.shape[1]
    first = robot.holding(controls[:, :1])
    padded = np.concatenate([first, controls], axis=1)
    whole = np.floor(steps)
    part = (steps - whole)[:, None]
    now = np.arange(1, total + 1)[None, :, None] - whole[:, None].astype(int)
    newer = np.take_along_axis(padded, np.maximum(now, 0), axis=1)
    older = np.take_along_axis(padded, np.maximum(now - 1, 0), axis=1)
    return np.where(part == 0, newer, (1 - part) * newer + part * older)
