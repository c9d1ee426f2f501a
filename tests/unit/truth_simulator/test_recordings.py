"""Scripts, measurements, files and the list of cases."""

import csv
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis.cases import Case, cases
from flywheel.errors import ConfigError, UnknownNameError
from flywheel.robots import ROBOTS, Robot, load_robot
from flywheel.truth_simulator import HIDDEN
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record
from flywheel.truth_simulator.scripts import SCRIPTS, script
from tests import draws

SEED = draws.seed()  # fresh; shown when a test fails


@pytest.fixture(scope="module")
def prism3() -> Robot:
    return load_robot("prism3")


@pytest.mark.parametrize("robot_name", ROBOTS)
@pytest.mark.parametrize("name", SCRIPTS)
@pytest.mark.parametrize("dt", [0.01, 0.02])
def test_a_script_keeps_to_the_ranges_and_moves(name: str, robot_name: str, dt: float) -> None:
    robot = load_robot(robot_name)
    controls = script(name, robot, 3.0, dt, np.random.default_rng(SEED))
    again = script(name, robot, 3.0, dt, np.random.default_rng(SEED))
    np.testing.assert_array_equal(controls, again)
    assert controls.shape == (round(3.0 / dt), len(robot.winches)), SEED
    assert (controls >= robot.control_low).all() and (controls <= robot.control_high).all(), SEED
    start = robot.winch_of(robot.keyframe)
    path = robot.dead_reckon(start, controls, dt)
    assert (path >= robot.rest_low).all() and (path <= robot.rest_high).all(), SEED
    assert np.ptp(path, axis=0).max() > 0.02, SEED


def test_an_unknown_script_is_named_with_the_nearest(prism3: Robot) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'slow_sine'"):
        script("slow_sin", prism3, 1.0, 0.01, np.random.default_rng(0))


def test_noise_has_the_size_it_should(prism3: Robot) -> None:
    seen = np.zeros((2000, 6, 3))
    noisy = Measurement(noise=0.003).points(seen, prism3.length, np.random.default_rng(SEED))
    assert noisy.std() == pytest.approx(0.003 * prism3.length, rel=0.03), SEED


@pytest.mark.parametrize("burst", [0.0, 0.1])
def test_markers_are_lost_as_often_and_as_long_as_asked(burst: float) -> None:
    settings = Measurement(noise=0.0, dropout=0.2, burst=burst)
    missing = np.isnan(settings.points(np.zeros((20000, 6, 3)), 1.0, np.random.default_rng(SEED)))
    assert (missing.all(axis=-1) == missing.any(axis=-1)).all()
    gone = missing[..., 0]
    assert gone.mean() == pytest.approx(0.2, rel=0.1), SEED
    begins = (gone[1:] & ~gone[:-1]).sum()
    assert gone.sum() / begins == pytest.approx(max(1.25, burst / 0.01), rel=0.1), SEED


