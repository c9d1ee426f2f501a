"""Episodes to a goal, seen from above."""

from __future__ import annotations

import numpy as np

from flywheel.records import Episode, Floats
from flywheel.results import Walk
from flywheel.tasks import Task

WALK_SECONDS = 0.5  # between two points of a path [s]


def walk_of(task: Task, episode: Episode, points: Floats, seed: int) -> Walk:
    """The path of an episode, and its outcome.

    Args:
      task: of the episode.
      episode: with an outcome.
      points: (n, P, 3) tracked points over its time, without gaps [m].
      seed: of the episode.
    """
    outcome = episode.outcome
    assert outcome is not None, "an episode with a task has an outcome"
    centre = task.place(points[:: max(1, round(WALK_SECONDS / episode.trajectory.dt))])
    return Walk(
        path=tuple((float(x), float(y)) for x, y in np.round(centre, 4)),
        goal=(float(task.last_goal[0]), float(task.last_goal[1])),
        reached=outcome.success,
        seconds=outcome.seconds,
        distance=outcome.distance,
        seed=seed,
        obstacles=task.obstacles,
    )
