"""Winches that nobody measures are where what is known of them says."""

import dataclasses

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.dynamics.plant import (
    EffectivePlant,
    MeasurementModel,
    Plant,
    PlantParameters,
    Reckoning,
)
from flywheel.effects import NAMED, Scales, Term, Terms
from flywheel.errors import RobotError
from flywheel.records import Floats, Observation, Trajectory
from flywheel.robots import Robot, load_robot
from tests import draws

SECONDS = 4.0
ON_THE_WAY = ("winch_gain", "command_delay", "actuator_lag", "winch_backlash")


def typical(name: str, robot: Robot, size: float = 1.0) -> Terms:
    effect, scales = NAMED[name], Scales.of(robot)
    sizes = [size * parameter.typical(scales) for parameter in effect.sizes]
    return (Term(effect, None, (*sizes, *(p.typical(scales) for p in effect.shapes))),)


def driven(
    robot: Robot, terms: Terms, noise: float = 0.0, speed: float = 1.0
) -> tuple[Trajectory, Floats]:
    """What is seen of a robot under random controls, without its winches; and where these were."""
    rng = np.random.default_rng(draws.seed())
    numbers = PlantParameters(winch_speed=speed)
    plant = EffectivePlant(Plant(robot), terms) if terms else Plant(robot, parameters=numbers)
    start = Plant(robot).settle(1.0)
    controls = RandomControls(robot, 0.01).sequence(
        plant.winch(start)[0], round(SECONDS / 0.01), int(rng.integers(2**31))
    )
    course = plant.begin(start).go(controls[None])
    truth = plant.winch(course.states)[0]
    seen = MeasurementModel(noise=noise).apply(course.observations[0], robot, rng)
    unseen = np.full_like(truth, np.nan)
    unseen[0] = truth[0]
    return Trajectory(Observation(seen.points, unseen), controls, 0.01), truth


def off(found: Floats, truth: Floats) -> float:
    return float(np.abs(found - truth).max())


@pytest.fixture(scope="module", params=["prism3", "icosa6"])
def robot(request) -> Robot:
    return load_robot(request.param)


@pytest.mark.parametrize("name", ON_THE_WAY)
def test_what_happens_to_commands_is_reckoned_with(robot, name) -> None:
    terms = typical(name, robot)
    track, truth = driven(robot, terms)
    known = Reckoning(robot, 0.01, terms).known(track)
    nominal = Reckoning(robot, 0.01).known(track)
    assert off(nominal, truth) > 0.003 * robot.length
    assert off(known, truth) < 0.1 * off(nominal, truth)


@pytest.mark.parametrize("speed", [0.9, 1.1])
def test_winches_that_are_known_to_turn_at_another_speed_are_reckoned_with_it(robot, speed) -> None:
    track, truth = driven(robot, (), speed=speed)
    assert off(Reckoning(robot, 0.01).known(track), truth) > 0.003 * robot.length
    assert off(Reckoning(robot, 0.01, speed=speed).known(track), truth) < 1e-6


def test_a_marker_that_is_lost_takes_only_its_bodys_cables_with_it(robot) -> None:
    terms = typical("torque_speed", robot, 2.0)
    track, truth = driven(robot, terms)
    points = track.observations.points.copy()
    points[:, 0] = np.nan
    blind = dataclasses.replace(track.observations, points=points)
    known = Reckoning(robot, 0.01, terms).known(dataclasses.replace(track, observations=blind))
    nominal = Reckoning(robot, 0.01).known(track)
    touched = {i for i, c in enumerate(robot.cables) if any(e.body == 0 for e in c.ends)}
    for index, winch in enumerate(robot.winches):
        if touched & set(winch.cables):
            assert np.array_equal(known[:, index], nominal[:, index])
    assert np.sqrt(((known - truth) ** 2).mean()) < np.sqrt(((nominal - truth) ** 2).mean())


