import dataclasses
from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.control import Mppi, MppiConfig
from flywheel.control.gaits import turning
from flywheel.control.knots import Knots
from flywheel.control.mppi import smooth_noise, softmin, strokes
from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.errors import ConfigError, ModelError
from flywheel.records import Observation, Past, Rollout
from flywheel.robots import load_robot
from flywheel.tasks import Task
from tests import draws

SMALL = {"samples": 16, "horizon_seconds": 2.0}


def planner(gantry, task: Task | None, seed: int = 0, **changes) -> Mppi:
    mppi = Mppi(gantry, MppiConfig(**(SMALL | changes)))
    mppi.reset(task, seed)
    return mppi


def followed(past: Past, gantry, controls: np.ndarray) -> Past:
    after = gantry.rollout(past, controls[None])
    winch = after.winch[:, -1:]
    return Past(
        Observation(after.points[:, -1:], np.full_like(winch, np.nan)), past.controls, winch
    )


def test_a_plan_that_begins_later_is_one_from_where_pending_commands_lead(gantry, task, past):
    pending = np.full((20, len(gantry.robot.winches)), 0.3) * gantry.robot.control_high
    later = dataclasses.replace(past, pending=pending[None])
    there = followed(past, gantry, pending)
    unaware, ahead, direct = (
        planner(gantry, task, temperature=1.0).act(each) for each in (past, later, there)
    )
    assert not np.allclose(unaware.controls, direct.controls, atol=1e-3)
    np.testing.assert_allclose(ahead.controls, direct.controls, atol=1e-9)
    assert direct.tail is not None and ahead.tail is not None
    assert len(direct.tail) + len(direct.controls) == 20  # 2 s


def test_weights_sum_to_one_and_fall_with_cost() -> None:
    rng = np.random.default_rng(seed := draws.seed())
    costs = rng.normal(size=40)
    weights = softmin(costs, 0.7)
    assert weights.sum() == pytest.approx(1.0), seed
    assert (np.diff(weights[np.argsort(costs)]) <= 0).all(), seed
    ratio = np.exp(-(costs[3] - costs[8]) / 0.7)
    assert weights[3] / weights[8] == pytest.approx(ratio), seed


def test_weights_do_not_change_when_all_costs_rise_alike() -> None:
    costs = np.random.default_rng(draws.seed()).normal(size=40)
    np.testing.assert_allclose(softmin(costs + 1e3, 0.2), softmin(costs, 0.2), rtol=1e-9)


def test_relative_weights_do_not_change_with_the_scale_of_the_costs() -> None:
    costs = np.random.default_rng(draws.seed()).normal(size=40)
    np.testing.assert_allclose(softmin(1e4 * costs, 0.2, True), softmin(costs, 0.2, True))
    assert not np.allclose(softmin(1e4 * costs, 0.2), softmin(costs, 0.2))


def test_a_cold_planner_takes_the_best_and_a_hot_one_the_mean() -> None:
    costs = np.random.default_rng(draws.seed()).normal(size=40)
    np.testing.assert_allclose(softmin(costs, 1e-9), np.eye(40)[costs.argmin()])
    np.testing.assert_allclose(softmin(costs, 1e12), np.full(40, 1 / 40), rtol=1e-6)


@pytest.mark.parametrize("relative", [True, False])
def test_equal_costs_weigh_equally_and_infinite_ones_nothing(relative: bool) -> None:
    np.testing.assert_allclose(softmin(np.full(8, 3.0), 0.1, relative), np.full(8, 1 / 8))
    assert softmin(np.array([1.0, np.inf, 1.0]), 0.1, relative).tolist() == [0.5, 0, 0.5]
    with pytest.raises(ModelError, match="None of 2 costs"):
        softmin(np.full(2, np.inf), 0.1, relative)


def test_smooth_noise_has_unit_variance_and_the_correlation_asked_for() -> None:
    noise = smooth_noise((20000, 4, 2), 0.6, np.random.default_rng(draws.seed()))
    np.testing.assert_allclose(noise.var(axis=0), 1.0, atol=0.06)
    for lag in (1, 2, 3):
        both = (noise[:, lag] * noise[:, 0]).mean(axis=0)
        np.testing.assert_allclose(both, 0.6**lag, atol=0.04)


