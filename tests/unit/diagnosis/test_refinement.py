"""Steps as short as the contacts of a window ask for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import fitted, fitted_and_refined, fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.refinement import in_other_steps, shorter_steps
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.selection.stepwise import _fitted_in_turn, stepwise
from flywheel.diagnosis.settings import FittingSettings, RefinementSettings
from flywheel.dynamics.plant import (
    AugmentedPlant,
    EffectivePlant,
    MeasurementModel,
    Plant,
    hasty,
    refined,
)
from flywheel.effects import EFFECTS, Scales, Term, Terms
from flywheel.records import Observation, State, Trajectory
from flywheel.robots import Robot

SECONDS, NOISE = 0.8, 0.001
FALLS = 1
TOLERATED = RefinementSettings()
TIMES = 8  # shorter steps are what is taken for the truth


def fallen(robot: Robot, seed: int, times: int, terms: Terms = ()) -> Trajectory:
    """A robot that is thrown to the ground, as measured, simulated in steps so many times shorter."""
    rng, own = np.random.default_rng(seed), Plant(robot)
    augmented = AugmentedPlant(refined(own, times) if times > 1 else own)
    rest = own.settle(1.0)
    qpos, qvel = rest.qpos.copy(), rest.qvel.copy()
    qpos.reshape(-1, 7)[:, 2] += 0.2 * robot.length
    qvel.reshape(-1, 6)[:, :3] += [*rng.normal(0.0, 0.5, 2), -2.0]
    still = np.zeros((1, round(SECONDS / own.dt), len(robot.winches)))
    motion = augmented.simulate(State(qpos, qvel, rest.act), still, [terms])
    blind = np.full((motion.points.shape[1], len(robot.winches)), np.nan)
    seen = MeasurementModel(noise=NOISE).apply(Observation(motion.points[0], blind), robot, rng)
    return Trajectory(seen, still[0], own.dt)


def fitter_for(robot: Robot, seed: int, times: int, falls: int = FALLS) -> PlantFitter:
    logs = [fallen(robot, seed + i, times) for i in range(falls)]
    windows = Windows.cut(robot, logs, seconds=0.4, sigma=NOISE * robot.length)
    return fitter_of(windows, Plant(robot))


def test_every_window_is_simulated_in_its_own_steps(robot: Robot, seed: int) -> None:
    fitter = fitter_for(robot, seed, 1)
    fit, own = fitter.first_estimate(), fitter.simulator
    members = np.arange(len(fitter.windows))
    halved = members % 2 == seed % 2
    mixed, finer = own.halved(halved), own.halved()
    with_own, with_finer, with_both = (
        each.parallel(fit.initial.mechanics, fit.carried, (), members)
        for each in (own, finer, mixed)
    )
    assert np.array_equal(with_both[halved], with_finer[halved])
    assert np.array_equal(with_both[~halved], with_own[~halved])
    assert not np.array_equal(with_own[halved], with_finer[halved])
    assert mixed.fineness.tolist() == [2 if each else 1 for each in halved]


def test_a_plant_with_winches_that_no_robot_may_have_is_still_refined(robot: Robot) -> None:
    spec = mujoco.MjSpec.from_string(robot.xml)
    for winch in spec.actuators:
        winch.biasprm[0] = -0.01 * winch.gainprm[0]  # as fitted: every cable a little too long
    robot = replace(robot, integrator="implicitfast")  # whose steps are not hasty ones
    plant = Plant(replace(robot, xml=spec.to_xml()))
    own, finer, rough, without = (
        each.settle(0.1).qpos for each in (plant, refined(plant), hasty(plant), Plant(robot))
    )
    slack = np.abs(own - without).max()
    for each in (finer, rough):
        assert 0.0 < np.abs(each - own).max() < 0.5 * slack


@pytest.mark.slow
def test_steps_are_halved_where_a_fall_asks_for_it(robot: Robot, seed: int) -> None:
    own = fitter_for(robot, seed, TIMES)
    fitter, fit = fitted_and_refined(own, own.first_estimate())
    shorter = fitter.time_steps < robot.timestep
    assert shorter.any(), seed
    before, after = own.mean_squares(fitted(own))[shorter], fitter.mean_squares(fit)[shorter]
    assert after.mean() < 0.97 * before.mean(), seed


@pytest.mark.slow
def test_steps_are_asked_for_again_once_there_is_a_model(robot: Robot, seed: int) -> None:
    own = fitter_for(robot, seed, TIMES)
    before = own.fit(own.first_estimate())
    search, (after,) = _fitted_in_turn(Search(own, ()), [before])
    shorter = search.fitter.time_steps < robot.timestep
    assert shorter.any(), seed
    assert own.time_steps.tolist() == [robot.timestep] * FALLS * 2
    assert after.cost < before.cost, seed
    again = search.fitter.with_terms(after, after.terms)
    np.testing.assert_allclose(again.cost, after.cost, rtol=1e-9)  # it is a fit of the new fitter


@pytest.mark.slow
def test_models_are_compared_in_the_time_steps_that_the_first_one_asks_for(
    robot: Robot, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = fitter_for(robot, seed, TIMES)
    first = own.fit(own.first_estimate())
    other = own.fit(own.with_terms(first, (Term(EFFECTS["winch_gain"], None, (0.05,)),)), rounds=1)
    begun: list[tuple[Fitter, Fit]] = []  # the best one may ask for shorter steps once more

    def fit_until(search: Search, fit: Fit, *_: float, **__: float) -> Fit:
        begun.append((search.fitter, fit))
        return fit

    monkeypatch.setattr(Search, "fit_until", fit_until)
    _fitted_in_turn(Search(own, ()), [first, other])
    for fitter, fit in begun[:2]:
        assert (fitter.time_steps < robot.timestep).any(), seed
        again = fitter.with_terms(fit, fit.terms)
        np.testing.assert_allclose(again.cost, fit.cost, rtol=1e-9)  # a fit of the new fitter
    assert {len(fit.terms) for _, fit in begun[:2]} == {0, 1}, seed


@pytest.mark.slow
def test_recordings_of_the_plant_itself_keep_its_steps(robot: Robot, seed: int) -> None:
    own = fitter_for(robot, seed, 1)
    fitter, fit = fitted_and_refined(own, own.first_estimate())
    # Should shorter ones fit by chance, then as well.
    assert (fitter.time_steps == robot.timestep).all() or fit.cost < 1.02 * fitted(own).cost, seed
    assert fitter.mean_squares(fit).mean() < 1.2, seed


class Costs:
    """Stands in for a fitter of one window whose fits cost this, one after the other."""

    settings = FittingSettings()

    def __init__(self, *costs: float, shorter: "Costs | None" = None) -> None:
        self.left, self.shorter = list(costs), shorter
        self.time_steps = np.array([1.0 if shorter is None else 2.0])

    def finer(self, *_: object) -> "Costs | None":
        return self.shorter

    def with_terms(self, fit: Fit, _: object) -> Fit:
        return replace(fit, cost=self.left.pop(0), converged=False)

    def fit(self, fit: Fit, *_: object, **__: object) -> Fit:
        return self.with_terms(fit, ())


@pytest.mark.parametrize(
    ("costs", "wins"),
    [
        ((5000.0, 1100.0, 1050.0, 1020.0, 990.0), True),  # a bad beginning is not held against it
        ((5000.0, 1100.0, 1050.0), False),  # two rounds like the last one are just not enough
        ((np.inf, np.inf), False),
    ],
)
def test_shorter_steps_win_if_they_get_ahead_while_there_is_hope(fitter, costs, wins):
    ahead = 949.0 if len(costs) == 3 else 1000.0
    finer = Costs(*costs)
    own = Costs(2000.0, 1500.0, shorter=finer)
    fit = replace(fitter.first_estimate(), cost=ahead, converged=True)
    taken, after = shorter_steps(own, fit)
    assert (taken is finer) == wins
    assert after.cost == (costs[-1] if wins else ahead)
    assert not finer.left


def test_longer_steps_win_if_they_fit_better_from_where_shorter_ones_led_to(fitter):
    own = Costs(2000.0, 900.0, shorter=Costs(5000.0, 990.0))
    stuck = replace(fitter.first_estimate(), cost=1000.0, converged=True)
    taken, after = shorter_steps(own, stuck)
    assert taken is own and after.cost == 900.0


@pytest.mark.nightly
@pytest.mark.slow
def test_better_initial_states_found_in_shorter_steps_are_no_evidence_for_them(robot):
    own = fitter_for(
        robot, 2622254124, 1, falls=3
    )  # a fit gets stuck where one in shorter steps does not
    fitter, fit = fitted_and_refined(own, own.first_estimate())
    assert (fitter.time_steps == robot.timestep).all()
    assert fit.cost < 1.02 * fitted(own).cost


@pytest.fixture
def before_nothing(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What is tolerated where shorter steps are asked for before nothing is said.

    Ones that fit no better might not be taken; here they are, for all windows.
    """
    asked: list[float] = []

    def shorter(
        own: PlantFitter, fit: Fit, _: object, tolerated: float | None = None
    ) -> tuple[PlantFitter, Fit]:
        if tolerated is None:
            return own, fit
        asked.append(tolerated)
        everywhere = np.ones(len(own.windows), bool)
        finer = own.halved(everywhere)
        return finer, in_other_steps(finer, fit, everywhere)

    monkeypatch.setattr("flywheel.diagnosis.selection.stepwise.shorter_steps", shorter)
    return asked


