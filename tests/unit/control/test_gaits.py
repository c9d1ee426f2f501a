from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from flywheel.control.gaits import (
    BEHIND,
    DERIVATIVE,
    DWELL,
    FORWARDS,
    GAIN,
    INTEGRAL,
    PAIRS,
    PATIENCE,
    PATTERNS,
    SIDES,
    TOLERANCE,
    Gait,
    Pattern,
    Reach,
)
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError
from flywheel.records import Observation, Past
from flywheel.robots import Robot, load_robot
from tests import draws

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
    while gait._index <= 1:  # until the first rest is over
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
    assert [Gait(ROBOT, name).name for name in FORWARDS] == ["gait:roll", "gait:cw", "gait:ccw"]
    assert (Gait(ROBOT, "cw").model, Gait(ROBOT, "cw").history) == ("", 0)


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

    one, other = (int(seed) for seed in np.random.default_rng(draws.seed()).integers(2**31, size=2))
    assert stopped(0.15, one) == stopped(0.15, one)
    assert stopped(0.15, one) != stopped(0.15, other), (one, other)
    assert stopped(0.0, one) == stopped(0.0, other)


def test_gaits_are_for_winches_that_take_rates(servo: Robot) -> None:
    mixed = replace(ROBOT, winches=(*ROBOT.winches[:3], *servo.winches[3:]))
    for other in (servo, mixed):
        with pytest.raises(ConfigError, match="six rate winches"):
            Gait(other, "roll")


def caps(length: float, down: tuple[int, ...] = (0, 2, 5)) -> np.ndarray:
    """Caps (6, 3) of which all controlled distances are alike, and three are the lowest.

    They are two upright triangles, one with its tip up, one with its tip down.
    """
    points = np.zeros((6, 3))
    for triangle in ((0, 2, 4), (1, 3, 5)):
        low = [cap for cap in triangle if cap in down]
        high = [cap for cap in triangle if cap not in down]
        tip, base, up = (*high, low, 1) if len(high) == 1 else (*low, high, -1)
        points[tip, 2] = up * length / 3**0.5
        points[base, 2] = -up * length / 12**0.5
        points[base, 0] = -length / 2, length / 2
    return points


def between(relative: float, pattern: Pattern) -> float:
    """The length that a pattern calls `relative` [m]."""
    return pattern.shortest + relative * pattern.range


def taut(pattern: Pattern) -> float:
    """A rest length that is shorter than all lengths of a pattern, and not the shortest one [m]."""
    return (pattern.shortest + ROBOT.rest_low[0]) / 2


def tried(gait: Gait, down: tuple[int, ...], targets: int) -> np.ndarray:
    """(targets, W) whether each winch lets out, for targets of which one is given up at each step."""
    seen = past(caps(between(0.5, gait.pattern), down), taut(gait.pattern))
    return np.stack([gait.act(seen).controls[0] for _ in range(targets)])


@pytest.mark.parametrize("name", FORWARDS)
@pytest.mark.parametrize("down", SIDES)
def test_targets_follow_each_other_as_the_robot_lies(name: str, down: tuple[int, ...]) -> None:
    """Rest, then the pattern's targets in turn, for ever; each cable takes its own side's place."""
    gait = Gait(ROBOT, name, dt=PATIENCE)
    targets = np.array(gait.pattern.targets)[:, list(SIDES[down])]
    found = tried(gait, down, 1 + 2 * len(targets))
    assert (found[0] > 0).all()  # rest: as long as the pattern knows
    expected = np.sign(np.concatenate([targets, targets]) - 0.5)
    np.testing.assert_array_equal(np.sign(found[1:]), expected)


