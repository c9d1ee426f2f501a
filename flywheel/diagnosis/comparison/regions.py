"""Regions: place and motion of the robot at every sample, from the measurements alone.

The bins are the same for every model, because no prediction enters them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.comparison.forecast_windows import ForecastWindows
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.records import Floats, Observation, Past
from flywheel.robots import Attachment, Robot

NEAR = 3.0  # heights below this many sigmas are contact
MOVING = 0.02  # of a winch's range of commands; less is holding
THIRDS = (1 / 3, 2 / 3)


@dataclass(frozen=True)
class Region:
    """A criterion.

    Attributes:
      of: sorted errors: "points" or "cables".
      by: its name.
      labels: of its bins.
      place: (K, steps, P or C) index of each sample's bin.
    """

    of: str
    by: str
    labels: tuple[str, ...]
    place: np.ndarray


def regions(windows: ForecastWindows) -> tuple[Region, ...]:
    """All criteria that apply to a robot."""
    robot = windows.robot
    places, speeds = (windows.ahead(part) for part in zip(*windows.smooth, strict=True))
    winch = windows.ahead(windows.winch)
    found = [_speed(np.linalg.norm(speeds, axis=-1))]
    if robot.grounded and any(point.radius for point in robot.points):
        found.append(_height(windows, places))
    found.append(_tension(cable_tensions(robot, places, winch, windows.dt)))
    found.append(_command(windows))
    return tuple(found)


def _height(windows: ForecastWindows, places: Floats) -> Region:
    radius = np.array([point.radius for point in windows.robot.points])
    airborne = places[..., 2] - radius > NEAR * windows.sigma
    return Region("points", "contact", ("on the ground", "in the air"), airborne.astype(int))


def _speed(speed: Floats) -> Region:
    low, high = np.quantile(speed, THIRDS)
    labels = (f"below {low:.2g} m/s", f"{low:.2g} to {high:.2g} m/s", f"above {high:.2g} m/s")
    return Region("points", "speed", labels, np.searchsorted([low, high], speed))


def _tension(tension: Floats) -> Region:
    taut = tension > 0
    low, high = np.quantile(tension[taut], THIRDS) if taut.any() else (0.0, 0.0)
    labels = ("slack", f"below {low:.3g} N", f"{low:.3g} to {high:.3g} N", f"above {high:.3g} N")
    place = np.where(taut, 1 + np.searchsorted([low, high], tension), 0)
    return Region("cables", "tension", labels, place)


def _command(windows: ForecastWindows) -> Region:
    """By the command of the cable's winch in the step before each sample."""
    robot, controls = windows.robot, windows.controls()
    asked = np.abs(controls - robot.holding(windows.before(windows.winch)))
    moving = asked > MOVING * (robot.control_high - robot.control_low)
    driven = np.array([cable.winch for cable in robot.cables])
    place = np.full((*moving.shape[:-1], len(driven)), 2)
    place[..., driven >= 0] = moving[..., driven[driven >= 0]]
    return Region("cables", "command", ("holding", "moving", "no winch"), place)


def spans(robot: Robot, points: Floats) -> Floats:
    """(..., C) distances between the ends of the cables, from tracked points (..., P, 3) [m]."""

    def end(attachment: Attachment) -> Floats:
        return attachment.offset if attachment.point < 0 else points[..., attachment.point, :]

    ends = [[end(attachment) for attachment in cable.ends] for cable in robot.cables]
    return np.stack([np.linalg.norm(a - b, axis=-1) for a, b in ends], axis=-1)


def span_noise(robot: Robot) -> Floats:
    """(C,) standard deviation of a measured span, in those of a coordinate."""
    seen = [sum(attachment.point >= 0 for attachment in c.ends) for c in robot.cables]
    return np.sqrt(np.maximum(seen, 1))


def cable_tensions(robot: Robot, points: Floats, winch: Floats, dt: float) -> Floats:
    """Elastic tensions (K, T, C) [N] of nominal cables; 0 where slack.

    Args:
      robot: of the cables.
      points: (K, T, P, 3), without gaps [m].
      winch: (K, T, W) winch positions [m].
      dt: control step [s].
    """
    lead = points.shape[:2]
    flat = points.reshape(-1, 1, *points.shape[2:])
    wound = winch.reshape(len(flat), 1, winch.shape[-1])
    past = Past(Observation(flat, wound), np.zeros((len(flat), 0, wound.shape[-1])), wound)
    state = RestartedPlant(Plant(robot, dt), roll="relaxed").estimate(past)
    poses = state.qpos.reshape(len(state.qpos), -1, 7)
    stretch = robot.cable_lengths(poses) - rest_lengths(robot, wound[:, 0])
    stiffness = np.array([cable.stiffness for cable in robot.cables])
    tensions = stiffness * np.maximum(stretch, 0.0) + robot.told_tensions(wound[:, 0])
    return tensions.reshape(*lead, -1)
