from __future__ import annotations

import numpy as np
import pytest

from flywheel.control.gaits import PATIENCE, PATTERNS, Gait
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError
from flywheel.records import Observation, Past
from flywheel.robots import load_robot

ROBOT = load_robot("prism3")
REST = Plant(ROBOT).observe(Plant(ROBOT).rest())


def past(points: np.ndarray, winch: float = 1.5) -> Past:
    held = np.full((1, 1, 6), winch)
    return Past(Observation(points[None, None], held), np.zeros((1, 0, 6)), held)


def spread(lengths: float) -> np.ndarray:
    """Caps in a plane so that all six controlled distances are near `lengths` times 1.7 m."""
    return REST.points[0] * lengths


def test_a_target_that_cannot_be_reached_is_given_up_in_time() -> None:
    gait = Gait(ROBOT, "roll", cycles=1)
    stuck = past(spread(3.0), winch=1.0)  # far too long, and nothing ever moves
    steps = 0
    while not gait.cycling:
        gait.act(stuck)
        steps += 1
    assert steps == pytest.approx(PATIENCE / 0.01, abs=3)


def test_winches_pull_what_is_too_long_and_pay_out_what_is_too_short() -> None:
    pulled = Gait(ROBOT, "roll").act(past(spread(3.0))).controls
    assert pulled.shape == (1, 6)
    assert (pulled < 0).all()
    short = Gait(ROBOT, "roll").act(past(spread(0.5), winch=0.4)).controls
    assert (short > 0).all()


def test_a_slack_cable_is_not_paid_out() -> None:
    assert (Gait(ROBOT, "roll").act(past(spread(0.5), winch=2.0)).controls == 0).all()


def test_it_holds_until_every_cap_was_seen_and_bridges_gaps_later() -> None:
    gait = Gait(ROBOT, "roll")
    blind = spread(3.0)
    blind[2] = np.nan
    assert (gait.act(past(blind)).controls == 0).all()
    assert (gait.act(past(spread(3.0))).controls < 0).all()
    assert (gait.act(past(blind)).controls < 0).all()


def test_it_ends_after_its_cycles_and_then_holds() -> None:
    plant = Plant(ROBOT)
    gait = Gait(ROBOT, "ccw", cycles=1)
    state = plant.rest()
    for _ in range(1500):
        seen = plant.observe(state[:, None])
        command = gait.act(Past(seen, np.zeros((1, 0, 6)), seen.winch)).controls
        if gait.finished:
            break
        state = plant.simulate(state, command[None]).states[:, -1]
    assert gait.finished
    assert (gait.act(past(spread(3.0))).controls == 0).all()
    gait.reset(None, 0)
    assert not gait.finished
    assert (gait.act(past(spread(3.0))).controls < 0).all()


def test_names_are_for_provenance() -> None:
    assert [Gait(ROBOT, name).name for name in PATTERNS] == ["gait:roll", "gait:cw", "gait:ccw"]
    assert Gait(ROBOT, "cw").model == ""


def test_other_gaits_and_robots_are_refused() -> None:
    with pytest.raises(ConfigError, match="no gait 'hop'. Known: roll, cw, ccw"):
        Gait(ROBOT, "hop")
    for other in ("icosa6", "platform4"):
        with pytest.raises(ConfigError, match=f"gaits are for prism3.*{other} has"):
            Gait(load_robot(other), "roll")


def test_varied_targets_differ_between_seeds_and_repeat_with_one() -> None:
    def stopped(variation: float, seed: int) -> list[bool]:
        """Which winches are content, for rising lengths between the caps."""
        gait = Gait(ROBOT, "roll", variation=variation)
        gait.reset(None, seed)
        lengths = np.linspace(0.8, 1.2, 81)
        moving = [(gait.act(past(spread(length), winch=0.5)).controls != 0) for length in lengths]
        return np.concatenate(moving).tolist()

    one, other = (int(seed) for seed in np.random.default_rng().integers(2**31, size=2))
    assert stopped(0.15, one) == stopped(0.15, one)
    assert stopped(0.15, one) != stopped(0.15, other), (one, other)
    assert stopped(0.0, one) == stopped(0.0, other)
