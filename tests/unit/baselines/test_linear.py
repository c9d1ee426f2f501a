"""The linear model: linear motion exactly, everywhere and in all directions."""

import numpy as np
import pytest

from flywheel.dynamics.baselines import LinearConfig, LinearDynamics
from flywheel.errors import DataError, ModelError
from flywheel.records import Floats, Observation, Past, Trajectory
from flywheel.robots import load_robot
from flywheel.training.baselines import FitSettings, fit

ROBOT = load_robot("prism3")
SMALL = LinearConfig(pose_lags=2, input_lags=3)
LINEAR = LinearDynamics(ROBOT, 0.01, SMALL)
QUICK = FitSettings(horizon=0.2)


def driven(seed: int, steps: int = 400) -> Trajectory:
    """Points that move as the last commands say, in axes that go with the robot."""
    rng = np.random.default_rng(seed)
    controls = rng.uniform(ROBOT.control_low, ROBOT.control_high, (steps, len(ROBOT.winches)))
    told = controls / ROBOT.control_high
    model = LinearDynamics(ROBOT, 0.01, SMALL)
    gain = np.random.default_rng(7).normal(0, 2e-3, (2, 6, 18))
    points = [ROBOT.points_of(ROBOT.keyframe)] * 2
    for t in range(1, steps):
        turn = model.axes(points[-1][None])[0]
        before = (points[-1] - points[-2]) @ turn.T / ROBOT.length
        step = 0.6 * before + (told[t] @ gain[0] + told[t - 1] @ gain[1]).reshape(6, 3)
        points.append(points[-1] + ROBOT.length * step @ turn)
    winch = np.full((steps + 1, 6), 1.0)
    return Trajectory(Observation(np.array(points), winch), controls, 0.01)


def question(track: Trajectory, at: int, steps: int) -> tuple[Past, Floats]:
    seen = Observation(
        track.observations.points[None, : at + 1], track.observations.winch[None, : at + 1]
    )
    past = Past(seen, track.controls[None, :at], track.observations.winch[None, : at + 1])
    return past, track.controls[None, at : at + steps]


def test_a_linear_robot_is_found_and_predicted() -> None:
    found = fit(LINEAR, [driven(seed) for seed in range(3)], QUICK)
    assert found.error < 0.01 * found.before
    track = driven(9)
    got = found.model.rollout(*question(track, 50, 100)).points[0]
    travelled = np.abs(track.observations.points[150] - track.observations.points[50]).max()
    assert np.abs(got - track.observations.points[50:151]).max() < 0.02 * travelled


def test_predictions_go_along_with_place_and_direction() -> None:
    rng = np.random.default_rng(0)
    shape = LinearDynamics(ROBOT, 0.01, SMALL).coefficients.shape
    model = LinearDynamics(ROBOT, 0.01, SMALL, 1e-3 * rng.normal(size=shape))
    past, controls = question(driven(1), 20, 10)
    angle = 0.8
    turn = np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    shift = np.array([3.0, -1.0, 0.0])
    elsewhere = Past(
        Observation(past.observations.points @ turn + shift, past.observations.winch),
        past.controls,
        past.winch,
    )
    here, there = (model.rollout(p, controls).points for p in (past, elsewhere))
    np.testing.assert_allclose(there, here @ turn + shift, atol=1e-9)


def test_rows_with_a_missing_point_are_left_out() -> None:
    tracks = [driven(seed) for seed in range(3)]
    points = tracks[0].observations.points.copy()
    points[100:110, 2] = np.nan
    tracks[0] = Trajectory(
        Observation(points, tracks[0].observations.winch), tracks[0].controls, 0.01
    )
    found = fit(LINEAR, tracks, QUICK)
    assert found.error < 0.01 * found.before


def test_a_model_that_diverges_says_so() -> None:
    shape = LinearDynamics(ROBOT, 0.01, SMALL).coefficients.shape
    coefficients = np.zeros(shape)
    coefficients[: 2 * 18] = 3.0
    with pytest.raises(ModelError, match="diverges"):
        LinearDynamics(ROBOT, 0.01, SMALL, coefficients).rollout(*question(driven(1), 20, 300))


@pytest.mark.parametrize("count", [0, 1])
def test_recordings_that_do_not_do_are_refused(count) -> None:
    with pytest.raises(DataError):
        fit(LINEAR, [driven(0, 2)] * count, QUICK)
