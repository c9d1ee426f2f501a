"""Verdict on a robot by its motion while its winches hold, and the control step of that."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flywheel.dynamics.plant import Settling
    from flywheel.robots import Robot

# Times as long as a robot is the space between its fixed cable ends, where that is named.
SMALL = 3.0
DT = 0.01  # between commands, unless it is given: what all commands take [s]


def control_step(robot: Robot, dt: float | None) -> float:
    """The control step [s]: as given, or the default for the robot.

    Raises:
      ConfigError: it is not a multiple of the MJCF's timestep.
    """
    from flywheel.errors import ConfigError

    steps = robot.control_steps(DT if dt is None else dt)
    if dt is not None and steps != (dt,):
        raise ConfigError(
            f"--dt {dt:g} s is not a multiple of the timestep of {robot.name}, {robot.timestep:g} "
            f"s; {' or '.join(f'{step:.12g}' for step in steps)} s is."
        )
    return steps[0]


def share(robot: Robot, distance: float) -> str:
    """A distance [m] as a share of L, and of the space in which a small robot hangs."""
    words = f"{100 * distance / robot.length:.3g} % of L"
    if robot.span > SMALL * robot.length:
        words += f", {100 * distance / robot.span:.3g} % of the {robot.span:.3g} m between fixed cable ends"
    return words


def verdict(robot: Robot, found: Settling) -> tuple[bool, str]:
    """True if a robot can be used, judged by its motion while its winches hold, and a sentence."""
    moved = f"{found.moved:.3g} m ({share(robot, found.moved)}) from its keyframe"
    if found.lost and not (robot.grounded or robot.tethered):
        return False, (
            f"Nothing holds it, and it falls: {moved}. No cable ends on the world, and there is no ground: "
            'a plane (<geom type="plane" size="0 0 1"/>) is one.'
        )
    if found.lost:
        return False, f"It flies away: {moved}."
    if found.still:
        return True, f"It settles: {moved}, at {found.speed:.3g} m/s, after some seconds."
    speeds = f"from {found.early:.3g} to {found.late:.3g} m/s"
    if found.grows:
        return False, (
            f"Its motion grows, {speeds}. Is the timestep too long for the stiffness of cables and "
            "contacts, or their damping too large for it?"
        )
    swings = "It swings" + (f" every {found.period:.3g} s" if math.isfinite(found.period) else "")
    if math.isinf(found.time_constant):
        return True, f"{swings} without decay ({speeds} within 10 s): episodes begin like this."
    return True, (
        f"{swings}, with a time constant of {found.time_constant:.3g} s ({speeds} within 10 s): episodes "
        "begin like this. More damping of cables (biasprm's third number, damping) calms it sooner."
    )
