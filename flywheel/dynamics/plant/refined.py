"""The same plant with smaller time steps, to tell numbers from physics."""

from __future__ import annotations

import mujoco

from flywheel.dynamics.plant.plant import Plant
from flywheel.robots import Robot


def refined(plant: Plant, times: int = 2) -> Plant:
    """A plant whose MuJoCo steps are `times` shorter; its control step stays. Itself for 1."""
    if times == 1:
        return plant
    spec = mujoco.MjSpec.from_string(plant.robot.xml)
    spec.option.timestep = plant.robot.timestep / times
    robot = Robot.from_mjcf(spec.to_xml())
    return Plant(robot, *plant.arguments())
