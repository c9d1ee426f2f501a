"""The interface of a robot to its driver: it is reset, observed, commanded, and stopped.

**Time.** A robot has its own clock, in seconds since its last reset, and a control period.
`observe` waits for the next period to begin; a command sent after it acts until the next one is
sent, or until it expires. Then the robot holds its winches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flywheel.errors import LinkError
from flywheel.records import Floats
from flywheel.robots import Robot

LONGEST = 1e9  # of a robot's clock [s]; seconds since 1970 are more


@dataclass(frozen=True)
class RobotInfo:
    """Description of a robot by itself.

    Attributes:
      name: of the robot.
      points, winches: names of its measured points and of its winches, as in its MJCF.
      control_low, control_high: (W,) limits of its commands.
      period: of its control loop [s].
      latency: age of its measurements on arrival, as far as known [s].
      dead_man: longest validity of a command [s].
      real_time: its clock runs by itself; else it waits to be observed.
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
        """Check that a robot is the one of an MJCF.

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
                    f"The robot {self.name} takes commands with {what} {there.tolist()}; the MJCF "
                    f"of {robot.name} has {here.tolist()}."
                )

    def check(self, sample: Sample) -> Sample:
        """The sample, checked for this robot.

        Raises:
          LinkError: it has another number of points or winches, or an invalid time.
        """
        shapes = sample.points.shape, sample.winch.shape
        if shapes != ((len(self.points), 3), (len(self.winches),)):
            raise LinkError(
                f"{self.name} has {len(self.points)} points and {len(self.winches)} winches; it measured "
                f"points of the shape {shapes[0]} and winches of the shape {shapes[1]}."
            )
        known = abs(sample.time) <= LONGEST and abs(sample.stamp) <= LONGEST
        if not known or not sample.stamp <= sample.time + self.period:
            raise LinkError(
                f"{self.name} gave the time {sample.time:g} s and the stamp {sample.stamp:g} s: a "
                "measurement is stamped by the robot's own clock, in seconds since its reset, before it "
                "arrives."
            )
        return sample

    def clipped(self, controls: Floats) -> Floats:
        """A command (W,) within the limits.

        Raises:
          LinkError: it is not a command for this robot.
        """
        controls = np.asarray(controls, float)
        if controls.shape != self.control_low.shape or not np.isfinite(controls).all():
            raise LinkError(
                f"{self.name} takes {len(self.control_low)} finite commands, got "
                f"{np.array2string(controls, threshold=20)}."
            )
        return np.clip(controls, self.control_low, self.control_high)

    @classmethod
    def of(cls, robot: Robot, period: float, **more: float | bool) -> RobotInfo:
        """The description of a robot of this MJCF.

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
    """A measurement of a robot.

    Attributes:
      time: of the robot's clock now [s].
      stamp: of the measurement, by the same clock [s]. A repeated stamp contains nothing new.
      points: (P, 3) positions of the tracked points [m]; NaN where missing.
      winch: (W,) winch positions, as rest length paid out [m]; NaN if not measured.
    """

    time: float
    stamp: float
    points: Floats
    winch: Floats

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(P,) bool: True for a measured point."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))


@runtime_checkable
class RobotLink(Protocol):
    """A robot that can be driven, real or simulated, by one driver at a time.

    Every call raises LinkError if the robot cannot be reached, rejects the request, or gives an
    invalid answer. It is stopped then, as far as possible.
    """

    @property
    def info(self) -> RobotInfo:
        """The description of the robot."""
        ...

    def reset(self, seed: int = 0) -> None:
        """Rest at the start of an episode; the clock starts at 0.

        Args:
          seed: of random numbers in a simulated robot. Ignored by a real one.
        """
        ...

    def observe(self) -> Sample:
        """Wait for the next control period, and return the newest measurement. The first call
        returns at once.
        """
        ...

    def send(self, controls: Floats, valid_until: float) -> None:
        """Send a command (W,) that acts from now on.

        Args:
          controls: clipped to the limits.
          valid_until: time of the robot's clock after which it holds its winches [s].
        """
        ...

    def stop(self) -> None:
        """Hold the winches until the next command."""
        ...

    def close(self) -> None:
        """Stop, and release the robot for others."""
        ...
