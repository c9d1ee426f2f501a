import numpy as np
import pytest

from flywheel.control.knots import Knots
from flywheel.robots import Robot
from tests import draws

DT = 0.01


@pytest.fixture
def knots(robot: Robot) -> Knots:
    return Knots(robot, DT, steps=50, count=4)


def drawn(knots: Knots, batch: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    low, high = knots.robot.rest_low, knots.robot.rest_high
    plan = rng.uniform(low - 0.3, high + 0.3, (batch, knots.count, len(low)))
    return rng.uniform(low, high), plan


def test_plan_to_commands_and_back_is_the_plan_that_can_be_followed(knots: Knots) -> None:
    winch, plan = drawn(knots, 7, np.random.default_rng(seed := draws.seed()))
    start, controls = np.tile(winch, (7, 1)), knots.controls(winch, plan)
    followed = knots.robot.dead_reckon(start, controls, knots.dt)[:, knots.steps :: knots.steps]
    expected = knots.reachable(winch, plan)
    np.testing.assert_allclose(followed, expected, atol=1e-9, err_msg=f"seed {seed}")


def test_a_plan_that_can_be_followed_stays_as_it_is(knots: Knots) -> None:
    winch, plan = drawn(knots, 7, np.random.default_rng(seed := draws.seed()))
    once = knots.reachable(winch, plan)
    np.testing.assert_allclose(knots.reachable(winch, once), once, err_msg=f"seed {seed}")


def test_commands_keep_to_the_ranges(knots: Knots) -> None:
    winch, plan = drawn(knots, 20, np.random.default_rng(draws.seed()))
    robot, controls = knots.robot, knots.controls(winch, plan)
    assert controls.shape == (20, 200, len(robot.winches))
    assert (controls >= robot.control_low).all() and (controls <= robot.control_high).all()
    reached = knots.reachable(winch, plan)
    assert (reached >= robot.rest_low).all() and (reached <= robot.rest_high).all()


def test_commands_of_one_plan_do_not_depend_on_the_others(knots: Knots) -> None:
    winch, plan = drawn(knots, 9, np.random.default_rng(draws.seed()))
    together = knots.controls(winch, plan)
    for one in (0, 4):
        np.testing.assert_array_equal(knots.controls(winch, plan[one]), together[one])


def test_a_winch_that_cannot_keep_up_goes_on_at_full_speed(knots: Knots) -> None:
    robot = knots.robot
    plan = np.broadcast_to(robot.rest_high, (knots.count, len(robot.winches)))
    controls = knots.controls(robot.rest_low, plan)
    np.testing.assert_allclose(controls[:150], np.broadcast_to(robot.control_high, (150, 6)))


def test_a_position_winch_is_commanded_the_positions_themselves(servo: Robot) -> None:
    knots = Knots(servo, DT, steps=50, count=4)
    rng = np.random.default_rng(draws.seed())
    winch = rng.uniform(servo.rest_low, servo.rest_high)
    plan = rng.uniform(servo.rest_low, servo.rest_high, (4, len(winch)))
    controls = knots.controls(winch, plan)
    np.testing.assert_allclose(controls[49::50], plan)
    np.testing.assert_allclose(controls[24], winch + (plan[0] - winch) / 2)


def test_the_rest_of_a_plan_moves_up_and_repeats_its_end(knots: Knots) -> None:
    plan = np.arange(4.0)[:, None] * np.ones(6)
    assert knots.later(plan, 50)[:, 0].tolist() == [1, 2, 3, 3]
    assert knots.later(plan, 25)[:, 0].tolist() == [0.5, 1.5, 2.5, 3]
    assert knots.later(plan, 175)[:, 0].tolist() == [3, 3, 3, 3]
    assert knots.later(plan, 130)[:, 0].tolist() == pytest.approx([2.6, 3, 3, 3])
    assert knots.later(plan, 500)[:, 0].tolist() == [3, 3, 3, 3]
    np.testing.assert_array_equal(knots.later(plan, 0), plan)


def test_a_plan_of_one_knot_can_be_taken_up_later(robot: Robot) -> None:
    one = Knots(robot, DT, steps=50, count=1)
    assert one.later(np.ones((1, 6)), 50).tolist() == [[1.0] * 6]
    assert one.later(np.ones((1, 6)), 20).tolist() == [[1.0] * 6]
