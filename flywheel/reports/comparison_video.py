"""A window that models predict, as a video: the prediction, and the measurements as ghosts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flywheel.diagnosis.comparison import Comparison, Judgement
from flywheel.dynamics.plant import (
    Plant,
    RestartedPlant,
    Shot,
    render_episode,
    render_frames,
    write_video,
)
from flywheel.records import Floats, Observation, Past, State

SLOWER = 4  # than it was
FPS = 15
SHOT = Shot(size=(640, 368))
CLOSE = Shot(size=(640, 368), distance=1.5)
MAGNIFIED = (1, 2, 5, 10, 20)  # times that a difference may be drawn as large as it is
FARTHEST = 0.25  # that a point may then seem to be off, as a share of the robot's length


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
    states, ghosts = _drawn(found, model, window)
    dt = SLOWER * found.windows.dt
    return render_episode(
        found.windows.robot, states, path, fps=FPS, ghosts=ghosts, dt=dt, shot=SHOT
    )


def film_side_by_side(found: Comparison, window: int, path: Path) -> Path:
    """Film one window of all models in one video, the first on the left, with differences magnified.

    What was measured is smoothed for it, so that noise does not hide what is seen.

    Args:
      found: the comparison.
      window: which.
      path: of the mp4.

    Raises:
      Exception: whatever a graphics driver throws where nothing can be drawn.
    """
    times = magnification(found, window)
    films = [_frames(found, model, window, times) for model in found.models]
    rows = (np.concatenate(parts, axis=1) for parts in zip(*films, strict=True))
    width, height = CLOSE.size
    return write_video(rows, path, (len(films) * width, height), FPS)


def magnification(found: Comparison, window: int) -> int:
    """How many times as large as it is the difference is drawn that the first model leaves in a window."""
    model, robot = found.models[0], found.windows.robot
    off = np.linalg.norm(_smooth(found, window) - model.points[window], axis=-1)
    room = FARTHEST * robot.length / max(float(np.nanmax(off)), 1e-9)
    return max((each for each in MAGNIFIED if each <= room), default=1)


def _frames(found: Comparison, model: Judgement, window: int, times: int) -> list[np.ndarray]:
    states, _ = _drawn(found, model, window)
    predicted = model.points[window]
    ghosts = predicted + times * (_smooth(found, window) - predicted)
    robot, dt = found.windows.robot, SLOWER * found.windows.dt
    return list(render_frames(robot, states, fps=FPS, ghosts=ghosts, dt=dt, shot=CLOSE))


def _smooth(found: Comparison, window: int) -> Floats:
    """(steps + 1, P, 3) measured points of a window, without noise [m]."""
    windows = found.windows
    first = int(windows.first[window])
    points, _ = windows.smooth[windows.recording[window]]
    return points[first : first + windows.steps + 1]


def _drawn(found: Comparison, model: Judgement, window: int) -> tuple[State, Floats]:
    """Predicted states of a window, and the points (steps + 1, P, 3) that were measured [m]."""
    windows = found.windows
    points, winch = model.points[window][:, None], model.winch[window][:, None]
    past = Past(Observation(points, winch), np.zeros((len(points), 0, winch.shape[-1])), winch)
    states = RestartedPlant(Plant(windows.robot, windows.dt), roll="relaxed").estimate(past)
    first = int(windows.first[window])
    seen = windows.recordings[windows.recording[window]].trajectory.observations.points
    return states, seen[first : first + windows.steps + 1]