def test_two_markers_are_exchanged_from_some_time_on() -> None:
    seen = np.tile(np.arange(6.0)[None, :, None], (100, 1, 3))
    swapped = Measurement(noise=0.0, swap=True).points(seen, 1.0, np.random.default_rng(SEED))
    wrong = (swapped != seen).any(axis=-1)
    assert set(wrong.sum(axis=1)) == {0, 2}, SEED
    assert (np.diff(wrong.astype(int), axis=0) >= 0).all(), "it stays so"
    np.testing.assert_array_equal(np.sort(swapped, axis=1), seen)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"dropout": 1.0}, "dropout"), ({"noise": -1.0}, "noise"), ({"dt": 0.0}, "dt")],
)
def test_impossible_measurements_are_refused(settings: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Measurement(**settings)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_recording_is_made_again_by_its_seed_and_shares_noise_with_others(prism3: Robot) -> None:
    one = record(prism3, seconds=0.2, seed=SEED)
    two = record(prism3, seconds=0.2, seed=SEED)
    np.testing.assert_array_equal(one.points, two.points)
    effect = HIDDEN["cable_damping"].typical(prism3, np.random.default_rng(0))
    other = record(prism3, [effect], seconds=0.2, seed=SEED)
    np.testing.assert_array_equal(one.controls, other.controls)
    noise, other_noise = one.points - one.true_points, other.points - other.true_points
    np.testing.assert_allclose(noise, other_noise, atol=1e-12)
    assert one.trajectory.steps == 20


@pytest.mark.parametrize("robot_name", ["prism3", "platform4"])
def test_the_files_say_what_was_measured_and_what_was_true(robot_name: str, tmp_path: Path) -> None:
    robot = load_robot(robot_name)
    effect = HIDDEN["payload"].typical(robot, np.random.default_rng(0))
    settings = Measurement(dropout=0.3, winch_noise=0.001)
    made = record(robot, [effect], seconds=0.2, seed=SEED, measurement=settings)
    log, truth = made.write(tmp_path / "new", "one", robot)
    with log.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 21
    sensors = {"prism3": 0, "platform4": 2}[robot_name]
    assert len(rows[0]) == 1 + len(robot.winches) + 3 * len(robot.points) + sensors
    for t, row in enumerate(rows):
        assert float(row["time"]) == pytest.approx(0.01 * t)
        for w, winch in enumerate(robot.winches):
            cell = row[f"ctrl.{winch.name}"]
            assert cell == "" if t == 20 else float(cell) == made.controls[t, w]
        for p, point in enumerate(robot.points):
            for a, axis in enumerate("xyz"):
                cell, value = row[f"{point.name}.{axis}"], made.points[t, p, a]
                assert cell == "" if np.isnan(value) else float(cell) == value
    if sensors:
        assert float(rows[3]["position_rear"]) == made.winch[3, 2]
    told = json.loads(truth.read_text())
    assert told["effects"][0]["place"] == effect.truth(robot).place
    np.testing.assert_array_equal(told["true_points"], made.true_points)


def test_the_list_of_cases_is_stable_and_has_every_effect(prism3: Robot) -> None:
    everything = cases(prism3)
    names = Counter(case.name for case in everything)
    assert max(names.values()) == 1
    assert everything == cases(prism3)
    for name in HIDDEN:
        for size in ("x0.5", "x1", "x2"):
            assert f"prism3.single.{name}.{size}.s0" in names
    few = cases(prism3, groups=("single",), sizes=(2.0,), seeds=(1,))
    assert all(case in everything for case in few)


def test_cases_that_differ_in_size_share_places_and_plans(prism3: Robot) -> None:
    small, large = cases(prism3, ("single",), (0.5, 2.0), (0,))[12:14]
    assert small.effects[0].scaled(4.0) == large.effects[0]
    assert (small.fit, small.held_out) == (large.fit, large.held_out)


def test_a_messy_robot_is_the_same_at_each_size_of_what_is_hidden(prism3: Robot) -> None:
    small, large = cases(prism3, ("messy-single",), (1.0, 2.0), (0,))[:2]
    twice = cases(prism3, ("messy-single",), (1.0,), (0,), spread=2.0)[0]
    (plain,) = cases(prism3, ("messy-none",), seeds=(0,))
    assert small.built and large.built and twice.built and plain.built
    np.testing.assert_array_equal(small.built.moved, large.built.moved)
    np.testing.assert_array_equal(2 * small.built.moved, twice.built.moved)
    assert np.abs(small.built.moved - plain.built.moved).max() > 0
    made = replace(plain, fit=(replace(plain.held_out, seconds=0.1),)).record(prism3)
    assert made.fit[0].effects == (), "how a robot was built is no answer"


def test_no_case_is_about_an_effect_that_cannot_be_felt() -> None:
    named = " ".join(case.name for case in cases(load_robot("platform4")))
    assert "ground_friction" not in named and "slope" in named


@pytest.mark.slow
def test_a_case_makes_three_recordings_with_one_truth(prism3: Robot) -> None:
    case: Case = cases(prism3, ("hard",), seeds=(0,))[0]
    made = case.record(prism3)
    assert len(made.fit) == 2
    every = (*made.fit, made.held_out)
    assert len({one.script for one in every}) == len({one.seed for one in every}) == 3
    assert all(one.effects == made.held_out.effects for one in every)
    assert 0.1 < np.isnan(made.held_out.points).mean() < 0.3


def test_a_case_of_another_robot_and_an_unknown_group_are_refused(prism3: Robot) -> None:
    with pytest.raises(ConfigError, match="is about prism3, got platform4"):
        cases(prism3, ("none",))[0].record(load_robot("platform4"))
    with pytest.raises(UnknownNameError, match="Known: forms, hard, messy-none"):
        cases(prism3, ("easy",))  # type: ignore[arg-type]
