"""The past at a step of a recorded episode: input of a dynamics model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.records import Episode, Floats, Observation, Past, State
from flywheel.robots import Robot


def past_at(
    episode: Episode, robot: Robot, start: int, history: int, winch: Floats, dataset: int = 0
) -> Past:
    """The past at step `start` of an episode: a batch of one, `history` steps long.

    Args:
      episode: recorded.
      robot: of the episode.
      start: index of the present observation.
      history: number of past steps; a start earlier than that is padded by a robot at rest.
      winch: (T + 1, W) of the episode, see `Robot.winches_of` [m].
      dataset: index of the data set.
    """
    trajectory = episode.trajectory
    first = max(0, start - history)
    seen, between = slice(first, start + 1), slice(first, start)
    states = trajectory.states
    past = Past(
        observations=trajectory.observations[seen][None],
        controls=trajectory.controls[between][None],
        winch=winch[seen][None],
        dataset=dataset,
        state=None if states is None else states[start : start + 1],
        terrains=(episode.terrain,),
    )
    return past.latest(history, robot.holding(winch[first])[None])


def stacked(pasts: Sequence[Past]) -> Past:
    """One batch of pasts of equal history and data set."""
    states = [past.state for past in pasts if past.state is not None]
    terrains = tuple(terrain for past in pasts for terrain in past.terrains)
    return Past(
        observations=Observation(
            np.concatenate([past.observations.points for past in pasts]),
            np.concatenate([past.observations.winch for past in pasts]),
        ),
        controls=np.concatenate([past.controls for past in pasts]),
        winch=np.concatenate([past.winch for past in pasts]),
        dataset=pasts[0].dataset,
        state=State.joined(states) if len(states) == len(pasts) else None,
        terrains=terrains if len(set(terrains)) > 1 else terrains[:1],
    )
