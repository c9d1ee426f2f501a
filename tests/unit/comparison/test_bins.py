"""Where an error is: parts that add up to the whole, to the bit."""

import numpy as np
import pytest

from flywheel.diagnosis.comparison import Bins, Comparison
from flywheel.diagnosis.comparison.regions import cable_tensions, spans
from flywheel.dynamics.plant import Plant
from flywheel.robots import Robot

pytestmark = pytest.mark.slow


def test_the_parts_of_every_table_add_up_to_the_whole_exactly(found: Comparison) -> None:
    (model,) = found.models
    whole = {"points": model.whole, "cables": model.cables}
    assert {b.by for b in model.bins} == {
        "end cap", "window", "cable", "contact", "speed", "tension", "command",
    }  # fmt: skip
    for bins in model.bins:
        assert bins.whole == whole[bins.of], bins.by
    assert model.whole.count == np.isfinite(found.windows.measured).sum()


def test_the_whole_is_the_sum_of_squares_in_noise_variances(found: Comparison) -> None:
    (model,), windows = found.models, found.windows
    off = (windows.measured - model.points[:, 1:]) / windows.sigma
    assert np.isclose(model.whole.total, np.nansum(off**2), rtol=1e-9)
    assert np.allclose(model.by_lead, np.nanmean(off**2, axis=(0, 2, 3)))


def test_what_is_sorted_lands_in_its_bin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, place = rng.exponential(size=(5, 40)), rng.integers(0, 3, (5, 40))
    values[rng.random(values.shape) < 0.2] = np.nan
    bins = Bins.sort("points", "chance", ("a", "b", "c", "never"), values, place)
    for i in range(3):
        assert np.isclose(bins.sums.total[i], np.nansum(values[place == i])), seed
    assert bins.sums.count.tolist()[3] == 0
    assert bins.worst(9) == sorted(range(3), key=lambda i: -bins.sums.mean[i])
    assert bins.summary()[3]["mean_square"] is None


def test_an_error_of_one_end_cap_is_found_at_that_end_cap_and_its_cables(robot, found, seed):
    points = found.models[0].points.copy()
    point = int(np.random.default_rng(seed).integers(len(robot.points)))
    off = np.zeros_like(points)
    off[:, :, point] = [0.0, 0.0, 1.0]
    square = ((spans(robot, points + off) - spans(robot, points)) ** 2).sum(axis=(0, 1))
    ends = np.array([point in {a.point for a in cable.ends} for cable in robot.cables])
    assert (square[~ends] == 0).all()
    assert (square[ends] > 0).all(), seed


def test_lengths_and_tensions_of_cables_are_those_of_the_simulation(robot: Robot) -> None:
    plant = Plant(robot)
    settled = plant.settle(2.0)
    lengths = robot.cable_lengths(settled.qpos.reshape(len(settled.qpos), -1, 7))
    points = plant.observe(settled).points[None]
    tensions = cable_tensions(robot, points, plant.winch(settled)[None], plant.dt)[0]
    rest = np.array([cable.rest_length for cable in robot.cables])
    stiffness = np.array([cable.stiffness for cable in robot.cables])
    expected = stiffness * np.maximum(lengths - rest, 0.0)
    assert expected.max() > 0
    # the roll is not seen, and found from where the cables have the least energy
    assert np.allclose(tensions, expected, atol=0.1 * expected.max())
