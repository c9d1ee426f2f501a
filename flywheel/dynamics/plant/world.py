"""What stands around the robot: the MJCF with box obstacles added."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from flywheel.robots import Box, Robot

BOX_COLOR = (0.55, 0.50, 0.46, 1.0)


def scene(robot: Robot, obstacles: Sequence[Box] = ()) -> mujoco.MjSpec:
    """The robot's MJCF with the obstacles, which touch as its ground does.

    They get the contact numbers of the MJCF's ground plane, or MuJoCo's own without one.
    """
    spec = mujoco.MjSpec.from_string(robot.xml)
    ground = next((g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_PLANE), None)
    for number, box in enumerate(obstacles):
        geom = spec.worldbody.add_geom(
            name=f"obstacle{number}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.center,
            size=box.half_size,
            rgba=BOX_COLOR,
        )
        if ground is not None:
            geom.friction, geom.condim = ground.friction, ground.condim
            geom.solref, geom.solimp = ground.solref, ground.solimp
    return spec