def search_of(robot: Robot, seed: int, plant: Plant, terms: Terms = ()) -> Search:
    """For a fall whose noise is said to be so loud that the plant's own steps will do."""
    log = fallen(robot, seed, TIMES, terms)
    windows = Windows.cut(robot, [log], seconds=0.4, sigma=5.0 * NOISE * robot.length)
    return Search(fitter_of(windows, plant), candidates(robot, {"slope": EFFECTS["slope"]}))


@pytest.mark.slow
def test_before_nothing_is_said_steps_are_shorter_than_a_fit_needs(robot, seed, before_nothing):
    search = search_of(robot, seed, Plant(robot))
    own = search.fitter
    fit = own.fit(own.first_estimate())
    assert own.finer(fit, TOLERATED.tolerated) is None, seed
    search, (model,) = stepwise(search, search.score_all(fit))
    assert before_nothing == [TOLERATED.tolerated_by_nothing], seed
    assert (search.fitter.time_steps < robot.timestep).all(), seed
    again = search.fitter.with_terms(model.fit, ())
    np.testing.assert_allclose(again.cost, model.fit.cost, rtol=1e-9)  # a fit of the new fitter


@pytest.mark.slow
def test_a_plant_whose_effect_has_another_value_is_still_asked_about_it_in_shorter_steps(
    robot: Robot, seed: int, before_nothing: list[float]
) -> None:
    effect = EFFECTS["cable_damping"]
    had, has = (
        (Term(effect, None, (times * effect.sizes[0].typical(Scales.of(robot)),)),)
        for times in (1.0, 4.0)
    )
    search = search_of(robot, seed, EffectivePlant(Plant(robot), had), has)
    own = search.fitter
    fit = own.fit(own.first_estimate(had))
    search, (first, *_, last) = stepwise(search, search.score_all(fit))
    assert before_nothing == [TOLERATED.tolerated_by_nothing], seed
    assert (search.fitter.time_steps < robot.timestep).all(), seed
    assert first.fit.terms == had, seed
    assert last.fit.terms[0].values == pytest.approx(has[0].values, rel=0.2), seed
