"""Pasts of several episodes in one batch."""

import numpy as np

from flywheel.evaluation.pasts import stacked
from flywheel.records import Observation, Past
from flywheel.terrain import Terrain


def past(terrain: Terrain | None) -> Past:
    points, winch = np.zeros((1, 3, 6, 3)), np.zeros((1, 3, 6))
    return Past(Observation(points, winch), np.zeros((1, 2, 6)), winch, terrains=(terrain,))


def test_pasts_on_one_ground_share_it():
    hill = Terrain(np.ones((3, 3)), 1.0, (0.0, 0.0))
    assert stacked([past(None), past(None)]).terrains == (None,)
    assert stacked([past(hill), past(hill)]).terrains == (hill,)
    assert stacked([past(hill), past(None), past(hill)]).terrains == (hill, None, hill)
