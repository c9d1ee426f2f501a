"""What `power` and `design` share: noise as people write it, and lines about the plant."""

from __future__ import annotations

import math

from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError
from flywheel.robots import Robot

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def length_of(text: str, robot: Robot) -> float:
    """A length [m]; a number without a unit is a share of the robot's length.

    Raises:
      ConfigError: not a positive number, or another unit.
    """
    unit = next((name for name in UNITS if text.endswith(name)), "")
    try:
        value = float(text.removesuffix(unit))
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise ConfigError(
            f"A length is a positive number of {', '.join(UNITS)}, or without a unit a share of the "
            f"robot's ({robot.length:g} m): 9mm, 0.009m, 0.003. Got {text!r}."
        )
    return value * (UNITS[unit] if unit else robot.length)


def about_plant(plant: Plant) -> dict[str, str]:
    """Lines of two columns for a page."""
    robot = plant.robot
    return {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "effects it has": ", ".join(term.label(robot) for term in plant.terms) or "none",
        "control step": f"{plant.dt:g} s, MuJoCo steps of {robot.timestep:g} s",
    }