def test_a_robot_whose_points_are_late_measures_its_winches_in_time(robot) -> None:
    late: Terms = (Term(NAMED["sensor_latency"], None, (0.055,)),)
    plant = Plant(robot)
    start = plant.settle(1.0)
    controls = RandomControls(robot, 0.01).sequence(plant.winch(start)[0], 90, draws.seed() % 2**31)
    prompt = plant.begin(start).go(controls[None]).observations
    course, winch, points, states = EffectivePlant(plant, late).begin(start), [], [], []
    for piece in np.split(controls, [1, 30, 37]):
        made = course.go(piece[None])
        winch.append(made.observations.winch[0, 1:])
        points.append(made.observations.points[0, 1:])
        states.append(plant.winch(made.states)[0, 1:])
    measured, behind = np.concatenate(winch), np.concatenate(states)
    between = (prompt.winch[0, :-1] + prompt.winch[0, 1:]) / 2
    np.testing.assert_allclose(measured, prompt.winch[0, 1:], atol=2e-3 * robot.length)
    np.testing.assert_allclose(behind[5:], between[:-5], atol=1e-9)
    assert off(measured, behind) > 5e-3 * robot.length
    # Whoever knows of the latency knows where the winches were at the points' time.
    first = plant.winch(start)
    seen = Observation(np.concatenate(points), np.concatenate([first, measured]))
    seen = dataclasses.replace(seen, points=np.concatenate([prompt.points[0, :1], seen.points]))
    known = Reckoning(robot, 0.01, late).known(Trajectory(seen, controls, 0.01))
    np.testing.assert_allclose(known[6:], behind[5:], atol=2e-3 * robot.length)


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_winches_that_slow_down_under_load_are_told_by_what_is_seen(robot, noise) -> None:
    terms = typical("torque_speed", robot, 2.0)
    track, truth = driven(robot, terms, noise)
    known = Reckoning(robot, 0.01, terms).known(track)
    nominal = Reckoning(robot, 0.01).known(track)
    assert off(nominal, truth) > 0.01 * robot.length
    assert off(known, truth) < 0.35 * off(nominal, truth)


def test_without_effects_it_is_the_robots_own_to_the_bit(robot) -> None:
    track, _ = driven(robot, ())
    for terms in ((), typical("slope", robot), typical("winch_gain", robot, 0.0)):
        known = Reckoning(robot, 0.01, terms).known(track)
        seen = track.observations.winch
        assert np.array_equal(known, robot.known_winch(seen, track.controls, 0.01))


def test_what_is_measured_is_taken_and_gone_on_from(robot) -> None:
    terms = typical("winch_gain", robot)
    track, truth = driven(robot, terms)
    winch = track.observations.winch.copy()
    winch[200] = truth[200]
    seen = dataclasses.replace(track.observations, winch=winch)
    known = Reckoning(robot, 0.01, terms).known(dataclasses.replace(track, observations=seen))
    assert np.array_equal(known[200], truth[200])
    assert np.allclose(known[201:], truth[201:], atol=1e-6)


@pytest.mark.slow
def test_pieces_together_are_the_whole(robot) -> None:
    terms = (*typical("command_delay", robot), *typical("torque_speed", robot))
    track, _ = driven(robot, terms)
    reckoning, length = (
        Reckoning(robot, 0.01, terms),
        int(np.random.default_rng(draws.seed()).integers(20, 50)),
    )
    told, points = reckoning.told(track.controls), track.observations.points
    whole = reckoning.known(track)
    together = [whole[:1]]
    for begin in range(0, len(told), length):
        now, end = together[-1][-1], min(begin + length, len(told))
        lengths = reckoning.lengths(points[: end + 1], now, end - begin)
        together.append(reckoning.wound(now, told[begin:end], lengths)[1:])
    difference = np.concatenate(together) - whole
    nominal = Reckoning(robot, 0.01).known(track)
    # How rods turn that nobody sees follows from other winches: of 120 draws, 0.03 times at most.
    assert (difference**2).mean() < 0.2**2 * ((nominal - whole) ** 2).mean(), length


def test_points_out_of_sight_for_a_while_do_no_harm(robot) -> None:
    terms = typical("torque_speed", robot, 2.0)
    track, truth = driven(robot, terms)
    points = track.observations.points.copy()
    points[100:120, 1] = np.nan
    gap = dataclasses.replace(track.observations, points=points)
    known = Reckoning(robot, 0.01, terms).known(dataclasses.replace(track, observations=gap))
    nominal = Reckoning(robot, 0.01).known(track)
    assert off(known, truth) < 0.5 * off(nominal, truth)


def test_the_load_of_bodies_that_are_not_free_cannot_be_told(robot) -> None:
    tied = dataclasses.replace(robot, free=False)
    track, truth = driven(robot, ())
    reckoning = Reckoning(tied, 0.01, typical("torque_speed", robot))
    with pytest.raises(RobotError, match="it has joints"):
        reckoning.known(track)
    measured = dataclasses.replace(track.observations, winch=truth)
    assert np.array_equal(reckoning.known(dataclasses.replace(track, observations=measured)), truth)