@pytest.mark.parametrize("name", FORWARDS)
@pytest.mark.parametrize("down", SIDES)
def test_backwards_a_gait_is_that_of_the_robot_with_its_caps_called_otherwise(name, down) -> None:
    """Rods stay rods with their ends changed, and each cable takes the place of the renamed one."""
    renamed = tuple(sorted(BEHIND[cap] for cap in down))
    count = 1 + len(FORWARDS[name].targets)
    pairs = [frozenset(pair) for pair in PAIRS]
    to = [pairs.index(frozenset(BEHIND[cap] for cap in pair)) for pair in PAIRS]
    assert [BEHIND[cap] // 2 for cap in (0, 2, 4)] == [BEHIND[cap] // 2 for cap in (1, 3, 5)]
    there = tried(Gait(ROBOT, f"{name}_back", dt=PATIENCE), down, count)
    here = tried(Gait(ROBOT, name, dt=PATIENCE), renamed, count)
    np.testing.assert_array_equal(there, here[:, to])


def test_a_cycle_begins_after_rest_and_after_the_cycle_before_it() -> None:
    for cycles, count in ((None, 4), (2, 2)):
        gait, begins = Gait(ROBOT, "cw", dt=PATIENCE, cycles=cycles), []
        seen = past(caps(between(0.5, gait.pattern)), taut(gait.pattern))
        for _ in range(12):  # a target in each step; a cycle has three
            begins.append(gait.begins_cycle)
            gait.act(seen)
        assert np.flatnonzero(begins).tolist() == [1, 4, 7, 10][:count]


def test_a_side_is_taken_for_a_whole_cycle_and_kept_where_the_robot_lies_on_none() -> None:
    gait = Gait(ROBOT, "cw", dt=PATIENCE)
    first, other = (0, 2, 5), (0, 3, 4)
    targets = np.array(gait.pattern.targets)
    tried(gait, first, 2)
    found = [*tried(gait, other, 2), *tried(gait, other, 3)]
    turned = targets[:, list(SIDES[other])]
    expected = np.sign(np.array([*targets[1:], *turned]) - 0.5)
    np.testing.assert_array_equal(np.sign(found), expected)
    flat = past(np.roll(caps(between(0.5, gait.pattern)), 1, axis=0), taut(gait.pattern))
    assert tuple(np.argsort(flat.observations.points[0, -1, :, 2])[:3]) not in SIDES
    found = np.stack([gait.act(flat).controls[0] for _ in targets])
    np.testing.assert_array_equal(np.sign(found), expected[2:])


def test_all_sides_are_one_seen_after_a_turn_of_the_robot() -> None:
    """Some way to rename the caps takes rods to rods, the side to the other, and its cables along."""
    rods = {frozenset(pair) for pair in ((0, 1), (2, 3), (4, 5))}
    turns = [
        turn
        for turn in permutations(range(6))
        if {frozenset((turn[a], turn[b])) for a, b in rods} == rods
        and {frozenset(turn[cap] for cap in pair) for pair in PAIRS} == set(map(frozenset, PAIRS))
    ]
    pairs = [frozenset(pair) for pair in PAIRS]
    for ours, theirs in (
        ((0, 2, 5), (1, 2, 4)),
        ((0, 2, 5), (0, 3, 4)),
        ((0, 3, 5), (1, 2, 5)),
        ((0, 3, 5), (1, 3, 4)),
    ):
        turned = [
            [pairs.index(frozenset(turn[cap] for cap in pair)) for pair in PAIRS]
            for turn in turns
            if {turn[cap] for cap in ours} == set(theirs)
        ]
        # cable c of ours is cable `to[c]` of theirs, and takes the same target
        assert any([SIDES[theirs][c] for c in to] == list(SIDES[ours]) for to in turned), theirs
    assert len(SIDES) == 6


def reach(wanted: float, pattern: Pattern = PATTERNS["ccw"], dt: float = 0.01) -> Reach:
    return Reach(ROBOT, pattern, np.full(6, wanted), dt)


def commanded(one: Reach, relative: float, rest: float | None = None) -> np.ndarray:
    """What is commanded at a relative length of all cables; they are taut by default."""
    length = between(relative, one.pattern)
    rest = taut(one.pattern) if rest is None else rest
    return one.command(np.full(6, length), np.full(6, rest)) / ROBOT.control_high


@pytest.mark.parametrize("dt", [0.01, 0.02])
@pytest.mark.parametrize("error", [0.11, -0.11])
def test_a_lasting_error_is_pulled_at_in_proportion_to_it_and_to_its_sum(dt, error):
    one = reach(0.5, dt=dt)
    for step in range(1, 30):
        expected = -(GAIN * error + INTEGRAL * error * step * dt / 0.01)
        np.testing.assert_allclose(commanded(one, 0.5 + error), expected)


def test_an_error_that_grows_is_pulled_at_more() -> None:
    one, grows = reach(0.5), 0.0005
    commanded(one, 0.5 + 0.12)
    expected = GAIN * (0.12 + grows) + INTEGRAL * (0.24 + grows) + DERIVATIVE * grows / 0.01
    np.testing.assert_allclose(commanded(one, 0.5 + 0.12 + grows), -expected)


def test_no_winch_is_told_to_go_faster_than_it_can() -> None:
    np.testing.assert_array_equal(commanded(reach(0.1), 1.0), -1.0)
    np.testing.assert_array_equal(commanded(reach(1.0), 0.1), 1.0)


@pytest.mark.parametrize("pattern", PATTERNS.values())
def test_a_length_counts_as_reached_within_the_tolerance(pattern: Pattern) -> None:
    """That is in metres where the pattern's range is less than one, and else in relative lengths."""
    share = TOLERANCE / min(pattern.range, 1.0)
    for sign in (-1, 1):
        assert not commanded(reach(0.5, pattern), 0.5 + sign * 0.99 * share).any()
        assert commanded(reach(0.5, pattern), 0.5 + sign * 1.01 * share).all()
    short = replace(pattern, range=0.5)
    assert not commanded(reach(0.5, short), 0.5 + 1.9 * TOLERANCE).any()
    assert commanded(reach(0.5, short), 0.5 + 2.1 * TOLERANCE).all()


def test_a_cable_wanted_as_short_as_can_be_may_be_shorter() -> None:
    assert not commanded(reach(0.0), -0.3).any()
    assert (commanded(reach(0.0), 0.5) < 0).all()
    assert (commanded(reach(0.15), -0.3) > 0).all()  # but not one that is wanted longer


def test_a_winch_at_its_end_does_not_pull_on_but_lets_out() -> None:
    end = ROBOT.rest_low[0]
    assert not commanded(reach(0.2), 0.6, rest=end).any()
    assert (commanded(reach(0.2), 0.6, rest=end + 0.01) < 0).all()
    assert (commanded(reach(0.8), 0.4, rest=end) > 0).all()


def test_a_slack_cable_is_content_with_being_too_short_but_is_pulled_at_if_too_long() -> None:
    slack = between(0.9, PATTERNS["ccw"])
    assert not commanded(reach(0.8), 0.4, rest=slack).any()
    assert (commanded(reach(0.2), 0.6, rest=slack) < 0).all()


def test_a_winch_that_is_content_stays_so_until_the_next_target() -> None:
    one = reach(0.5)
    assert not commanded(one, 0.5).any()
    assert not commanded(one, 1.0).any()


def test_a_target_that_is_reached_is_left_after_a_short_dwell() -> None:
    dt = 1 / 64  # of which sums are exact
    one, steps = reach(0.5, dt=dt), 0
    while not one.finished:
        assert not commanded(one, 0.5).any()
        steps += 1
    assert steps == np.floor(DWELL / dt) + 1


def test_a_slack_cable_is_not_paid_out_however_fast_its_length_falls() -> None:
    one, slack = reach(0.2), between(0.9, PATTERNS["ccw"])
    assert (commanded(one, 0.8, rest=slack) < 0).all()
    assert not commanded(one, 0.5, rest=slack).any()
    taut_one = reach(0.2)
    assert (commanded(taut_one, 0.8) < 0).all()
    assert (commanded(taut_one, 0.5) > 0).all()  # which a taut one is


def test_one_winch_that_moves_keeps_all_from_dwelling() -> None:
    one = reach(0.5)
    lengths = np.full(6, between(0.5, one.pattern))
    lengths[3] = between(1.0, one.pattern)
    for _ in range(round(3 * DWELL / one.dt)):
        one.command(lengths, np.full(6, taut(one.pattern)))
    assert not one.finished


def test_patience_ends_when_its_time_is_over() -> None:
    one, steps = reach(0.5, dt=1 / 8), 0
    while not one.finished:
        commanded(one, 1.0)
        steps += 1
    assert steps == PATIENCE * 8


def test_slackness_is_judged_by_where_winches_are_now() -> None:
    short = spread(0.5)
    for now, before in ((0.4, 2.0), (2.0, 0.4)):
        winch = np.array([[[before] * 6, [now] * 6]])
        seen = Observation(np.stack([short, short])[None], winch)
        controls = Gait(ROBOT, "roll").act(Past(seen, np.zeros((1, 1, 6)), winch)).controls
        assert (controls > 0).all() == (now < before)
