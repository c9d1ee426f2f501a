"""The published gaits move prism3 as published: within 15 %."""

import numpy as np
import pytest

from flywheel.control.gaits import Gait
from flywheel.dynamics.plant import Plant
from flywheel.records import Past
from flywheel.robots import load_robot

# Two cycles of each: seconds, way of the centre [m] or mean turn of the rods [degrees].
# Measured on a plant with other steps and another integrator.
ROLL_SECONDS, ROLL = 9.0, (-3.42, 1.71)
CW_SECONDS, CW = 13.6, -61.0
CCW_SECONDS, CCW = 11.4, 33.0


def walk(pattern: str) -> tuple[float, np.ndarray, np.ndarray]:
    """Seconds, way of the centre (2,) [m] and turn of each rod (3,) [degrees] of two cycles."""
    plant = Plant(load_robot("prism3"))
    gait = Gait(plant.robot, pattern, cycles=2)
    state = plant.rest()
    points: list[np.ndarray] = []
    while not gait.finished:
        seen = plant.observe(state[:, None])
        past = Past(seen, np.zeros((1, 0, 6)), seen.winch)
        controls = gait.act(past).controls
        if gait._index > 1:  # the first rest is over
            points.append(seen.points[0, 0])
        state = plant.simulate(state, controls[None]).states[:, -1]
        assert len(points) < 3000, "the gait does not end"
    points.append(plant.observe(state).points[0])
    way = (points[-1].mean(axis=0) - points[0].mean(axis=0))[:2]
    before, after = (p[1::2] - p[::2] for p in (points[0], points[-1]))
    turn = np.arctan2(after[:, 1], after[:, 0]) - np.arctan2(before[:, 1], before[:, 0])
    return (len(points) - 1) * plant.dt, way, np.degrees((turn + np.pi) % (2 * np.pi) - np.pi)


def test_rolling_goes_as_far_as_published() -> None:
    seconds, way, _ = walk("roll")
    assert seconds == pytest.approx(ROLL_SECONDS, rel=0.15)
    assert np.linalg.norm(way) == pytest.approx(np.linalg.norm(ROLL), rel=0.15)
    assert np.linalg.norm(way - ROLL) < 0.15 * np.linalg.norm(ROLL)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pattern", "seconds", "degrees"), [("cw", CW_SECONDS, CW), ("ccw", CCW_SECONDS, CCW)]
)
def test_turning_turns_as_far_as_published(pattern: str, seconds: float, degrees: float) -> None:
    took, _, turn = walk(pattern)
    assert took == pytest.approx(seconds, rel=0.15)
    assert turn.mean() == pytest.approx(degrees, rel=0.15)
