"""Fits of initial states that do not converge, and what is made of them."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flywheel.diagnosis.comparison import ForecastWindows, Outcome, Subject, compare
from flywheel.diagnosis.comparison.fitted_starts import fitted_starts
from flywheel.diagnosis.comparison.result import EXIT_CODES
from flywheel.diagnosis.fitting.model import fitted
from flywheel.diagnosis.settings import FittingSettings
from flywheel.dynamics.plant import Plant
from flywheel.options import ComparisonOptions
from flywheel.records import Floats, Observation, State, Trajectory
from flywheel.reports.comparison_page import sentence
from flywheel.robots import Robot, load_robot

SWING = Path(__file__).parents[2] / "contracts" / "robots" / "swing.xml"
DT, SIGMA, HORIZON = 0.01, 3e-4, 0.8


@pytest.fixture(scope="module")
def swing() -> Robot:
    return load_robot(str(SWING))


def measured(robot: Robot, faster: float = 1.0, shaken: float = 0.0) -> Trajectory:
    """A drive with measured winches, `faster` than told, and shaken by hand in the last seconds."""
    rng = np.random.default_rng(0)
    rates = np.repeat(rng.uniform(-0.09, 0.09, (4, 2)), 100, axis=0)
    plant, home = Plant(robot, DT), robot.keyframe
    start = State(home.qpos[None], home.qvel[None], home.act[None])
    whole = plant.simulate(start, faster * rates[None])
    points = whole.observations.points[0]
    points = points + rng.normal(0.0, SIGMA, points.shape)
    count = round(shaken / DT)
    if count:
        points[-count:, :, 1] += 0.05 * np.sin(np.arange(count) * 0.4)[:, None]
    return Trajectory(Observation(points, plant.winch(whole.states)[0]), rates, DT)


def windows_of(robot: Robot, log: Trajectory) -> ForecastWindows:
    return ForecastWindows.cut(robot, [log], HORIZON, 10)


def squares(windows: ForecastWindows, of_all: float) -> Floats:
    """Errors of predictions that are equally good everywhere."""
    return np.full_like(windows.measured, of_all)


def test_a_window_whose_fit_ends_far_above_unfitted_starts_is_left_out(swing: Robot) -> None:
    log = measured(swing, shaken=HORIZON)
    windows = windows_of(swing, log)
    good, bad = (
        fitted_starts(Plant(swing, DT), windows, squares(windows, size), 0) for size in (1.0, 1e6)
    )
    assert (good.left_out, good.windows, good.converged) == (1, 5, True)
    assert good.only_noise and good.noise == pytest.approx(1.0, abs=0.1)
    assert bad.left_out == 0 and not bad.only_noise  # the predictions are as bad: so is the model


def test_where_most_fits_end_far_above_unfitted_starts_nothing_is_said(swing: Robot) -> None:
    log = measured(swing, shaken=3.5)
    windows = windows_of(swing, log)
    found = fitted_starts(Plant(swing, DT), windows, squares(windows, 1.0), 0)
    assert found.left_out > found.windows / 2 and not found.converged
    plant = Subject.of_plant("plant", Plant(swing, DT))
    answer = compare([plant], [measured(swing)], ComparisonOptions(horizon=HORIZON, draws=40))
    lost = dataclasses.replace(answer.models[0], fitted=found)
    assert lost.outcome is Outcome.NOT_CONVERGED
    assert dataclasses.replace(answer, models=(lost,)).exit_code == EXIT_CODES[lost.outcome] == 21
    assert f"Fits of {found.left_out} of {found.windows} windows did not" in sentence(answer, lost)


def test_fitted_starts_are_no_worse_than_unfitted_ones_where_winches_are_not_as_told(swing):
    log = measured(swing, faster=1.3)
    plant = Subject.of_plant("plant", Plant(swing, DT))
    answer = compare([plant], [log], ComparisonOptions(horizon=HORIZON, draws=40, fit_starts=True))
    (judged,) = answer.models
    assert judged.fitted is not None
    assert judged.outcome is Outcome.MORE_THAN_NOISE
    assert judged.fitted.rms < judged.rms * answer.windows.sigma


def test_a_fit_goes_on_as_long_as_rounds_take_away_a_good_part_of_the_cost() -> None:
    costs = [1e6 * 0.5**n for n in range(9)] + [3800.0]  # half in each round, then hardly anything

    def step(begun: SimpleNamespace, rounds: int = 8, enough: float = 0.0) -> SimpleNamespace:
        done = min(begun.done + rounds, len(costs) - 1)
        return SimpleNamespace(done=done, cost=costs[done], converged=False)

    fitter = SimpleNamespace(
        settings=FittingSettings(),
        first_estimate=lambda terms: SimpleNamespace(done=0, cost=costs[0], converged=False),
        restarted=lambda begun, restart: begun,
        fit=step,
    )
    assert fitted(fitter).done == len(costs) - 1  # type: ignore[arg-type]
