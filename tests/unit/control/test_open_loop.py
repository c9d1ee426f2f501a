import numpy as np
import pytest

from flywheel.control import Hold, Playback, RandomControls
from flywheel.errors import ConfigError
from flywheel.records import Observation, Past
from flywheel.robots import Robot
from tests import draws

DT = 0.01
STEPS = 3000


@pytest.fixture
def middle(robot: Robot) -> np.ndarray:
    return (robot.rest_low + robot.rest_high) / 2


def test_holding_keeps_the_winches_where_they_are(robot, servo, past, middle):
    assert (Hold(robot, DT).act(past).controls == 0).all()
    assert (Hold(servo, DT).act(past).controls == middle).all()


def test_what_is_not_planned_takes_no_time_and_shows_nothing(robot: Robot, past: Past) -> None:
    for controller in (Hold(robot, DT), RandomControls(robot, DT)):
        command = controller.act(past)
        assert (command.plan_seconds, command.diagnostics) == (0.0, {})
        assert (controller.model, controller.history) == ("", 0)


def test_random_commands_keep_to_the_ranges_and_use_them(robot, servo, middle):
    for kind in (robot, servo):
        controls = RandomControls(kind, DT).sequence(middle, STEPS, seed := draws.seed())
        assert controls.shape == (STEPS, 6)
        assert (controls >= kind.control_low - 1e-12).all(), seed
        assert (controls <= kind.control_high + 1e-12).all(), seed
        positions = kind.dead_reckon(middle, controls, DT)
        swing = np.ptp(positions, axis=0) / (kind.rest_high - kind.rest_low)
        assert swing.min() > 0.35 and swing.mean() > 0.75, (seed, swing)


def test_random_winches_move_hold_and_change_their_mind_one_by_one(robot: Robot, middle) -> None:
    seed = draws.seed()
    controls = RandomControls(robot, DT).sequence(middle, STEPS, seed)
    still = np.isclose(controls, 0.0).mean(axis=0)
    assert 0.15 < still.mean() < 0.55 and (still < 0.9).all(), (seed, still)
    changes = (np.abs(np.diff(controls, axis=0)) > 1e-9).sum(axis=0)
    assert (changes < STEPS / 20).all(), "commands are held, not jittered"
    together = (np.abs(np.diff(controls, axis=0)) > 1e-9).all(axis=1).sum()
    assert together == 0


def test_the_same_seed_gives_the_same_commands(robot: Robot, middle, past: Past) -> None:
    controls = RandomControls(robot, DT)
    seed = draws.seed()
    np.testing.assert_array_equal(
        controls.sequence(middle, 50, seed), controls.sequence(middle, 50, seed)
    )
    controls.reset(None, seed)
    first, second = controls.act(past).controls, controls.act(past).controls
    assert not np.array_equal(first, second)
    controls.reset(None, seed)
    np.testing.assert_array_equal(controls.act(past).controls, first)


@pytest.mark.parametrize("seconds", [0.3, 1.0])
def test_one_choice_lasts_as_long_as_it_is_meant_to(robot: Robot, past: Past, seconds) -> None:
    """A controller that is asked again too soon costs time, one asked too late is not asked."""
    held = Hold(robot, DT, seconds).act(past).controls
    drawn = RandomControls(robot, DT, seconds=(0.1, seconds)).act(past).controls
    assert len(held) == len(drawn) == round(seconds / DT)


def test_a_choice_shorter_than_a_step_is_one_step(robot: Robot, past: Past) -> None:
    assert len(Hold(robot, DT, 0.001).act(past).controls) == 1
    config = {"seconds": (0.001, 0.002)}
    assert len(RandomControls(robot, DT, **config).act(past).controls) == 1


def test_no_two_choices_are_the_same(robot: Robot, past: Past) -> None:
    random = RandomControls(robot, DT, seconds=(0.02, 0.02), drive=0.0)
    chosen = np.stack([random.act(past).controls[0] for _ in range(300)])
    assert len(np.unique(chosen, axis=0)) == 300


def moved(past: Past, winch: np.ndarray) -> Past:
    """The same, one step later, with the winches elsewhere."""
    both = np.stack([past.winch[0, 0], winch])[None]
    seen = Observation(past.observations.points.repeat(2, 1), both)
    return Past(seen, np.zeros((1, 1, len(winch))), both)


