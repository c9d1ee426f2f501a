"""A window that shows an episode during its recording, in MuJoCo's viewer."""

from __future__ import annotations

import queue
import threading
import time
import warnings
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from flywheel.dynamics.plant.drawing import (
    Scenery,
    center_of_mass,
    draw_goal,
    draw_plan,
    draw_trail,
)
from flywheel.dynamics.plant.render import TRAIL_SECONDS, usual_shot
from flywheel.dynamics.plant.world import scene
from flywheel.errors import ConfigError
from flywheel.records import Floats, State
from flywheel.robots import Robot

FPS = 30
CLOSE_SECONDS = 5.0  # that the window may take to close: some displays never answer


@dataclass(frozen=True)
class _Frame:
    """A state to show, and the plan in use at that time."""

    qpos: Floats
    act: Floats
    paths: Floats | None


class LiveView:
    """Shows pieces of an episode in the robot's own time, while the next ones are computed.

    A separate thread plays them, so that planning does not wait for the picture: it shows recorded
    pieces, at most in real time. Closing the window ends the show, not the episode.

    Args:
      robot: the robot.
      scenery: around it.

    Raises:
      ConfigError: there is no display.
    """

    def __init__(self, robot: Robot, scenery: Scenery) -> None:
        _check_display()
        self._robot, self._scenery = robot, scenery
        self._model = scene(robot, scenery.terrain).compile()
        self._data = mujoco.MjData(self._model)
        self._frames: queue.SimpleQueue[_Frame | None] = queue.SimpleQueue()
        others = set(threading.enumerate())
        self._window = _open_window(self._model, self._data)
        self._drawers = set(threading.enumerate()) - others
        shot = usual_shot(scenery)
        self._window.cam.distance = shot.distance * self._model.stat.extent
        self._window.cam.elevation, self._window.cam.azimuth = shot.elevation, shot.azimuth
        self._player = threading.Thread(target=self._play, name="live view", daemon=True)
        self._player.start()

    def show(self, states: State, dt: float, paths: Floats | None = None) -> None:
        """Play a piece as soon as those before have been played.

        Args:
          states: (T,) of the piece.
          dt: time between them [s].
          paths: (K, M, 2) predicted paths, best first, or None [m].
        """
        every = max(1, round(1.0 / FPS / dt))
        for qpos, act in zip(states.qpos[::every], states.act[::every], strict=True):
            self._frames.put(_Frame(qpos, act, paths))

    def close(self) -> None:
        """Play the rest, and close the window."""
        self._frames.put(None)
        self._player.join()
        self._window.close()
        for drawer in self._drawers:  # a thread that ends while it draws would end the process
            drawer.join(CLOSE_SECONDS)

    def _play(self) -> None:
        way: list[Floats] = []
        due = time.monotonic()
        for number, frame in enumerate(iter(self._frames.get, None)):
            if not self._window.is_running():
                continue  # closed by hand; the rest is only taken off the queue
            with self._window.lock():
                self._data.qpos[:], self._data.act[:] = frame.qpos, frame.act
                mujoco.mj_forward(self._model, self._data)
                center = center_of_mass(self._model, self._data)
                if number % round(TRAIL_SECONDS * FPS) == 0:
                    way.append(center)
                self._window.cam.lookat[:] = center
                self._draw(np.array(way), frame.paths)
            self._window.sync()
            due = max(due + 1.0 / FPS, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))

    def _draw(self, way: Floats, paths: Floats | None) -> None:
        picture = self._window.user_scn
        picture.ngeom = 0
        draw_trail(picture, self._scenery, way)
        draw_goal(picture, self._scenery, self._robot)
        if paths is not None:
            draw_plan(picture, self._scenery, self._robot, paths)


def _check_display() -> None:
    """MuJoCo's viewer ends the whole process without a display."""
    import glfw  # where there is no display, it may not even be importable

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not glfw.init():
            raise ConfigError(
                "There is no display to show an episode on (DISPLAY and WAYLAND_DISPLAY decide). Without "
                "--watch it is filmed instead."
            )


def _open_window(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    from mujoco import viewer  # imports glfw; see `_check_display`

    return viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
