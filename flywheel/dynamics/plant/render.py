"""Videos of a robot, drawn from stored states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import mujoco
import numpy as np

from flywheel.dynamics.plant.drawing import (
    NOTHING,
    Scenery,
    center_of_mass,
    draw_ghosts,
    draw_goal,
    draw_plan,
    draw_trail,
)
from flywheel.dynamics.plant.world import scene
from flywheel.errors import DataError
from flywheel.records import Floats, Plans, State
from flywheel.robots import Robot

TRAIL_SECONDS = 0.25  # between the marks of the trail
MP4_INDEX = b"moov"  # last part of an mp4; without it the file cannot be played
SMOOTH_SECONDS = 0.8  # the camera follows this much behind


@dataclass(frozen=True)
class Shot:
    """Format of a video.

    Attributes:
      size: (width, height) [pixels]; multiples of 16.
      azimuth: direction the camera looks in, counted from x [degrees].
      elevation: of the camera [degrees].
      distance: of the camera, in extents of the robot.
    """

    size: tuple[int, int] = (960, 544)
    azimuth: float = 130.0
    elevation: float = -22.0
    distance: float = 2.6


PLAIN = Shot()
ABOVE = Shot(
    elevation=-78.0, distance=3.6
)  # walls twice the robot's height hide nothing from there


def usual_shot(scenery: Scenery) -> Shot:
    """Default format of a video."""
    return ABOVE if scenery.terrain and scenery.terrain.boxes else PLAIN


@dataclass(frozen=True)
class Film:
    """A film of an episode, in real time.

    Attributes:
      robot: the robot.
      states: (T,) states.
      scenery: around it.
      fps: frames per second.
      ghosts: (T, P, 3) predicted points to draw over it, or None; NaN is not drawn [m].
      dt: time between the states [s].
      shot: size and camera; None for the default: among obstacles from above, which would otherwise
        hide the robot.
      plans: predictions of a planner, to draw on the ground, or None.

    Raises:
      DataError: states, goal or ghosts do not fit.
    """

    robot: Robot
    states: State
    scenery: Scenery = NOTHING
    fps: int = 25
    ghosts: Floats | None = None
    dt: float = 0.01
    shot: Shot | None = None
    plans: Plans | None = None

    def __post_init__(self) -> None:
        shape, wanted = self.states.qpos.shape, len(self.robot.keyframe.qpos)
        if len(shape) != 2 or shape[1] != wanted:
            raise DataError(
                f"A video of {self.robot.name} needs states (T, {wanted}), got {shape}."
            )
        goal = self.scenery.goal
        if goal is not None and np.shape(goal) != (2,):
            raise DataError(f"A goal is (x, y), got shape {np.shape(goal)}.")
        drawn = (shape[0], len(self.robot.points), 3)
        if self.ghosts is not None and self.ghosts.shape != drawn:
            raise DataError(f"Predicted points to draw must be {drawn}, got {self.ghosts.shape}.")

    @property
    def times(self) -> Floats:
        """(F,) times of its frames [s]."""
        return np.arange(0, len(self.states.qpos) * self.dt, 1 / self.fps)

    def write(
        self, path: str | Path, progress: Callable[[float], None] = lambda done: None
    ) -> Path:
        """Write it as an mp4, see `write_video`.

        Args:
          path: of the video.
          progress: receives the share of the frames that are done, after each.
        """
        shot, count = self.shot or usual_shot(self.scenery), len(self.times)

        def shown() -> Iterator[np.ndarray]:
            for number, frame in enumerate(self.frames(), 1):
                yield frame
                progress(number / count)

        return write_video(shown(), path, shot.size, self.fps)

    def frames(self) -> Iterator[np.ndarray]:
        """Its frames (height, width, 3) uint8."""
        robot, states, scenery, dt, fps = self.robot, self.states, self.scenery, self.dt, self.fps
        shot = self.shot or usual_shot(scenery)
        model = scene(robot, scenery.terrain).compile()
        model.vis.global_.offwidth = max(model.vis.global_.offwidth, shot.size[0])
        model.vis.global_.offheight = max(model.vis.global_.offheight, shot.size[1])
        data = mujoco.MjData(model)
        times = self.times
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
                draw_trail(renderer.scene, scenery, centers[: number + 1 : every])
                draw_goal(renderer.scene, scenery, robot)
                if self.plans is not None and (paths := self.plans.at(times[number])) is not None:
                    draw_plan(renderer.scene, scenery, robot, paths)
                if self.ghosts is not None:
                    draw_ghosts(renderer.scene, robot, self.ghosts[step])
                yield renderer.render()
        finally:
            renderer.close()


def write_video(
    frames: Iterable[np.ndarray], path: str | Path, size: tuple[int, int], fps: int
) -> Path:
    """Write frames as an mp4.

    Args:
      frames: (height, width, 3) uint8 each.
      path: of the video; folders are made.
      size: (width, height) [pixels]; multiples of 16.
      fps: frames per second.

    Raises:
      DataError: it cannot be written.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = imageio_ffmpeg.write_frames(
        str(path), size, fps=fps, quality=8, ffmpeg_log_level="quiet"
    )
    writer.send(None)
    with suppress(OSError), closing(writer):  # its message is ffmpeg's command line
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    if not path.exists() or MP4_INDEX not in path.read_bytes():  # ffmpeg says nothing about it
        path.unlink(missing_ok=True)
        raise DataError(f"The video {path} could not be written. Is the disk full?")
    return path


def _pose(model: mujoco.MjModel, data: mujoco.MjData, states: State, step: int) -> Floats:
    """Pose the robot; its centre of mass (3,) [m]."""
    data.qpos[:], data.act[:] = states.qpos[step], states.act[step]
    mujoco.mj_forward(model, data)
    return center_of_mass(model, data)


def _smooth(centers: Floats, dt: float) -> Floats:
    """(frames, 3) target of the camera: the centre at its mean height, low-passed both ways."""
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
