"""Logs that begin in motion, of a robot that is its MJCF exactly and whose winches are not measured."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis.comparison import Comparison, ForecastWindows, Outcome, Subject, compare
from flywheel.diagnosis.comparison.first_lengths import with_first_lengths
from flywheel.diagnosis.comparison.fitted_starts import fitted_starts
from flywheel.diagnosis.settings import Settings, changed
from flywheel.dynamics import Persistence
from flywheel.dynamics.plant import Plant
from flywheel.options import ComparisonOptions
from flywheel.records import Floats, Observation, State, Trajectory
from flywheel.reports.comparison_page import about_lengths, sentence
from flywheel.robots import Robot, load_robot

SWING = Path(__file__).parents[2] / "contracts" / "robots" / "swing.xml"
BEGIN, DT = 300, 0.01  # steps that are driven before a log begins
SIGMA = 3e-4


@pytest.fixture(scope="module")
def swing() -> Robot:
    return load_robot(str(SWING))


def driven(
    robot: Robot, seed: int, faster: float = 1.0, begin: int = BEGIN
) -> tuple[Trajectory, Floats]:
    """The later part of a drive, with unmeasured winches, and where these were (T + 1, W) [m]."""
    rng = np.random.default_rng(seed)
    rates = np.repeat(rng.uniform(-0.09, 0.09, (7, 2)), 100, axis=0)
    plant, home = Plant(robot, DT), robot.keyframe
    start = State(home.qpos[None], home.qvel[None], home.act[None])
    whole = plant.simulate(start, faster * rates[None])
    points = whole.observations.points[0, begin:]
    noisy = points + rng.normal(0.0, SIGMA, points.shape)
    winch = plant.winch(whole.states)[0, begin:]
    seen = Observation(noisy, np.full_like(winch, np.nan))
    return Trajectory(seen, rates[begin:], DT), winch


def found(robot: Robot, log: Trajectory, *models: Subject, fit_starts: bool = False) -> Comparison:
    subjects = models or (Subject.of_plant("plant", Plant(robot, DT)),)
    return compare(subjects, [log], ComparisonOptions(horizon=0.8, draws=40, fit_starts=fit_starts))


def test_a_model_that_is_exact_leaves_noise_only_of_a_log_that_begins_in_motion(swing):
    log, winch = driven(swing, seed=1)
    home = swing.winch_of(swing.keyframe)
    assert np.abs(winch[0] - home).max() > 0.05  # else it would be no test
    answer = found(swing, log)
    assert answer.models[0].outcome is Outcome.NOISE_ONLY, answer.models[0].excess
    begun = answer.windows.begun
    assert begun is not None
    np.testing.assert_allclose(begun[0], winch[0], atol=1e-3)
    np.testing.assert_allclose(answer.windows.moved, np.abs(winch[0] - home), atol=1e-3)
    (words,) = about_lengths(answer)
    assert f"up to {answer.windows.moved.max():.2g} m from the keyframe" in words
    assert answer.summary()["first_lengths"]["fitted"]


def test_winches_that_are_faster_than_told_are_still_more_than_noise(swing: Robot) -> None:
    log, _ = driven(swing, seed=1, faster=1.1)
    answer = found(swing, log, fit_starts=True)
    assert answer.models[0].outcome is Outcome.MORE_THAN_NOISE
    assert answer.models[0].forecast_is_off


def test_a_log_that_begins_at_the_keyframe_has_its_lengths_whatever_the_model_is_worth(swing):
    log, _ = driven(swing, seed=1, faster=-1.0, begin=0)
    answer = found(swing, log)
    assert answer.windows.begun is None
    (words,) = about_lengths(answer)
    assert "taken from the keyframe" in words
    assert not answer.summary()["first_lengths"]["fitted"]


def test_what_was_measured_is_taken_as_it_is(swing: Robot) -> None:
    log, winch = driven(swing, seed=2)
    left = winch.copy()
    left[:, 1] = np.nan
    half = dataclasses.replace(log, observations=Observation(log.observations.points, left))
    windows = ForecastWindows.cut(swing, [half], 0.8, 10)
    (begun,) = with_first_lengths(windows, Plant(swing, DT)).begun
    assert begun[0] == winch[0, 0]
    assert begun[1] == pytest.approx(winch[0, 1], abs=1e-3)
    whole = dataclasses.replace(log, observations=Observation(log.observations.points, winch))
    measured = ForecastWindows.cut(swing, [whole], 0.8, 10)
    assert with_first_lengths(measured, Plant(swing, DT)) is measured
    assert not measured.moved.any()


def test_with_fitted_starts_the_verdict_is_what_they_leave(swing: Robot) -> None:
    log, _ = driven(swing, seed=3)
    still = Subject("still", Persistence(swing, DT))
    plant = Subject.of_plant("plant", Plant(swing, DT))
    answer = found(swing, log, still, plant, fit_starts=True)
    assert answer.models[0].fitted is None
    assert answer.models[0].outcome is Outcome.MORE_THAN_NOISE
    judged = answer.models[1]
    assert judged.fitted is not None and judged.fitted.only_noise
    assert answer.exit_code == 0
    loud = dataclasses.replace(judged, probability=0.01, excess=100.0)
    assert loud.forecast_is_off and loud.outcome is Outcome.NOISE_ONLY
    assert "where it fits best, no more than noise is left" in sentence(answer, loud)
    off = dataclasses.replace(judged, fitted=dataclasses.replace(judged.fitted, only_noise=False))
    assert off.outcome is Outcome.MORE_THAN_NOISE
    assert "where it fits best, more than noise is left" in sentence(answer, off)


def test_fitted_starts_are_judged_by_the_settings_that_are_given(swing: Robot) -> None:
    """Of a log that is three times as noisy as is said, all is tolerated, or nothing."""
    log, _ = driven(swing, seed=3)
    plant = Plant(swing, DT)
    windows = with_first_lengths(ForecastWindows.cut(swing, [log], 0.8, 0), plant)
    windows = dataclasses.replace(windows, sigma=windows.sigma / 3.0)
    squares = np.ones_like(windows.measured)
    usual, tolerant = (
        fitted_starts(plant, windows, squares, 0, settings)
        for settings in (Settings(), changed(Settings(), {"limits.tolerance": 1.0}))
    )
    assert (usual.only_noise, tolerant.only_noise) == (False, True)
    assert usual.noise == tolerant.noise > 4.0
