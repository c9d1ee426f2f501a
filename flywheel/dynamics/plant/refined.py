"""The same plant with smaller time steps, to separate numerical errors from physics, or with
cheaper ones.
"""

from __future__ import annotations

from dataclasses import replace

from flywheel.dynamics.plant.plant import Plant
from flywheel.robots.integrators import IMPLICIT


def refined(plant: Plant, times: int = 2) -> Plant:
    """A plant whose MuJoCo steps are `times` shorter; its control step stays. Itself for 1."""
    if times == 1:
        return plant
    return with_steps(plant, plant.robot.integrator, plant.robot.timestep / times)


def hasty(plant: Plant) -> Plant:
    """A plant with an explicit integrator, in steps twice as long where that divides its control step.

    Itself if it is explicit and its steps cannot be longer.
    """
    times = 1 if plant.substeps % 2 else 2
    if times == 1 and plant.robot.integrator not in IMPLICIT:
        return plant
    return with_steps(plant, "Euler", times * plant.robot.timestep)


def with_steps(plant: Plant, integrator: str, timestep: float) -> Plant:
    """A plant with another of MuJoCo's integrators, and another step [s]; its control step stays."""
    # The MJCF is neither read nor written again: a fitted plant may have winches that the reader would
    # refuse, and numbers that MuJoCo writes have six digits.
    robot = replace(plant.robot, integrator=integrator, timestep=timestep)
    return Plant(robot, *plant.arguments())
