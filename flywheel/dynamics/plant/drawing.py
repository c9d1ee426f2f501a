"""Overlays in a picture of a robot: its goal, its path, predictions, and plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.terrain import Terrain

GHOST = np.array([0.98, 0.55, 0.10, 0.55])
GOAL = np.array([0.10, 0.65, 0.35, 0.85])
TRAIL = np.array([0.15, 0.35, 0.75, 0.55])
PLAN, OTHERS = np.array([0.85, 0.10, 0.45, 0.9]), np.array([0.35, 0.35, 0.42, 0.4])


@dataclass(frozen=True)
class Scenery:
    """Surroundings of a robot in a picture.

    Attributes:
      goal: (2,) or None [m].
      goal_radius: of the goal's disc [m]; None: half the robot's length.
      terrain: ground and boxes around the robot; None for the MJCF's ground alone.
    """

    goal: Floats | None = None
    goal_radius: float | None = None
    terrain: Terrain | None = None

    def on_ground(self, places: Floats) -> Floats:
        """(..., 3) positions on the ground at (..., 2) [m]."""
        heights = np.zeros(places.shape[:-1])
        if self.terrain is not None:
            heights = self.terrain.at(places)[0]
        return np.concatenate([places, heights[..., None]], axis=-1)


NOTHING = Scenery()


def center_of_mass(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """(3,) centre of mass of all movable bodies [m]."""
    moving = model.body_weldid != 0
    return np.average(data.xipos[moving], axis=0, weights=model.body_mass[moving])


def add(
    scene: mujoco.MjvScene,
    kind: mujoco.mjtGeom,
    size: Sequence[float],
    at: Floats | Sequence[float],
    color: Floats,
) -> mujoco.MjvGeom | None:
    """One more shape in the picture, upright, sized as in MJCF; None if the picture is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    place = np.asarray(at, float)
    color = color.astype(np.float32)
    mujoco.mjv_initGeom(geom, kind, np.asarray(size, float), place, np.eye(3).ravel(), color)
    scene.ngeom += 1
    return geom


def draw_goal(scene: mujoco.MjvScene, scenery: Scenery, robot: Robot) -> None:
    """A disc on the ground and a pole with a ball at the goal."""
    if scenery.goal is None:
        return
    x, y, z = scenery.on_ground(scenery.goal)
    radius = scenery.goal_radius or robot.length / 2
    height = 0.9 * robot.length
    cylinder, sphere = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_SPHERE
    disc = GOAL * [1, 1, 1, 0.4]
    add(scene, cylinder, [radius, 0.01, 0], [x, y, z + 0.011], disc)
    add(scene, cylinder, [0.008 * robot.length, height / 2, 0], [x, y, z + height / 2], GOAL)
    add(scene, sphere, [0.04 * robot.length, 0, 0], [x, y, z + height], GOAL)


def draw_ghosts(scene: mujoco.MjvScene, robot: Robot, points: Floats) -> None:
    """A ball at each predicted point, and a line between those of one body."""
    least = 0.03 * robot.length
    for tracked, at in zip(robot.points, points, strict=True):
        if np.isfinite(at).all():
            radius = 1.05 * max(tracked.radius, least)
            add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0], at, GHOST)
    for body in robot.bodies:
        for i, j in pairwise(body.points):
            draw_line(scene, points[i], points[j], least / 3, GHOST)


def draw_trail(scene: mujoco.MjvScene, scenery: Scenery, centers: Floats) -> None:
    """The path so far, on the ground."""
    for a, b in pairwise(scenery.on_ground(centers[:, :2]) + [0.0, 0.0, 0.012]):
        draw_line(scene, a, b, 0.012, TRAIL)


def draw_plan(scene: mujoco.MjvScene, scenery: Scenery, robot: Robot, paths: Floats) -> None:
    """Predicted paths (K, M, 2), the first one in the strongest colour."""
    for way, color, share, lift in (
        *((path, OTHERS, 0.009, 0.013) for path in paths[1:]),
        (paths[0], PLAN, 0.015, 0.016),
    ):
        for a, b in pairwise(scenery.on_ground(way) + [0.0, 0.0, lift]):
            draw_line(scene, a, b, share * robot.length, color)


def draw_line(scene: mujoco.MjvScene, a: Floats, b: Floats, radius: float, color: Floats) -> None:
    """A capsule from (3,) to (3,); none if one of them is unknown [m]."""
    if not np.isfinite([a, b]).all():
        return
    geom = add(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, [1, 1, 1], a, color)
    if geom is not None:
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, a, b)
