"""The worst window of a model as a video: the prediction, with the measurements as ghosts."""

from __future__ import annotations

from pathlib import Path

from flywheel.diagnosis.comparison import Comparison, Judgement
from flywheel.dynamics.plant import Film, Shot, states_of

SLOWER = 4  # than it was
FPS = 15
SHOT = Shot(size=(640, 368))


def film_window(found: Comparison, model: Judgement, window: int, path: Path) -> Path:
    """Film one window of one model, in slow motion.

    Args:
      found: the comparison.
      model: whose prediction is drawn.
      window: its index.
      path: of the mp4.

    Raises:
      Exception: any error of a graphics driver without rendering.
    """
    windows = found.windows
    states = states_of(windows.robot, windows.dt, model.points[window], model.winch[window])
    first = int(windows.first[window])
    seen = windows.recordings[windows.recording[window]].trajectory.observations.points
    ghosts = seen[first : first + windows.steps + 1]
    dt = SLOWER * windows.dt
    return Film(windows.robot, states, fps=FPS, ghosts=ghosts, dt=dt, shot=SHOT).write(path)
