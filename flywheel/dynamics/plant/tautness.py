"""Fraction of the time in which cables are taut."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.records import Floats, State

EVERY = 10  # only one in so many states is looked at


def taut_share(plant: Plant, states: State) -> Floats:
    """(n,) fraction of cables and time in which a cable is longer than its rest length.

    Args:
      plant: of the states.
      states: (n, T + 1).
    """
    states = states[:, ::EVERY]
    return np.asarray(taut(plant, states, plant.winch(states)).mean(axis=(1, 2)))


def taut(plant: Plant, states: State, winch: Floats) -> np.ndarray:
    """(..., C) bool: which cables are longer than their rest length.

    Args:
      plant: of the states.
      states: (...); their activations do not count.
      winch: (..., W) positions [m].
    """
    data, lead = mujoco.MjData(plant.model), states.qpos.shape[:-1]
    lengths = np.empty((*lead, len(plant.robot.cables)))
    for index in np.ndindex(lead):
        data.qpos[:] = states.qpos[index]
        mujoco.mj_kinematics(plant.model, data)
        mujoco.mj_comPos(plant.model, data)
        mujoco.mj_tendon(plant.model, data)
        lengths[index] = data.ten_length
    return np.asarray(lengths > rest_lengths(plant.robot, winch))