def test_commands_begin_where_the_winches_are_now(servo: Robot, past: Past, middle) -> None:
    now = servo.rest_low + 0.9 * (servo.rest_high - servo.rest_low)
    later = moved(past, now)
    np.testing.assert_array_equal(Hold(servo, DT).act(later).controls[0], now)
    first = RandomControls(servo, DT).act(later).controls[0]
    fastest = (servo.rest_high - servo.rest_low) * DT
    assert (np.abs(first - now) <= fastest + 1e-12).all()


@pytest.mark.parametrize("slowest", [0.0, 0.5, 1.0])
def test_speeds_are_drawn_evenly_from_the_slowest_to_the_fastest(robot, servo, slowest):
    """In both directions; only the step with which a winch arrives is shorter."""
    config = {"seconds": (0.02, 0.05), "drive": 1.0, "slowest": slowest}
    for kind in (robot, servo):
        low, high = kind.rest_low, kind.rest_high
        middle = (low + high) / 2
        controls = RandomControls(kind, DT, **config).sequence(middle, 3000, 8)
        positions = kind.dead_reckon(middle, controls, DT) if kind is robot else controls
        fastest = robot.control_high if kind is robot else high - low
        speeds = np.diff(positions, axis=0) / DT / fastest
        inside = ((positions > low + 1e-9) & (positions < high - 1e-9))[1:]
        for sign in (-1, 1):
            one_way = np.abs(speeds[inside & (sign * speeds > 0)])
            assert one_way.max() <= 1.0 + 1e-9
            assert one_way.mean() == pytest.approx((1 + slowest) / 2, abs=0.03)
            assert one_way.var() == pytest.approx((1 - slowest) ** 2 / 12, abs=0.01)


def test_winches_that_drive_rest_at_the_ends_and_those_that_do_not_rest_between(servo, middle):
    """Each for a while that is long enough to arrive."""
    low, high = servo.rest_low, servo.rest_high
    for drive, at_an_end in ((0.0, 0.0), (0.3, 0.3), (1.0, 1.0)):
        config = {"seconds": (4.0, 6.0), "drive": drive, "slowest": 0.5}
        controls = RandomControls(servo, DT, **config).sequence(middle, 20_000, 9)
        still = np.abs(np.diff(controls, axis=0)) < 1e-9
        there = (controls < low + 1e-9) | (controls > high - 1e-9)
        assert there[1:][still].mean() == pytest.approx(at_an_end, abs=0.1)
        if drive:
            lower = (controls < low + 1e-9)[there]
            assert lower.mean() == pytest.approx(0.5, abs=0.1)


def test_minds_change_after_whiles_within_the_bounds(servo: Robot, middle) -> None:
    config = {"seconds": (0.2, 0.4), "drive": 0.0, "slowest": 1.0}
    controls = RandomControls(servo, DT, **config).sequence(middle, 4000, 10)
    moving = np.abs(np.diff(controls, axis=0)) > 1e-9
    for winch in moving.T:
        begins = np.flatnonzero(winch[1:] & ~winch[:-1])
        whiles = np.diff(begins) * DT
        assert whiles.min() >= 0.2 - 2 * DT
        assert np.quantile(whiles, 0.1) < 0.4


def test_a_script_is_played_once_and_then_held(robot: Robot, servo: Robot, past: Past) -> None:
    script = np.random.default_rng(draws.seed()).uniform(-0.1, 0.1, (4, 6))
    for kind, still in ((robot, np.zeros(6)), (servo, past.winch[0, -1])):
        controller = Playback(kind, script, "mine")
        for _ in range(2):
            controller.reset(None, 0)
            np.testing.assert_array_equal(controller.act(past).controls, script)
            np.testing.assert_array_equal(controller.act(past).controls, [still])
        assert controller.name == "playback:mine"


@pytest.mark.parametrize("script", [np.zeros((4, 5)), np.zeros(6), np.full((4, 6), np.nan)])
def test_what_is_no_script_for_the_robot_is_refused(robot: Robot, script: np.ndarray) -> None:
    with pytest.raises(ConfigError, match="A script for prism3"):
        Playback(robot, script)
