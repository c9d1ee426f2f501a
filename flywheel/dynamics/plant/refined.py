"""The same plant with smaller time steps, to tell numbers from physics, or with cheaper ones."""

from __future__ import annotations

from dataclasses import replace

import mujoco

from flywheel.dynamics.plant.plant import Plant

IMPLICIT = (mujoco.mjtIntegrator.mjINT_IMPLICIT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


def refined(plant: Plant, times: int = 2) -> Plant:
    """A plant whose MuJoCo steps are `times` shorter; its control step stays. Itself for 1."""
    if times == 1:
        return plant
    spec = mujoco.MjSpec.from_string(plant.robot.xml)
    spec.option.timestep = plant.robot.timestep / times
    return _of(spec, plant)


def hasty(plant: Plant) -> Plant:
    """A plant with an explicit integrator, whose steps cost a quarter less; itself if it has one already."""
    spec = mujoco.MjSpec.from_string(plant.robot.xml)
    if spec.option.integrator not in IMPLICIT:
        return plant
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return _of(spec, plant)


def _of(spec: mujoco.MjSpec, plant: Plant) -> Plant:
    # The MJCF is not read again: a fitted plant may have winches that the reader would refuse.
    robot = replace(plant.robot, xml=spec.to_xml(), timestep=spec.option.timestep)
    return Plant(robot, *plant.arguments())
