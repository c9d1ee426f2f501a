"""The window that a model predicts worst, as a video: the prediction, and the measurements as ghosts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flywheel.diagnosis.comparison import Comparison, Judgement
from flywheel.dynamics.plant import Plant, RestartedPlant, Shot, render_episode
from flywheel.records import Floats, Observation, Past, State
from flywheel.robots import Robot

SLOWER = 4  # than it was
FPS = 15
SHOT = Shot(size=(640, 368))


def film_window(found: Comparison, model: Judgement, window: int, path: Path) -> Path:
    """Film one window of one model, in slow motion.

    Args:
      found: the comparison.
      model: whose prediction is drawn.
      window: which.
      path: of the mp4.

    Raises:
      Exception: whatever a graphics driver throws where nothing can be drawn.
    """
    windows = found.windows
    states = states_of(windows.robot, windows.dt, model.points[window], model.winch[window])
    first = int(windows.first[window])
    seen = windows.recordings[windows.recording[window]].trajectory.observations.points
    ghosts = seen[first : first + windows.steps + 1]
    return render_episode(
        windows.robot, states, path, fps=FPS, ghosts=ghosts, dt=SLOWER * windows.dt, shot=SHOT
    )


def states_of(robot: Robot, dt: float, points: Floats, winch: Floats) -> State:
    """States (T,) that show a robot where its points are.

    Args:
      robot: to be drawn.
      dt: control step [s].
      points: (T, P, 3) of its tracked points [m].
      winch: (T, W) positions of its winches [m].
    """
    past = Past(
        Observation(points[:, None], winch[:, None]),
        np.zeros((len(points), 0, winch.shape[-1])),
        winch[:, None],
    )
    return RestartedPlant(Plant(robot, dt), roll="relaxed").estimate(past)
