"""Videos of a robot, drawn from stored states."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import imageio_ffmpeg
import mujoco
import numpy as np

from flywheel.dynamics.plant.world import scene
from flywheel.errors import DataError
from flywheel.records import Floats, Plans, State
from flywheel.robots import Box, Robot
from flywheel.terrain import Terrain

GHOST = np.array([0.98, 0.55, 0.10, 0.55])
GOAL = np.array([0.10, 0.65, 0.35, 0.85])
TRAIL = np.array([0.15, 0.35, 0.75, 0.55])
PLAN, OTHERS = np.array([0.85, 0.10, 0.45, 0.9]), np.array([0.45, 0.45, 0.5, 0.3])
TRAIL_SECONDS = 0.25  # between the marks of the way gone
SMOOTH_SECONDS = 0.8  # the camera follows this much behind


@dataclass(frozen=True)
class Shot:
    """How a video looks.

    Attributes:
      size: (width, height) [pixels]; multiples of 16.
      azimuth: direction the camera looks in, counted from x [degrees].
      elevation: of the camera [degrees].
      distance: of the camera, in extents of the robot.
      goal_radius: of the goal's disc [m]; None: half the robot's length.
    """

    size: tuple[int, int] = (960, 544)
    azimuth: float = 130.0
    elevation: float = -22.0
    distance: float = 2.6
    goal_radius: float | None = None


PLAIN = Shot()
ABOVE = Shot(
    elevation=-78.0, distance=3.6
)  # walls twice the robot's height hide nothing from there


def usual_shot(obstacles: Sequence[Box]) -> Shot:
    """How a video looks where nobody says."""
    return ABOVE if obstacles else PLAIN


def render_episode(
    robot: Robot,
    states: State,
    path: str | Path,
    obstacles: Sequence[Box] = (),
    goal: Floats | None = None,
    fps: int = 25,
    ghosts: Floats | None = None,
    *,
    dt: float = 0.01,
    shot: Shot | None = None,
    terrain: Terrain | None = None,
    plans: Plans | None = None,
) -> Path:
    """Write an mp4 of an episode, in real time.

    Args:
      robot: the robot.
      states: (T,) states.
      path: of the video; folders are made.
      obstacles: boxes around it.
      goal: (2,) where it is to go, or None [m].
      fps: frames per second.
      ghosts: (T, P, 3) predicted points to draw over it, or None; NaN is not drawn [m].
      dt: time between the states [s].
      shot: size and camera; None for a usual one: among obstacles from above, or they would hide the robot.
      terrain: that it stands on; None for the MJCF's ground.
      plans: what a planner foresaw, to draw on the ground, or None.

    Returns:
      The path.

    Raises:
      DataError: states, goal or ghosts do not fit.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    shot = shot or usual_shot(obstacles)
    frames = render_frames(
        robot, states, obstacles, goal, fps, ghosts, dt=dt, shot=shot, terrain=terrain, plans=plans
    )
    writer = imageio_ffmpeg.write_frames(str(path), shot.size, fps=fps, quality=8)
    writer.send(None)
    try:
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()
    return path


def render_frames(
    robot: Robot,
    states: State,
    obstacles: Sequence[Box] = (),
    goal: Floats | None = None,
    fps: int = 25,
    ghosts: Floats | None = None,
    *,
    dt: float = 0.01,
    shot: Shot | None = None,
    terrain: Terrain | None = None,
    plans: Plans | None = None,
) -> Iterator[np.ndarray]:
    """The frames (height, width, 3) uint8 that `render_episode` writes; arguments as there."""
    _check(robot, states, goal, ghosts)
    shot = shot or usual_shot(obstacles)
    model = scene(robot, obstacles, terrain).compile()
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, shot.size[0])
    model.vis.global_.offheight = max(model.vis.global_.offheight, shot.size[1])
    data = mujoco.MjData(model)
    times = np.arange(0, len(states.qpos) * dt, 1 / fps)
    steps = np.minimum(np.round(times / dt).astype(int), len(states.qpos) - 1)
    centers = np.array([_pose(model, data, states, step) for step in steps])
    views = _smooth(centers, 1 / fps)
    every = max(1, round(TRAIL_SECONDS * fps))
    renderer = mujoco.Renderer(model, height=shot.size[1], width=shot.size[0])
    try:
        for number, step in enumerate(steps):
            _pose(model, data, states, int(step))
            data.light_xpos[:, :2] += views[number, :2]  # the lights move with the robot
            camera = _camera(model, views[number], shot)
            renderer.update_scene(data, camera)
            _draw_trail(renderer.scene, centers[: number + 1 : every], terrain)
            if plans is not None and (paths := plans.at(times[number])) is not None:
                _draw_plan(renderer.scene, robot, paths, terrain)
            if goal is not None:
                at = _on_ground(goal, terrain)
                _draw_goal(renderer.scene, robot, at, shot.goal_radius or robot.length / 2)
            if ghosts is not None:
                _draw_ghosts(renderer.scene, robot, ghosts[step])
            yield renderer.render()
    finally:
        renderer.close()


