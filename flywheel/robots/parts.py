"""Parts of a robot: rigid bodies, tracked points, cables and winches."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flywheel.records import Floats

WinchKind = Literal["rate", "position", "tension"]
UNITS: dict[WinchKind, str] = {"rate": "m/s", "position": "m", "tension": "N"}  # of commands


@dataclass(frozen=True)
class Primitive:
    """One geometric piece of a rigid body.

    Attributes:
      name: the geom's name, or one made from its body and number.
      shape: MuJoCo's geom type in lower case ("sphere", "cylinder", "capsule", "box", ...).
      size: (3,) half-sizes as in MJCF [m].
      offset: (3,) centre in the body frame [m].
      axis: (3,) unit z-axis of the geom in the body frame.
      mass: [kg].
      inertia: (3,) principal moments about its centre in the geom frame [kg m^2].
      collides: takes part in contact with the ground.
    """

    name: str
    shape: str
    size: Floats
    offset: Floats
    axis: Floats
    mass: float
    inertia: Floats
    collides: bool


@dataclass(frozen=True)
class Body:
    """A rigid body that can move.

    Attributes:
      name: as in the MJCF.
      mass: [kg].
      inertia: (3,) principal moments about the centre of mass [kg m^2].
      com: (3,) centre of mass in the body frame [m].
      primitives: its geometric pieces.
      points: indices into `Robot.points` of the tracked points on it.
      principal: (3, 3) its columns are the principal axes in the body frame, in the moments' order.
    """

    name: str
    mass: float
    inertia: Floats
    com: Floats
    primitives: tuple[Primitive, ...]
    points: tuple[int, ...]
    principal: Floats = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True)
class TrackedPoint:
    """A point measured by the robot's sensors: an end cap, or a marker.

    Attributes:
      name: the sensor's name; recordings' columns are `<name>.x/.y/.z`.
      body: index into `Robot.bodies`.
      offset: (3,) in the body frame [m].
      radius: of its contact sphere [m]; 0 without one.
    """

    name: str
    body: int
    offset: Floats
    radius: float


@dataclass(frozen=True)
class Attachment:
    """End of a cable: `offset` [m] in the frame of body `body`, or of the world if body is -1.

    Attributes:
      body: index into `Robot.bodies`, -1 for the world.
      offset: (3,) [m].
      point: index of the nearest tracked point on the same body, -1 for the world. The learner,
        which cannot see the roll, assumes the cable to end there.
    """

    body: int
    offset: Floats
    point: int


@dataclass(frozen=True)
class Cable:
    """A tension-only element between two attachments.

    Attributes:
      name: the tendon's name.
      ends: its two attachments.
      stiffness: [N/m]; 0 if its winch takes tensions, whatever its length.
      damping: [N s/m].
      rest_length: at the keyframe [m]; 0 if its winch takes tensions.
      winch: index into `Robot.winches` of the winch that drives it, -1 if passive.
      strongest: pull of its winch [N].
    """

    name: str
    ends: tuple[Attachment, Attachment]
    stiffness: float
    damping: float
    rest_length: float
    winch: int
    strongest: float = np.inf


@dataclass(frozen=True)
class Winch:
    """A motor that changes the rest length, or the tension, of one or several cables in fixed ratios.

    Attributes:
      name: of the control: the actuator's name, or that of the MJCF's tuple of several actuators;
        recordings' column is `ctrl.<name>`.
      kind: "rate" (control = rate of the rest length [m/s], positive pays out) or "position"
        (control = desired rest length [m], reached with a first-order lag) or "tension" (control =
        desired tension [N], reached with a first-order lag at any length of the cable).
      cables: indices into `Robot.cables`. The first is the one whose actuator is measured, else the
        first one of the tuple: the winch's position is its rest length, or its tension.
      actuators: indices of the MJCF's actuators driven by this control, one per cable.
      activation: index of its position in `State.act`.
      control_range: (low, high) of the control [m/s, m or N].
      rest_range: (low, high) of its position [m or N].
      time_constant: of the lag [s]; 0 for a rate winch.
      measured: the MJCF has a sensor for its position.
      sensor: that sensor's name, the recordings' column; "" without one.
      ratios: change of each cable's rest length per change of the winch's position; 1 for the first, -1
        for its antagonist on the same drum.
    """

    name: str
    kind: WinchKind
    cables: tuple[int, ...]
    actuators: tuple[int, ...]
    control_range: tuple[float, float]
    rest_range: tuple[float, float]
    time_constant: float
    measured: bool
    activation: int
    sensor: str = ""
    ratios: tuple[float, ...] = (1.0,)

    @property
    def alike(self) -> bool:
        """True if all its cables change by the same amount."""
        return all(ratio == 1.0 for ratio in self.ratios)

    @property
    def unit(self) -> str:
        """Unit of its commands."""
        return UNITS[self.kind]

    @property
    def position_unit(self) -> str:
        """Unit of its position."""
        return "N" if self.kind == "tension" else "m"
