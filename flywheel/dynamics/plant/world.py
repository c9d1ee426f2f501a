"""The scene: the robot's MJCF plus terrain and boxes."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.errors import ModelError
from flywheel.robots import Box, Ground, Robot, add_plain, free_name, ground_of
from flywheel.robots.integrators import INTEGRATORS
from flywheel.terrain import Terrain, is_level

BOX_COLOR = (0.55, 0.50, 0.46, 1.0)
BASE = 0.5  # thickness of a terrain below its lowest place [m]
LEAST_RELIEF = 1e-6  # of a terrain: MuJoCo's height fields have a height [m]
CONTACT = (  # what MuJoCo makes a contact of, besides shapes
    "contype", "conaffinity", "condim", "priority", "friction", "solmix", "solref", "solimp",
    "margin", "gap", "adhesion",
)  # fmt: skip
PAIRED = ("condim", "friction", "solref", "solreffriction", "solimp", "margin", "gap", "adhesion")


def scene(robot: Robot, terrain: Terrain | None = None) -> mujoco.MjSpec:
    """The robot's MJCF with the terrain and its boxes, with the ground's contact parameters.

    Without a ground in the MJCF they have MuJoCo's defaults. They are part of the same contact pairs.

    Raises:
      ModelError: a terrain for a robot whose MJCF has no level ground plane.
    """
    spec = mujoco.MjSpec.from_string(robot.xml)
    spec.option.timestep, spec.option.integrator = robot.timestep, INTEGRATORS[robot.integrator]
    if terrain is None:
        return spec
    model = spec.compile()
    ground = ground_of(model)
    plane = None if ground is None else _geom(spec, ground.geom)
    added = [_add_box(spec, box, number) for number, box in enumerate(terrain.boxes)]
    if not is_level(terrain):
        if ground is None or plane is None or not ground.level:
            raise ModelError(
                f"A terrain takes the place of a level ground plane, which {robot.name} does not have."
            )
        added.append(_add_height_field(spec, terrain, plane))
        _move_plane(plane, model, ground, terrain.plane)
    if plane is not None:
        for geom in added:
            _copy_contact_parameters(spec, geom, plane)
    return spec


def strip_visuals(spec: mujoco.MjSpec) -> None:
    """Remove purely visual elements: a ground's texture is most of a model, and slow to compile.

    sysid's own `remove_visuals` would also remove masses: those of geoms without collisions.
    """
    for each in (*spec.geoms, *spec.sites, *spec.tendons):
        each.material = ""
    for light in spec.lights:
        light.texture = ""
    for visual in (*spec.materials, *spec.textures):
        spec.delete(visual)


def _geom(spec: mujoco.MjSpec, number: int) -> mujoco.MjsGeom:
    """The geom with this number in the compiled model."""
    return next(geom for geom in spec.geoms if geom.id == number)


def _add_box(spec: mujoco.MjSpec, box: Box, number: int) -> mujoco.MjsGeom:
    """Add a box to the world."""
    return add_plain(
        spec.worldbody,
        "geom",
        name=free_name(f"obstacle{number}", spec.geoms),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=box.center,
        quat=box.quaternion,
        size=box.half_size,
        rgba=BOX_COLOR,
    )


def _add_height_field(
    spec: mujoco.MjSpec, terrain: Terrain, plane: mujoco.MjsGeom
) -> mujoco.MjsGeom:
    """Add a terrain to the world, with the plane's material and colour."""
    lowest = float(terrain.heights.min())
    relief = max(float(terrain.heights.max()) - lowest, LEAST_RELIEF)
    half_x, half_y = (side / 2 for side in terrain.size)
    columns, rows = terrain.heights.shape  # MuJoCo's rows go along y
    field = add_plain(
        spec,
        "hfield",
        name=free_name("terrain", spec.hfields),
        nrow=rows,
        ncol=columns,
        size=[half_x, half_y, relief, BASE],
        userdata=(terrain.heights.T - lowest).ravel().tolist(),
    )
    return add_plain(
        spec.worldbody,
        "geom",
        name=free_name("terrain", spec.geoms),
        type=mujoco.mjtGeom.mjGEOM_HFIELD,
        hfieldname=field.name,
        pos=[terrain.origin[0] + half_x, terrain.origin[1] + half_y, lowest],
        material=plane.material,
        rgba=plane.rgba,
    )


def _move_plane(
    plane: mujoco.MjsGeom, model: mujoco.MjModel, ground: Ground, height: float
) -> None:
    """Move the ground's plane to another height [m], in any body and frame."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[ground.geom])
    up = turn.reshape(3, 3)[:, 2]  # the plane is level: world z, in the frame of its body
    # A geom's position is relative to its innermost <frame>; in this new one it is relative to the body.
    plane.set_frame(add_plain(plane.parent, "frame"))
    plane.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    plane.quat = model.geom_quat[ground.geom]
    plane.pos = model.geom_pos[ground.geom] + (height - ground.height) * up


def _copy_contact_parameters(
    spec: mujoco.MjSpec, geom: mujoco.MjsGeom, plane: mujoco.MjsGeom
) -> None:
    """Give a geom the plane's contact parameters, and its contact pairs."""
    for name in CONTACT:
        setattr(geom, name, getattr(plane, name))
    for pair in list(spec.pairs):
        ends = [pair.geomname1, pair.geomname2]
        if plane.name and plane.name in ends:
            first, second = (geom.name if end == plane.name else end for end in ends)
            numbers = {name: getattr(pair, name) for name in PAIRED}
            add_plain(spec, "pair", geomname1=first, geomname2=second, **numbers)