def _check(robot: Robot, states: State, goal: Floats | None, ghosts: Floats | None) -> None:
    if states.qpos.ndim != 2 or states.qpos.shape[1] != len(robot.keyframe.qpos):
        raise DataError(
            f"A video of {robot.name} needs states (T, {len(robot.keyframe.qpos)}), got "
            f"{states.qpos.shape}."
        )
    if goal is not None and np.shape(goal) != (2,):
        raise DataError(f"A goal is (x, y), got shape {np.shape(goal)}.")
    wanted = (len(states.qpos), len(robot.points), 3)
    if ghosts is not None and ghosts.shape != wanted:
        raise DataError(f"Predicted points to draw must be {wanted}, got {ghosts.shape}.")


def _pose(model: mujoco.MjModel, data: mujoco.MjData, states: State, step: int) -> Floats:
    """Pose the robot; its centre of mass (3,) [m]."""
    data.qpos[:], data.act[:] = states.qpos[step], states.act[step]
    mujoco.mj_forward(model, data)
    moving = model.body_weldid != 0
    return np.average(data.xipos[moving], axis=0, weights=model.body_mass[moving])


def _smooth(centers: Floats, dt: float) -> Floats:
    """(frames, 3) what the camera looks at: the centre at its mean height, low-passed both ways."""
    share = min(1.0, dt / SMOOTH_SECONDS)
    views = centers.copy()
    views[:, 2] = centers[:, 2].mean()
    for order in (range(1, len(views)), range(len(views) - 2, -1, -1)):
        for i in order:
            before = i - 1 if order.step > 0 else i + 1
            views[i] = views[before] + share * (views[i] - views[before])
    return views


def _camera(model: mujoco.MjModel, view: Floats, shot: Shot) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.lookat[:] = view
    camera.distance = shot.distance * model.stat.extent
    camera.elevation = shot.elevation
    camera.azimuth = shot.azimuth
    return camera


def _add(
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


def _draw_goal(scene: mujoco.MjvScene, robot: Robot, goal: Floats, radius: float) -> None:
    """A disc on the ground at (3,) and a pole with a ball."""
    x, y, z = goal
    height = 0.9 * robot.length
    cylinder, sphere = mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_SPHERE
    disc = GOAL * [1, 1, 1, 0.4]
    _add(scene, cylinder, [radius, 0.01, 0], [x, y, z + 0.011], disc)
    _add(scene, cylinder, [0.008 * robot.length, height / 2, 0], [x, y, z + height / 2], GOAL)
    _add(scene, sphere, [0.04 * robot.length, 0, 0], [x, y, z + height], GOAL)


def _draw_ghosts(scene: mujoco.MjvScene, robot: Robot, points: Floats) -> None:
    """A ball at each predicted point, and a line between those of one body."""
    least = 0.03 * robot.length
    for tracked, at in zip(robot.points, points, strict=True):
        if np.isfinite(at).all():
            radius = 1.05 * max(tracked.radius, least)
            _add(scene, mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0, 0], at, GHOST)
    for body in robot.bodies:
        for i, j in pairwise(body.points):
            _draw_line(scene, points[i], points[j], least / 3, GHOST)


def _on_ground(places: Floats, terrain: Terrain | None) -> Floats:
    """(..., 3) of places (..., 2) [m]."""
    heights = np.zeros(places.shape[:-1]) if terrain is None else terrain.at(places)[0]
    return np.concatenate([places, heights[..., None]], axis=-1)


def _draw_trail(scene: mujoco.MjvScene, centers: Floats, terrain: Terrain | None) -> None:
    """The way gone, on the ground."""
    for a, b in pairwise(_on_ground(centers[:, :2], terrain) + [0.0, 0.0, 0.012]):
        _draw_line(scene, a, b, 0.012, TRAIL)


def _draw_plan(
    scene: mujoco.MjvScene, robot: Robot, paths: Floats, terrain: Terrain | None
) -> None:
    """Ways (K, M, 2) that were foreseen, the first one in the strongest colour."""
    for way, color, share, lift in (
        *((path, OTHERS, 0.005, 0.013) for path in paths[1:]),
        (paths[0], PLAN, 0.012, 0.016),
    ):
        for a, b in pairwise(_on_ground(way, terrain) + [0.0, 0.0, lift]):
            _draw_line(scene, a, b, share * robot.length, color)


def _draw_line(scene: mujoco.MjvScene, a: Floats, b: Floats, radius: float, color: Floats) -> None:
    if not np.isfinite([a, b]).all():
        return
    geom = _add(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, [1, 1, 1], a, color)
    if geom is not None:
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, radius, a, b)
