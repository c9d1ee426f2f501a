"""Simulations with a separate ground each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.records import Floats, Observation, State, Trajectory
from flywheel.terrain import Terrain


def simulated_on(
    terrains: Sequence[Terrain | None], plant: Plant, state: State, controls: Floats
) -> Trajectory:
    """The motion of a plant on the terrain of each simulation, or on one for all.

    Args:
      terrains: of B simulations, or one; None is the plane z = 0.
      plant: used with each of them.
      state, controls: as in `Plant.simulate`.
    """
    if len(set(terrains)) == 1:
        return plant.on(terrains[0]).simulate(state, controls)
    parts, order = [], []
    for terrain in dict.fromkeys(terrains):
        rows = np.flatnonzero([each == terrain for each in terrains])
        begun = state if len(state.qpos) == 1 else state[rows]
        parts.append(plant.on(terrain).simulate(begun, controls[rows]))
        order.append(rows)
    back = np.argsort(np.concatenate(order))

    def joined(arrays: Iterable[Floats]) -> Floats:
        return np.concatenate(list(arrays))[back]

    states = [part.states for part in parts if part.states is not None]
    return Trajectory(
        Observation(
            joined(part.observations.points for part in parts),
            joined(part.observations.winch for part in parts),
        ),
        joined(part.controls for part in parts),
        plant.dt,
        State.joined(states)[back],
    )