def test_strokes_stay_for_as_long_as_they_are_held() -> None:
    drawn = strokes((500, 8, 3), 3, np.random.default_rng(draws.seed()))
    assert drawn.shape == (500, 8, 3)
    assert set(np.unique(drawn)) == {0.0, 0.5, 1.0}
    changes = (np.diff(drawn, axis=1) != 0).any(axis=2)
    assert (changes.sum(axis=1) <= 3).all()
    assert not (changes[:, :-1] & changes[:, 1:]).any()
    assert strokes((0, 8, 3), 3, np.random.default_rng(0)).shape == (0, 8, 3)


def test_gaits_that_turn_are_among_the_candidates_and_turn_the_robot() -> None:
    prism3, rng = load_robot("prism3"), np.random.default_rng(draws.seed())
    plans = turning(prism3, (12, 18, 6), 3, rng)
    assert (np.diff(plans, axis=1) != 0).any(axis=2).sum(axis=1).max() <= 6
    plant = Plant(prism3)
    knots, lying = Knots(prism3, plant.dt, 50, 18), plant.settle(4.0)
    winch = plant.observe(lying).winch[0]
    points = plant.simulate(lying, knots.controls(winch, plans)).observations.points
    along = points[:, [0, -1], 1, :2] - points[:, [0, -1], 0, :2]
    before, after = np.moveaxis(np.arctan2(along[..., 1], along[..., 0]), 1, 0)
    assert np.abs(np.angle(np.exp(1j * (after - before)))).max() > 0.3
    with pytest.raises(ConfigError, match="gaits are for prism3"):
        Mppi(PlantDynamics(Plant(load_robot("platform4"))), MppiConfig(turning=0.1))


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_share_of_the_samples_turns(share: float) -> None:
    prism3 = load_robot("prism3")
    mppi = Mppi(PlantDynamics(Plant(prism3)), MppiConfig(turning=share, fresh=0.5))
    middle = np.full((mppi.knots.count, 6), (prism3.rest_low + prism3.rest_high) / 2)
    candidates = mppi._candidates(middle, 0.3)
    held = (np.diff(candidates[-14:], axis=1) == 0).all(axis=2).any(axis=1)
    assert len(candidates) == 48 and held.all() == (share > 0) and held.any() == (share > 0)


def test_it_brings_the_gantry_to_its_goal(gantry, task: Task, past: Past) -> None:
    mppi = planner(gantry, task, seed=draws.seed())
    distances = []
    for _ in range(20):
        past = followed(past, gantry, mppi.act(past).controls)
        distances.append(float(task.distance(past.observations.points[0, -1])))
    assert min(distances) <= task.tolerance
    assert distances[-1] <= 2 * task.tolerance


def test_more_rounds_find_cheaper_plans(gantry, task: Task, past: Past) -> None:
    def best(rounds: int) -> float:
        found = [
            float(planner(gantry, task, seed, rounds=rounds, fresh=0.0)
                  .act(past).diagnostics["best_cost"])
            for seed in range(10)
        ]  # fmt: skip
        return float(np.mean(found))

    assert best(4) < best(1)


def test_the_same_seed_gives_the_same_commands(gantry, task: Task, past: Past) -> None:
    seed = draws.seed()
    mppi = planner(gantry, task, seed)
    first = [mppi.act(past).controls for _ in range(3)]
    mppi.reset(task, seed)
    again = [mppi.act(past).controls for _ in range(3)]
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], planner(gantry, task, seed + 1).act(past).controls)


def test_the_last_plan_is_always_tried_again(gantry, task: Task, past: Past) -> None:
    tried = []

    class Spy(type(gantry)):
        def rollout(self, past: Past, controls: np.ndarray) -> Rollout:
            tried.append(controls)
            return super().rollout(past, controls)

    mppi = planner(Spy(gantry.robot), task)
    mppi.act(past)
    plan = mppi._plan
    mppi.act(past)
    knots, winch = mppi.knots, past.winch[0, -1]
    np.testing.assert_allclose(tried[0][0], 0.0, atol=1e-12)  # at first, holding still
    expected = knots.controls(winch, knots.later(plan, 5))
    np.testing.assert_allclose(tried[1][0], expected, atol=1e-9)


def test_it_commands_the_beginning_of_its_plan(gantry, task: Task, past: Past) -> None:
    mppi = planner(gantry, task, replan_seconds=0.7, knot_seconds=0.4)
    command = mppi.act(past)
    assert command.controls.shape == (7, len(gantry.robot.winches))
    whole = mppi.knots.controls(past.winch[0, -1], mppi._plan)
    np.testing.assert_array_equal(command.controls, whole[:7])
    assert command.plan_seconds > 0


