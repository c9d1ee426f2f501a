"""How cables follow their winches, by the plant of the MJCF: what `align: auto` compares points with."""

from __future__ import annotations

import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.records import Floats
from flywheel.robots import Robot

SETTLING = 1.0  # [s] at the keyframe, to the first positions, and there


def cables_by_winches(robot: Robot, positions: Floats, dt: float) -> Floats:
    """Lengths (n, C) of the cables of a robot whose winches move through positions (n, W) [m].

    It begins at rest, with the winches at the first positions.

    Args:
      robot: of free bodies.
      positions: at regular times [m].
      dt: between them [s].

    Raises:
      ModelError: the simulation diverges.
    """
    step = robot.control_steps(dt)[0]
    time = np.arange(0, dt * (len(positions) - 1) + step / 2, step)
    even = np.stack(
        [np.interp(time, dt * np.arange(len(positions)), p) for p in positions.T], axis=1
    )
    plant, lead = Plant(robot, dt=step), round(SETTLING / step)
    start = plant.settle(SETTLING)
    here = plant.winch(start)[0]
    way = here + (even[0] - here) * np.linspace(0, 1, lead, endpoint=False)[:, None]
    whole = np.concatenate([way, np.repeat(even[:1], lead, axis=0), even])
    controls = robot.telling(whole[:-1], np.diff(whole, axis=0) / step, step)
    flown = plant.simulate(start, np.clip(controls, robot.control_low, robot.control_high)[None])
    assert flown.states is not None  # of a plant
    poses = flown.states.qpos[0].reshape(len(whole), len(robot.bodies), 7)
    lengths = robot.cable_lengths(poses)[2 * lead :]
    return np.stack(
        [np.interp(dt * np.arange(len(positions)), time, each) for each in lengths.T], axis=1
    )
