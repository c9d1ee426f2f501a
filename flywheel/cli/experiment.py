"""What `power` and `design` share: noise as people write it, and lines about the plant."""

from __future__ import annotations

from flywheel.cli.options import number
from flywheel.dynamics.plant import Plant
from flywheel.quantities import FACTOR
from flywheel.robots import Robot

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def length_of(text: str, robot: Robot) -> float:
    """A length [m]; a number without a unit is a share of the robot's length.

    Raises:
      ConfigError: not a positive number, or another unit.
    """
    unit = next((name for name in UNITS if text.endswith(name)), "")
    what = (
        f"A length, in {', '.join(UNITS)}, or without a unit as a share of the robot's "
        f"({robot.length:g} m), such as 9mm, 0.009m, 0.003,"
    )
    value = number(text.removesuffix(unit), what, FACTOR)
    return value * (UNITS[unit] if unit else robot.length)


def about_plant(plant: Plant) -> dict[str, str]:
    """Lines of two columns for a page."""
    robot = plant.robot
    return {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "effects it has": ", ".join(term.label(robot) for term in plant.terms) or "none",
        "control step": f"{plant.dt:g} s, MuJoCo steps of {robot.timestep:g} s",
    }