def test_diagnostics_show_the_best_sample(gantry, task: Task, past: Past) -> None:
    shown = planner(gantry, task).act(past).diagnostics
    assert shown["points"].shape == (21, 6, 3)
    assert task.cost(shown["points"][None]) == pytest.approx(shown["best_cost"])
    assert shown["best_cost"] <= shown["mean_cost"]
    assert 1 <= shown["effective_samples"] <= 16


class Broken:
    """A gantry whose first `share` of the rollouts are not finite."""

    def __init__(self, gantry, share: float) -> None:
        self.gantry, self.share = gantry, share
        self.robot, self.dt, self.history = gantry.robot, gantry.dt, 0

    def rollout(self, past: Past, controls: np.ndarray) -> Rollout:
        whole = self.gantry.rollout(past, controls)
        whole.points[: round(self.share * len(controls)), -1, 0, 0] = np.nan
        return whole


def test_rollouts_that_are_not_finite_weigh_nothing(gantry, task: Task, past: Past) -> None:
    mppi = planner(Broken(gantry, 0.5), task)
    for _ in range(3):
        command = mppi.act(past)
        assert np.isfinite(command.controls).all()
        assert np.isfinite(command.diagnostics["mean_cost"])


def test_ways_that_lead_to_the_goal_are_shown_from_the_best_one_on(gantry, task, past) -> None:
    mppi = planner(Broken(gantry, 0.4), task, draws.seed())
    paths = mppi.act(past).diagnostics["paths"]
    assert paths.shape == (12, mppi.knots.count + 1, 2)
    assert np.isfinite(paths).all()
    np.testing.assert_allclose(
        paths[:, 0], task.place(past.observations.points[:, -1]).repeat(12, 0)
    )
    left = np.linalg.norm(paths - task.goal, axis=-1).sum(axis=1)
    assert left[:4].mean() < left[-4:].mean()


def test_no_finite_rollout_is_an_error(gantry, task: Task, past: Past) -> None:
    with pytest.raises(ModelError, match="None of 16 rollouts"):
        planner(Broken(gantry, 1.0), task).act(past)


def test_a_cost_that_is_not_a_number_counts_as_infinite(gantry, task: Task, past: Past) -> None:
    def some_nan(points: np.ndarray, task: Task) -> np.ndarray:
        return np.where(np.arange(len(points)) % 2, np.nan, 0.0)

    odd = dataclasses.replace(task, costs=(*task.costs, some_nan))
    assert np.isfinite(planner(gantry, odd).act(past).controls).all()
    none = dataclasses.replace(task, costs=(lambda points, task: np.full(len(points), np.nan),))
    with pytest.raises(ModelError, match="costs is finite"):
        planner(gantry, none).act(past)


def test_planning_without_a_task_is_refused(gantry, past: Past) -> None:
    with pytest.raises(ConfigError, match="needs a task"):
        planner(gantry, None).act(past)


def test_times_that_the_model_cannot_step_are_refused(gantry) -> None:
    with pytest.raises(ConfigError, match=r"knot_seconds must be a multiple of the model's 0.1 s"):
        Mppi(gantry, MppiConfig(knot_seconds=0.25))


@pytest.mark.parametrize(
    "wrong",
    [
        {"temperature": 0.0},
        {"samples": 0},
        {"smoothness": 1.0},
        {"fresh": 1.5},
        {"fresh": 0.6, "turning": 0.5},
        {"horizon_seconds": 0.5, "replan_seconds": 1.0},
        {"sigma": 1.0},
    ],
)
def test_a_wrong_configuration_is_refused(wrong: dict) -> None:
    with pytest.raises(ValidationError):
        MppiConfig(**wrong)


@pytest.mark.parametrize("fresh", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("samples", [1, 2, 5])
def test_few_samples_are_as_legal_as_many(gantry, task, past, samples, fresh, robot):
    mppi = planner(gantry, task, samples=samples, fresh=fresh, elites=3, rounds=2)
    for _ in range(3):
        controls = mppi.act(past).controls
        assert (controls >= robot.control_low).all() and (controls <= robot.control_high).all()


def test_few_samples_with_many_elites_are_still_searched(gantry, task, past):
    mppi = planner(gantry, task, samples=4, elites=8)
    plans = [mppi.act(past).controls for _ in range(4)]
    assert not any(np.array_equal(one, other) for one, other in pairwise(plans))
