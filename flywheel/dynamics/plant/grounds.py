"""Simulations that stand each on a ground of its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.records import Floats, Observation, State
from flywheel.terrain import Terrain


def observed_on(
    terrains: Sequence[Terrain | None], plant: Plant, state: State, controls: Floats
) -> Observation:
    """What is seen of a plant on the terrain of each simulation, or on one for all.

    Args:
      terrains: of B simulations, or one; None is the plane z = 0.
      plant: elsewhere the same.
      state, controls: as `Plant.simulate` takes them.
    """
    if len(set(terrains)) == 1:
        return plant.on(terrains[0]).simulate(state, controls).observations
    points = np.empty((*controls.shape[:1], controls.shape[1] + 1, len(plant.robot.points), 3))
    winch = np.empty((*points.shape[:2], len(plant.robot.winches)))
    for terrain in dict.fromkeys(terrains):
        rows = np.flatnonzero([each == terrain for each in terrains])
        begun = state if len(state.qpos) == 1 else state[rows]
        seen = plant.on(terrain).simulate(begun, controls[rows]).observations
        points[rows], winch[rows] = seen.points, seen.winch
    return Observation(points, winch)
