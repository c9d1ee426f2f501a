import dataclasses
import secrets

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.control import Hold, RandomConfig, RandomControls
from flywheel.records import Past
from flywheel.robots import Robot

DT = 0.01
STEPS = 3000


@pytest.fixture
def middle(robot: Robot) -> np.ndarray:
    return (robot.rest_low + robot.rest_high) / 2


def servo(robot: Robot) -> Robot:
    winches = tuple(
        dataclasses.replace(w, kind="position", control_range=w.rest_range, time_constant=0.05)
        for w in robot.winches
    )
    return dataclasses.replace(robot, winches=winches)


def test_holding_keeps_the_winches_where_they_are(robot: Robot, past: Past, middle) -> None:
    assert (Hold(robot, DT).act(past).controls == 0).all()
    assert (Hold(servo(robot), DT).act(past).controls == middle).all()


def test_random_commands_keep_to_the_ranges_and_use_them(robot: Robot, middle) -> None:
    for kind in (robot, servo(robot)):
        controls = RandomControls(kind, DT).sequence(middle, STEPS, seed := secrets.randbits(32))
        assert controls.shape == (STEPS, 6)
        assert (controls >= kind.control_low - 1e-12).all(), seed
        assert (controls <= kind.control_high + 1e-12).all(), seed
        positions = kind.dead_reckon(middle, controls, DT)
        swing = np.ptp(positions, axis=0) / (kind.rest_high - kind.rest_low)
        assert swing.min() > 0.35 and swing.mean() > 0.75, (seed, swing)


def test_random_winches_move_hold_and_change_their_mind_one_by_one(robot: Robot, middle) -> None:
    seed = secrets.randbits(32)
    controls = RandomControls(robot, DT).sequence(middle, STEPS, seed)
    still = np.isclose(controls, 0.0).mean(axis=0)
    assert 0.15 < still.mean() < 0.55 and (still < 0.9).all(), (seed, still)
    changes = (np.abs(np.diff(controls, axis=0)) > 1e-9).sum(axis=0)
    assert (changes < STEPS / 20).all(), "commands are held, not jittered"
    together = (np.abs(np.diff(controls, axis=0)) > 1e-9).all(axis=1).sum()
    assert together == 0


def test_the_same_seed_gives_the_same_commands(robot: Robot, middle, past: Past) -> None:
    controls = RandomControls(robot, DT)
    seed = secrets.randbits(32)
    np.testing.assert_array_equal(
        controls.sequence(middle, 50, seed), controls.sequence(middle, 50, seed)
    )
    controls.reset(None, seed)
    first, second = controls.act(past).controls, controls.act(past).controls
    assert not np.array_equal(first, second)
    controls.reset(None, seed)
    np.testing.assert_array_equal(controls.act(past).controls, first)


def test_a_wrong_configuration_is_refused() -> None:
    with pytest.raises(ValidationError, match="least <= most"):
        RandomConfig(seconds=(2.0, 1.0))
