"""Tensions and lengths of cables tell where winches are that nobody measures."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.dynamics.plant import AugmentedPlant, Plant, Reckoning
from flywheel.effects import NAMED, Term, Terms
from flywheel.records import Episode, Floats, MeasuredChannel, Observation, Provenance, Trajectory
from flywheel.robots import Robot, load_robot
from flywheel.runtime.workers.stored_episodes import EpisodeWinches
from tests import draws

DT, STEPS, POINT = 0.01, 300, 0.001  # [s], 3 s, noise of a point [m]
NOISE = {
    "platform4": 2.0,
    "prism3": 20.0,
}  # of tensions of hundreds and of thousands of newtons [N]
SLOW: Terms = (Term(NAMED["winch_gain"], None, (-0.1,)),)


def logged(
    robot: Robot, terms: Terms = SLOW, noise: float = 1.0, reach: float = 1.0
) -> tuple[Trajectory, Floats, Floats]:
    """A log with load cells of every cable, true winch positions, and true tensions (T + 1, C)."""
    rng = np.random.default_rng(draws.seed())
    cables = [cable.name for cable in robot.cables]
    kinds = [("tension", name) for name in cables] + [("length", name) for name in cables]
    plant = AugmentedPlant(Plant(robot, DT), kinds)  # type: ignore[arg-type]
    start = plant.plant.settle(1.0)
    home = plant.plant.winch(start)[0]
    told = RandomControls(robot, DT).sequence(home, STEPS, int(rng.integers(2**31)))
    told = robot.holding(home) + reach * (told - robot.holding(home))
    motion = plant.simulate(start, plant.commands(told[None], [terms]), [terms], steps=STEPS)
    sigma = noise * NOISE[robot.name]
    values = motion.channels[0].T
    channels = tuple(
        MeasuredChannel("tension", name, pull + sigma * rng.normal(size=STEPS + 1), sigma)
        for name, pull in zip(cables, values[: len(cables)], strict=True)
    ) + tuple(
        MeasuredChannel("length", name, length, 1e-4)
        for name, length in zip(cables, values[len(cables) :], strict=True)
    )
    points = motion.points[0] + rng.normal(0, noise * POINT, motion.points[0].shape)
    truth = plant.plant.winch(motion.states)[0]
    track = Trajectory(Observation(points, np.full_like(truth, np.nan)), told, DT)
    return replace(track, channels=channels), truth, values[: len(cables)].T


def with_channels(track: Trajectory, kind: str) -> Trajectory:
    return replace(track, channels=tuple(c for c in track.channels if c.kind == kind))


def rms(off: Floats) -> float:
    return float(np.sqrt((off**2).mean()))


def taut_for_long(robot: Robot, tension: Floats) -> np.ndarray:
    """(T + 1, W) bool: winches whose cable followed its law for the last 0.2 s."""
    pull = tension[:, [w.cables[0] for w in robot.winches]]
    taut = (pull > 10.0 * NOISE[robot.name]) & (pull < 0.95 * robot.cables[0].strongest)
    long = np.array([taut[max(0, t - 20) : t + 1].all(axis=0) for t in range(len(taut))])
    long[:20] = False
    return long


@pytest.mark.parametrize("name", ["platform4", "prism3"])
def test_load_cells_tell_where_winches_are_that_do_not_go_where_they_are_told(name) -> None:
    robot = load_robot(name)
    track, truth, tension = logged(robot)
    track = with_channels(track, "tension")
    known = Reckoning(robot, DT).known(track)
    blind = Reckoning(robot, DT).known(replace(track, channels=()))
    taut = taut_for_long(robot, tension)
    assert taut.mean() > 0.1
    assert rms((blind - truth)[taut]) > 0.01
    assert rms((known - truth)[taut]) < 3.0 * POINT
    assert rms(known - truth) < 0.7 * rms(blind - truth)


def test_without_noise_a_taut_cable_tells_its_winch_to_the_law_of_the_cable() -> None:
    robot = load_robot("platform4")
    track, truth, tension = logged(robot, noise=1e-3)
    known = Reckoning(robot, DT).known(track)
    taut = taut_for_long(robot, tension)
    stretch = tension.max() / robot.cables[0].stiffness
    assert stretch > 0.01
    assert rms((known - truth)[taut]) < 0.03 * stretch


def test_winches_that_go_where_they_are_told_are_not_moved_by_more_than_noise() -> None:
    robot = load_robot("prism3")
    track, truth, _ = logged(robot, ())
    known = Reckoning(robot, DT).known(with_channels(track, "tension"))
    assert rms(known - truth) < 1.5 * POINT


@pytest.mark.parametrize("pull", [0.0, 2000.0], ids=["slack", "at the limit of its winch"])
def test_a_cable_that_does_not_follow_its_law_tells_nothing(pull: float) -> None:
    """A slack one may be of any length, and at its limit a winch pulls less than the cable's law."""
    robot = load_robot("platform4")
    assert {cable.strongest for cable in robot.cables} == {2000.0}
    track, _, _ = logged(robot)
    noise = np.random.default_rng(draws.seed()).normal(0, NOISE["platform4"], STEPS + 1)
    reckoning, cells = Reckoning(robot, DT), with_channels(track, "tension").channels
    for first in (0, STEPS // 2):
        later = np.arange(STEPS + 1) >= first
        silent = tuple(replace(c, values=np.where(later, np.nan, c.values)) for c in cells)
        useless = tuple(replace(c, values=np.where(later, pull + noise, c.values)) for c in cells)
        found, wanted = (reckoning.known(replace(track, channels=c)) for c in (useless, silent))
        np.testing.assert_array_equal(found, wanted)


def test_a_measured_length_stands_in_for_points_that_nobody_saw() -> None:
    robot = load_robot("prism3")
    track, truth, tension = logged(robot)
    lost = replace(track.observations, points=np.full_like(track.observations.points, np.nan))
    hidden = replace(track, observations=lost)
    taut = taut_for_long(robot, tension)
    known = Reckoning(robot, DT).known(hidden)
    assert rms((known - truth)[taut]) < POINT
    blind = Reckoning(robot, DT).known(with_channels(hidden, "tension"))
    np.testing.assert_array_equal(blind, Reckoning(robot, DT).known(replace(hidden, channels=())))


def test_points_that_are_late_are_put_together_with_the_tensions_of_their_time() -> None:
    robot = load_robot("platform4")
    late: Terms = (*SLOW, Term(NAMED["sensor_latency"], None, (0.05,)))
    track, truth, tension = logged(robot, late)
    known = Reckoning(robot, DT, late[1:]).known(with_channels(track, "tension"))
    early = np.concatenate([np.repeat(tension[:1], 5, axis=0), tension[:-5]])
    taut = taut_for_long(robot, early)
    assert rms((known - truth)[taut]) < 3.0 * POINT


def test_training_and_scoring_of_a_recording_know_these_positions() -> None:
    robot = load_robot("prism3")
    track, truth, tension = logged(robot)
    episode = Episode("e", track, Provenance(robot.digest, "recording"), "train")
    taut = taut_for_long(robot, tension)
    assert rms((EpisodeWinches(robot)(episode) - truth)[taut]) < 3.0 * POINT
