"""Rigid bodies, their geometric pieces and their tracked points, as in the MJCF."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots.added import add_plain
from flywheel.robots.ground import collides
from flywheel.robots.parts import Body, Primitive, TrackedPoint

SOLIDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box")


def moving_bodies(model: mujoco.MjModel) -> list[int]:
    """MuJoCo's ids of the independently moving bodies, in the order of `Robot.bodies`."""
    static = model.body_weldid == 0
    return [b for b in range(model.nbody) if model.body_weldid[b] == b and not static[b]]


def body_index(model: mujoco.MjModel, mujoco_body: int) -> int:
    """Index into `Robot.bodies` of MuJoCo's body, or of the one it is welded to; -1: the world."""
    root = int(model.body_weldid[mujoco_body])
    return moving_bodies(model).index(root) if root else -1


def in_body_frame(model: mujoco.MjModel, data: mujoco.MjData, body: int, at: Floats) -> Floats:
    """The world point `at` (3,) in the frame of `Robot.bodies[body]`, or of the world if -1 [m].

    Rounded to a picometre, to remove the rounding errors of the transformations.
    """
    if body < 0:
        return np.round(at, 12) + 0.0
    root = moving_bodies(model)[body]
    return np.round(data.xmat[root].reshape(3, 3).T @ (at - data.xpos[root]), 12) + 0.0


def tracked_site(model: mujoco.MjModel, point: TrackedPoint) -> tuple[int, Floats]:
    """The site of a point's sensor, by MuJoCo's id, and the rotation of its body.

    Returns:
      The site, and the rotation (3, 3) from the frame of the site's body to that of the moving
      body, in which `TrackedPoint.offset` is given: they differ for a site on a welded body.
    """
    site = int(model.sensor(point.name).objid[0])
    return site, turn_of(model, int(model.site_bodyid[site]))


def turn_of(model: mujoco.MjModel, body: int) -> Floats:
    """Rotation (3, 3) from the frame of MuJoCo's `body` to that of the body to which it is welded."""
    turn = np.eye(3)
    while model.body_weldid[body] != body:
        here = np.zeros(9)
        mujoco.mju_quat2Mat(here, model.body_quat[body])
        body, turn = int(model.body_parentid[body]), here.reshape(3, 3) @ turn
    return turn


def read_bodies(
    spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData
) -> tuple[tuple[Body, ...], tuple[TrackedPoint, ...]]:
    """Bodies with their primitives, and the tracked points on them.

    Raises:
      RobotError: no `framepos` sensor of a site on a moving body in the world, or bodies without any.
    """
    points = _points(model, data)
    mass, inertia = _geom_inertia(spec, model)
    bodies, unseen = [], []
    for index, root in enumerate(moving_bodies(model)):
        on_it = tuple(i for i, point in enumerate(points) if point.body == index)
        name = model.body(root).name
        if not on_it:
            unseen.append(repr(name))
            continue
        total, moments, com, principal = _mass_of(model, data, root)
        primitives = _primitives(model, data, index, mass, inertia, total)
        bodies.append(Body(name, total, moments, com, primitives, on_it, principal))
    if unseen:
        whom = "the body" if len(unseen) == 1 else "the bodies"
        raise RobotError(
            f"Nothing measures {whom} {', '.join(unseen)}: each needs a framepos sensor (objtype site) on it."
        )
    return tuple(bodies), points


