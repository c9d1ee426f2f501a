"""One window of an episode, measured and predicted, small enough for a page."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flywheel.dynamics.protocol import Dynamics
from flywheel.evaluation import past_at
from flywheel.records import Episode, KnownWinch
from flywheel.runtime.measures import Overlay

SECONDS_APART = 0.1


def overlay(
    dynamics: Dynamics,
    episode: Episode,
    seconds: float,
    datasets: Mapping[str, int],
    winches: KnownWinch | None = None,
) -> Overlay | None:
    """Predict the window in the middle of an episode; None where the episode is too short.

    Args:
      dynamics: the model.
      episode: measured.
      seconds: to predict [s].
      datasets: index of each data set in the network's one-hot.
      winches: where they were, as far as is known; None for `Robot.winches_of`.
    """
    trajectory, robot = episode.trajectory, dynamics.robot
    steps = round(seconds / trajectory.dt)
    start = (trajectory.steps - steps) // 2
    if start < 0:
        return None
    measured = trajectory.observations.points[start : start + steps + 1]
    controls = trajectory.controls
    winch = (winches or robot.winches_of)(episode)
    dataset = datasets.get(episode.provenance.dataset, 0)
    past = past_at(episode, robot, start, dynamics.history, winch, dataset)
    predicted = dynamics.rollout(past, controls[None, start : start + steps]).points[0]
    stride = max(1, round(SECONDS_APART / trajectory.dt))
    return Overlay(
        seconds=tuple((np.arange(0, steps + 1, stride) * trajectory.dt).round(6).tolist()),
        measured=_places(measured[::stride]),
        predicted=_places(predicted[::stride]),
        rods=tuple(
            (body.points[0], body.points[-1]) for body in robot.bodies if len(body.points) > 1
        ),
        episode=episode.id,
    )


def _places(points: np.ndarray) -> tuple[tuple[tuple[float, float, float], ...], ...]:
    return tuple(tuple((x, y, z) for x, y, z in frame) for frame in points.round(4).tolist())
