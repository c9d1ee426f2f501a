"""What stands around the robot: the MJCF with box obstacles added, on a ground that need not be flat."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from flywheel.errors import ModelError
from flywheel.robots import Box, Robot
from flywheel.terrain import Terrain

BOX_COLOR = (0.55, 0.50, 0.46, 1.0)
BASE = 0.5  # thickness of a terrain below its lowest place [m]
LEAST_RELIEF = 1e-6  # of a terrain: MuJoCo's height fields have a height [m]


def scene(
    robot: Robot, obstacles: Sequence[Box] = (), terrain: Terrain | None = None
) -> mujoco.MjSpec:
    """The robot's MJCF with the obstacles and the terrain, which touch as its ground does.

    They get the contact numbers of the MJCF's ground plane, or MuJoCo's own without one.

    Raises:
      ModelError: a terrain for a robot whose MJCF has no level ground plane.
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
        _touch_alike(geom, ground)
    if terrain is not None:
        if ground is None or ground.quat[0] ** 2 < 1.0 - 1e-12:
            raise ModelError(
                f"A terrain takes the place of a level ground plane, which {robot.name} does not have."
            )
        _lay(spec, terrain, ground)
    return spec


def _lay(spec: mujoco.MjSpec, terrain: Terrain, ground: mujoco.MjsGeom) -> None:
    """Put a terrain where the ground was, and the ground around it."""
    lowest = float(terrain.heights.min())
    relief = max(float(terrain.heights.max()) - lowest, LEAST_RELIEF)
    half_x, half_y = (side / 2 for side in terrain.size)
    columns, rows = terrain.heights.shape  # MuJoCo's rows go along y
    spec.add_hfield(
        name="terrain",
        nrow=rows,
        ncol=columns,
        size=[half_x, half_y, relief, BASE],
        userdata=(terrain.heights.T - lowest).ravel().tolist(),
    )
    geom = spec.worldbody.add_geom(
        name="terrain",
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname="terrain",
        pos=[terrain.origin[0] + half_x, terrain.origin[1] + half_y, lowest],
        material=ground.material,
        rgba=ground.rgba,
    )
    _touch_alike(geom, ground)
    ground.pos = [*ground.pos[:2], terrain.plane]


def _touch_alike(geom: mujoco.MjsGeom, ground: mujoco.MjsGeom | None) -> None:
    if ground is not None:
        geom.friction, geom.condim = ground.friction, ground.condim
        geom.solref, geom.solimp = ground.solref, ground.solimp
