"""The centre of mass of a robot, as far as its tracked points give it."""

from __future__ import annotations

import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot


def center_weights(robot: Robot) -> Floats:
    """(P,) weights with sum 1 whose combination of the tracked points is the centre of mass.

    Exact where each body's centre of mass lies in the span of its points (a rod with a cap at each
    end); else the nearest such combination. Bodies without points do not count.
    """
    weights = np.zeros(len(robot.points))
    for body in robot.bodies:
        if not body.points:
            continue
        offsets = np.stack([robot.points[p].offset for p in body.points])
        middle = offsets.mean(axis=0)
        extra = np.linalg.pinv((offsets - middle).T, rcond=1e-9) @ (body.com - middle)
        weights[list(body.points)] += body.mass * (1.0 / len(offsets) + extra - extra.mean())
    return weights / weights.sum()
