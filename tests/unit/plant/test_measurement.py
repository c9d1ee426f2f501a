import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.dynamics.plant import MeasurementModel
from flywheel.records import Observation
from flywheel.robots import load_robot


@pytest.fixture(scope="module")
def truth() -> Observation:
    return Observation(np.full((50, 40, 6, 3), 1.5), np.full((50, 40, 6), 1.2))


def test_by_default_points_are_exact_and_winches_unseen(truth: Observation) -> None:
    seen = MeasurementModel().apply(truth, load_robot("prism3"), np.random.default_rng(0))
    np.testing.assert_array_equal(seen.points, truth.points)
    assert np.isnan(seen.winch).all()
    assert seen.points is not truth.points


def test_noise_is_a_fraction_of_the_robots_length(truth: Observation) -> None:
    seed = int(np.random.SeedSequence().generate_state(1)[0])
    robot, rng = load_robot("prism3"), np.random.default_rng(seed)
    seen = MeasurementModel(noise=0.01).apply(truth, robot, rng)
    error = seen.points - truth.points
    # 36,000 draws: the deviation is known to 0.4 %, the mean to 0.5 %.
    assert error.std() == pytest.approx(0.01 * 2.95, rel=0.02), seed
    assert abs(error.mean()) < 0.03 * 0.01 * 2.95, seed


def test_dropout_loses_whole_points(truth: Observation) -> None:
    seed = int(np.random.SeedSequence().generate_state(1)[0])
    rng = np.random.default_rng(seed)
    seen = MeasurementModel(dropout=0.2).apply(truth, load_robot("prism3"), rng)
    missing = np.isnan(seen.points)
    assert (missing.any(axis=-1) == missing.all(axis=-1)).all()
    assert (~seen.valid).mean() == pytest.approx(0.2, abs=0.02), seed


def test_winches_are_seen_where_there_is_a_sensor_or_by_choice() -> None:
    robot = load_robot("platform4")
    truth = Observation(np.zeros((2, 3, 3)), np.ones((2, 3)))
    rng = np.random.default_rng(0)
    seen = MeasurementModel().apply(truth, robot, rng).winch
    assert np.isnan(seen[0]).tolist() == [not w.measured for w in robot.winches]
    assert (MeasurementModel(winch_measured=True).apply(truth, robot, rng).winch == 1).all()


@pytest.mark.parametrize("wrong", [{"noise": -0.1}, {"dropout": 1.0}, {"delay": 0.1}])
def test_what_cannot_be_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        MeasurementModel(**wrong)
