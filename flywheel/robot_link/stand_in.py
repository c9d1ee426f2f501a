"""A stand-in for a real robot: the truth simulator behind the same interface, with its own sensors.

It returns nothing but measurements. It waits to be observed; `server` runs it in real time.
"""

from __future__ import annotations

from collections import deque
from typing import Annotated

import numpy as np
from pydantic import Field

from flywheel.errors import ConfigError, LinkError
from flywheel.quantities import Bounds, PartialShare, Share
from flywheel.records import Floats
from flywheel.robot_link.protocol import RobotInfo, Sample
from flywheel.robots import Robot
from flywheel.truth_simulator import Simulation, TruthSimulator
from flywheel.truth_simulator.contact import Contact
from flywheel.truth_simulator.written import hidden_effects
from flywheel.validation import Frozen

SETTLE = 2.0  # that the robot stands still for before an episode begins [s]
Seconds = Annotated[float, Bounds(0, 1, "s")]


class StandInConfig(Frozen):
    """Physics and sensors of a stand-in, beyond its MJCF. The driver knows at most the latency.

    Attributes:
      hidden: effects of the truth simulator, as `NAME[@PLACE][:SIZE]`; a size of 2 is twice the
        typical one.
      noise: standard deviation of each coordinate of a point, as a fraction of `robot.length`.
      rate: measurements per second [Hz]; None for one in every control period.
      latency: their age on arrival [s].
      latency_told: True if their stamps include it.
      dropout: fraction of missing points.
      burst: mean duration of a dropout [s]; 0 for each measurement by itself.
      winch_measured: measure all winch positions; else only those that the MJCF has a sensor for.
      winch_noise: standard deviation of measured winch positions [m].
      contact: of the truth simulator with the ground.
      dead_man: longest validity of a command [s].
    """

    hidden: tuple[Annotated[str, Field(max_length=200)], ...] = Field(default=(), max_length=20)
    noise: Share = 0.003
    rate: Annotated[float, Bounds(0.1, 10_000, "Hz")] | None = None
    latency: Seconds = 0.0
    latency_told: bool = True
    dropout: PartialShare = 0.0
    burst: Seconds = 0.0
    winch_measured: bool = False
    winch_noise: Annotated[float, Bounds(0, 1, "m")] = 0.0
    contact: Contact = "elliptic"
    dead_man: Annotated[float, Bounds(0, 60, "s", above=True)] = 0.5


class StandIn:
    """A simulated robot. Implements `RobotLink`.

    Args:
      robot: of its MJCF.
      config: its physics and sensors beyond that.
      period: of its control loop [s].

    Raises:
      ConfigError: periods or effects do not fit.
      UnknownNameError: there is no such effect or place.
    """

    def __init__(self, robot: Robot, config: StandInConfig, period: float = 0.01) -> None:
        self._robot, self._config, self._period = robot, config, period
        self._simulator = TruthSimulator(
            robot, hidden_effects(config.hidden, robot), config.contact
        )
        told = config.latency if config.latency_told else 0.0
        self.info = RobotInfo.of(robot, period, latency=told, dead_man=config.dead_man)
        self._every = self._periods(1 / config.rate) if config.rate else 1
        self._late = round(config.latency / period)
        if not np.isclose(self._late * period, config.latency, rtol=1e-6, atol=1e-9):
            raise ConfigError(
                f"The latency {config.latency:g} s must be a multiple of the control period, {period:g} s."
            )
        self._moving: Simulation | None = None

    def _periods(self, seconds: float) -> int:
        count = round(seconds / self._period)
        if count < 1 or not np.isclose(count * self._period, seconds, rtol=1e-6):
            raise ConfigError(
                f"The rate {1 / seconds:g} Hz must be the control rate, {1 / self._period:g} Hz, or a whole "
                "part of it."
            )
        return count

    def reset(self, seed: int = 0) -> None:
        """Stand at rest in the keyframe."""
        self._moving = self._simulator.begin(self._period, settle=SETTLE)
        self._rng = np.random.default_rng(seed)
        self._missing = self._rng.random(len(self._robot.points)) < self._config.dropout
        self._command = self._robot.holding(self._robot.winch_of(self._robot.keyframe))
        self._valid_until, self._done, self._fresh = 0.0, 0, True
        self._sent: deque[Sample] = deque()
        on_the_way = -(-self._late // self._every)
        for before in range(on_the_way, -1, -1):  # it stood still all the while
            self._sent.append(self._measured(-before * self._every))
        self._newest = self._sent.popleft()

    def observe(self) -> Sample:
        """The first measurement, then the newest after each control period."""
        self._ready()
        if not self._fresh:
            self.advance()
        self._fresh = False
        return self.sample()

    def advance(self) -> None:
        """Let one control period pass.

        Raises:
          LinkError: it was never reset.
        """
        moving = self._ready()
        obeyed = self._time < self._valid_until - 1e-9
        if not obeyed:
            self._command = self._still()
        moving.go(self._command)
        self._done += 1
        if self._done % self._every == 0:
            self._sent.append(self._measured(self._done))
        while self._sent and self._sent[0].time <= self._done * self._period + 1e-9:
            self._newest = self._sent.popleft()

    def sample(self) -> Sample:
        """The newest measurement that has arrived."""
        self._ready()
        newest = self._newest
        return Sample(self._time, newest.stamp, newest.points, newest.winch)

    def send(self, controls: Floats, valid_until: float) -> None:
        """The command (W,) of the next control periods.

        Raises:
          LinkError: it is not a command for this robot.
        """
        self._ready()
        self._command = self.info.clipped(controls)
        self._valid_until = min(float(valid_until), self._time + self._config.dead_man)

    def stop(self) -> None:
        """Hold the winches."""
        if self._moving is not None:
            self._command, self._valid_until = self._still(), 0.0

    def close(self) -> None:
        """Stop."""
        self.stop()

    @property
    def _time(self) -> float:
        return self._done * self._period

    def _ready(self) -> Simulation:
        if self._moving is None:
            raise LinkError(f"{self._robot.name} must be reset before it is driven.")
        return self._moving

    def _still(self) -> Floats:
        """The command that holds the winches: zero rate, or the last commanded position."""
        return self._robot.holding(self._command)

    def _measured(self, period: int) -> Sample:
        """The measurement of this instant; its time is that of its arrival."""
        config, rng = self._config, self._rng
        truth = self._ready().look()
        points = truth.seen + rng.normal(size=truth.seen.shape) * config.noise * self._robot.length
        points[self._lost(rng.random(len(points)))] = np.nan
        winch = truth.motor + rng.normal(size=truth.motor.shape) * config.winch_noise
        there = [config.winch_measured or winch.measured for winch in self._robot.winches]
        arrives = (period + self._late) * self._period
        stamp = period * self._period if config.latency_told else arrives
        return Sample(arrives, stamp, points, np.where(there, winch, np.nan))

    def _lost(self, chance: Floats) -> np.ndarray:
        """(P,) bool. Points disappear and reappear at random, at rates that give the required fraction."""
        dropout, burst = self._config.dropout, self._config.burst
        between = self._every * self._period
        back = min(1.0 - dropout, between / burst) if burst else 1.0 - dropout
        go = min(1.0, back * dropout / (1.0 - dropout))
        self._missing = np.where(self._missing, chance >= back, chance < go)
        return self._missing