def _points(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[TrackedPoint, ...]:
    points, others = [], []
    for sensor in range(model.nsensor):
        if model.sensor_type[sensor] != mujoco.mjtSensor.mjSENS_FRAMEPOS:
            continue
        name = model.sensor(sensor).name
        site = int(model.sensor_objid[sensor])
        is_site = model.sensor_objtype[sensor] == mujoco.mjtObj.mjOBJ_SITE
        in_world = model.sensor_refid[sensor] < 0
        body = body_index(model, model.site_bodyid[site]) if is_site else -1
        if not in_world or body < 0:
            others.append(repr(name))
            continue
        offset = in_body_frame(model, data, body, data.site_xpos[site])
        points.append(TrackedPoint(name, body, offset, _touching_radius(model, data, body, site)))
    if not points:
        but = (
            f" ({', '.join(others)}: not of a site that moves, or not in the world)"
            if others
            else ""
        )
        raise RobotError(
            f"The MJCF has no framepos sensor, so nothing could be tracked{but}. Put one (objtype site, no "
            "reftype) on each end cap or marker."
        )
    return tuple(points)


def _touching_radius(model: mujoco.MjModel, data: mujoco.MjData, body: int, site: int) -> float:
    """Radius of the contact sphere around the site [m], 0 if there is none."""
    spheres = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    root = moving_bodies(model)[body]
    here = np.linalg.norm(data.geom_xpos - data.site_xpos[site], axis=1) < 1e-6
    on_body = model.body_weldid[model.geom_bodyid] == root
    touching = spheres & here & on_body & collides(model)
    return float(model.geom_size[touching, 0].max()) if touching.any() else 0.0


def _geom_inertia(spec: mujoco.MjSpec, model: mujoco.MjModel) -> tuple[Floats, Floats]:
    """Mass (ngeom,) and principal moments (ngeom, 3) of each geom, as in MuJoCo's compiler.

    The compiled model keeps only sums over bodies, so each solid geom is compiled again, alone.
    """
    alone = mujoco.MjSpec()
    ids = []
    for geom in spec.geoms:
        if _shape(model, geom.id) in SOLIDS:
            body = add_plain(alone.worldbody, "body")
            solid = {"type": geom.type, "size": model.geom_size[geom.id]}
            weight = {name: getattr(geom, name) for name in ("mass", "density", "typeinertia")}
            add_plain(body, "geom", **solid, **weight)
            ids.append(geom.id)
    compiled = alone.compile()
    mass, inertia = np.zeros(model.ngeom), np.zeros((model.ngeom, 3))
    mass[ids], inertia[ids] = compiled.body_mass[1:], compiled.body_inertia[1:]
    return mass, inertia


def _shape(model: mujoco.MjModel, geom: int) -> str:
    kind = mujoco.mjtGeom(int(model.geom_type[geom])).name
    return kind.removeprefix("mjGEOM_").lower()


def _primitives(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: int,
    mass: Floats,
    inertia: Floats,
    total: float,
) -> tuple[Primitive, ...]:
    """The solid geoms of a body; their masses scaled to its mass if <inertial> gives that."""
    root = moving_bodies(model)[body]
    on_body = model.body_weldid[model.geom_bodyid] == root
    geoms = [g for g in np.flatnonzero(on_body).tolist() if _shape(model, g) in SOLIDS]
    weighed = sum(mass[g] for g in geoms)
    scale = total / weighed if weighed > 0 else 0.0
    to_body = data.xmat[root].reshape(3, 3).T
    touching = collides(model)
    return tuple(
        Primitive(
            name=model.geom(g).name or f"{model.body(root).name}.{number}",
            shape=_shape(model, g),
            size=model.geom_size[g].copy(),
            offset=in_body_frame(model, data, body, data.geom_xpos[g]),
            axis=np.round(to_body @ data.geom_xmat[g].reshape(3, 3)[:, 2], 12) + 0.0,
            mass=float(mass[g] * scale),
            inertia=inertia[g] * scale,
            collides=bool(touching[g]),
        )
        for number, g in enumerate(geoms)
    )


def _mass_of(
    model: mujoco.MjModel, data: mujoco.MjData, root: int
) -> tuple[float, Floats, Floats, Floats]:
    """Mass, principal moments (3,), centre of mass (3,) and principal axes (3, 3) in its frame,
    including all bodies welded to it.
    """
    to_root = data.xmat[root].reshape(3, 3).T
    parts = np.flatnonzero(model.body_weldid == root)
    mass = model.body_mass[parts]
    centers = (data.xipos[parts] - data.xpos[root]) @ to_root.T
    total = float(mass.sum())
    com = mass @ centers / total
    tensor = np.zeros((3, 3))
    for part, m, arm in zip(parts, mass, centers - com, strict=True):
        turn = to_root @ data.ximat[part].reshape(3, 3)
        tensor += turn @ np.diag(model.body_inertia[part]) @ turn.T
        tensor += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = np.linalg.eigh(tensor)
    return total, moments[::-1].copy(), com, axes[:, ::-1].copy()
