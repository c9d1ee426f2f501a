"""What a robot is to whoever drives it: it is reset, observed, sent commands, and stopped.

**Time.** A robot has a clock of its own, in seconds since its last reset, and a control period. `observe`
waits for the next period to begin; a command that is sent after it acts until the next one is sent, or
until it is no longer valid. Then the robot holds its winches still.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import LinkError
from flywheel.records import Floats
from flywheel.robots import Robot


@dataclass(frozen=True)
class RobotInfo:
    """What a robot says about itself.

    Attributes:
      name: of the robot.
      points, winches: names of what it measures and of what it moves, as in its MJCF.
      control_low, control_high: (W,) limits of its commands.
      period: of its control loop [s].
      latency: how old its measurements are when they arrive, as far as it knows [s].
      dead_man: longest time that a command can be valid for [s].
      real_time: its clock goes on by itself; else it waits to be observed.
    """

    name: str
    points: tuple[str, ...]
    winches: tuple[str, ...]
    control_low: Floats
    control_high: Floats
    period: float
    latency: float = 0.0
    dead_man: float = 0.5
    real_time: bool = False

    def check_is(self, robot: Robot) -> None:
        """Refuse a robot that is not the one of an MJCF.

        Raises:
          LinkError: it has other points, winches or limits.
        """
        its = RobotInfo.of(robot, self.period)
        for what in ("points", "winches"):
            here, there = getattr(its, what), getattr(self, what)
            if here != there:
                raise LinkError(
                    f"The robot {self.name} has the {what} {', '.join(there)}; the MJCF of {robot.name} "
                    f"has {', '.join(here)}."
                )
        for what in ("control_low", "control_high"):
            here, there = getattr(its, what), getattr(self, what)
            if not np.allclose(here, there, rtol=1e-6, atol=0.0):
                raise LinkError(
                    f"The robot {self.name} takes commands with {what} {there.tolist()}; the MJCF of "
                    f"{robot.name} says {here.tolist()}."
                )

    def check(self, sample: Sample) -> Sample:
        """The sample, if it can be one of this robot.

        Raises:
          LinkError: it has another number of points or winches, or a time that is no number.
        """
        shapes = sample.points.shape, sample.winch.shape
        if shapes != ((len(self.points), 3), (len(self.winches),)):
            raise LinkError(
                f"{self.name} has {len(self.points)} points and {len(self.winches)} winches; it measured "
                f"points of the shape {shapes[0]} and winches of the shape {shapes[1]}."
            )
        if not np.isfinite([sample.time, sample.stamp]).all():
            raise LinkError(
                f"{self.name} gave the time {sample.time} and the stamp {sample.stamp}."
            )
        return sample

    @classmethod
    def of(cls, robot: Robot, period: float, **more: float | bool) -> RobotInfo:
        """What a robot of this MJCF says.

        Args:
          robot: of the MJCF.
          period: of its control loop [s].
          more: latency, dead_man, real_time.
        """
        return cls(
            robot.name,
            tuple(point.name for point in robot.points),
            tuple(winch.name for winch in robot.winches),
            robot.control_low,
            robot.control_high,
            period,
            **more,  # type: ignore[arg-type]  # a number where numbers go, and a bool where that goes
        )


@dataclass(frozen=True)
class Sample:
    """What a robot measured.

    Attributes:
      time: of the robot's clock now [s].
      stamp: when this was measured, by the same clock [s]. A stamp that came before brings nothing new.
      points: (P, 3) positions of the tracked points [m]; NaN where missing.
      winch: (W,) winch positions, as rest length paid out [m]; NaN where not measured.
    """

    time: float
    stamp: float
    points: Floats
    winch: Floats

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(P,) whether each point was measured."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))


@runtime_checkable
class RobotLink(Protocol):
    """A robot that can be driven, real or simulated. One at a time may drive it.

    Every call raises LinkError where the robot cannot be reached, refuses, or answers with what cannot be
    understood. It is stopped then, as far as it can be.
    """

    @property
    def info(self) -> RobotInfo:
        """What the robot says about itself."""
        ...

    def reset(self, seed: int = 0) -> None:
        """Stand still where an episode begins; the clock begins at 0.

        Args:
          seed: of what is random in a simulated robot. A real one has no use for it.
        """
        ...

    def observe(self) -> Sample:
        """Wait for the next control period, and give the newest measurement. The first comes at once."""
        ...

    def send(self, controls: Floats, valid_until: float) -> None:
        """Command (W,) that acts from now on.

        Args:
          controls: within the limits; what is beyond is cut off.
          valid_until: time of the robot's clock after which it holds still [s].
        """
        ...

    def stop(self) -> None:
        """Hold the winches still until the next command."""
        ...

    def close(self) -> None:
        """Stop, and let others drive."""
        ...
