"""Which plans MPPI tries. Winches that are told positions show a plan in their commands at its knots."""

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.control import Mppi, MppiConfig
from flywheel.control.mppi import TriedPlans, softmin
from flywheel.errors import ConfigError
from flywheel.records import Past, Rollout
from flywheel.robots import Robot
from flywheel.tasks import Task
from tests.unit.control.conftest import DT, Gantry

KNOT = 5  # steps between knots
CONFIG = {
    "samples": 40,
    "horizon_seconds": 2.0,
    "knot_seconds": KNOT * DT,
    "replan_seconds": KNOT * DT,
}


@dataclass
class Watched(Gantry):
    """Remembers the commands that were tried, and where they led."""

    commands: list[np.ndarray] = field(default_factory=list)
    rollouts: list[Rollout] = field(default_factory=list)

    def rollout(self, past: Past, controls: np.ndarray) -> Rollout:
        self.commands.append(controls)
        self.rollouts.append(super().rollout(past, controls))
        return self.rollouts[-1]

    @property
    def plans(self) -> list[np.ndarray]:
        """(K, S, W) of each round, one after the other."""
        return [controls[:, KNOT - 1 :: KNOT] for controls in self.commands]


@pytest.fixture
def watched(servo: Robot) -> Watched:
    return Watched(servo)


def planner(watched: Watched, task: Task, **changes: object) -> Mppi:
    mppi = Mppi(watched, MppiConfig(**(CONFIG | changes)))
    mppi.reset(task, 3)
    return mppi


def again(plans: np.ndarray, tried: np.ndarray) -> set[int]:
    """Which plans are among those that were tried."""
    same = np.isclose(plans[:, None], tried[None], atol=1e-9).all(axis=(2, 3))
    return set(np.flatnonzero(same.any(axis=1)))


@pytest.mark.parametrize("elites", [0, 1, 3, 7])
def test_as_many_of_the_best_plans_are_tried_again_as_asked(watched, task, past, elites):
    """In the next round as they are, in the next plan without what is over by then."""
    mppi = planner(watched, task, elites=elites, rounds=2, fresh=0.0)
    mppi.act(past)
    mppi.act(past)
    first, second, third, _ = watched.plans
    for before, after, later in ((0, second, first), (1, third, mppi.knots.later(second, KNOT))):
        best = np.argsort(task.cost(watched.rollouts[before].points))[:elites]
        assert again(later, after) == set(best)


def test_of_plans_that_cost_the_same_the_first_ones_count(watched, task, past):
    """Whatever way of sorting is the fastest on a machine."""
    even = replace(task, costs=(lambda points, task: np.arange(len(points)) % 2.0,))
    mppi = planner(watched, even, elites=7, rounds=2, fresh=0.0)
    mppi.act(past)
    assert again(*watched.plans) == set(range(0, 14, 2))
    order = np.concatenate([np.arange(0, 40, 2), np.arange(1, 40, 2)])
    paths = mppi._paths(TriedPlans(np.arange(40) % 2.0, np.zeros(40), watched.rollouts[0]))
    shown = order[np.linspace(0, 39, len(paths)).round().astype(int)]
    places = task.place(watched.rollouts[0].points[shown][:, ::KNOT])
    np.testing.assert_array_equal(paths, places)


@pytest.mark.parametrize("narrowing", [0.3, 0.5, 1.0])
def test_every_round_searches_closer_by(watched, task, past, narrowing):
    mppi = planner(
        watched, task, samples=600, rounds=4, narrowing=narrowing, noise=0.05, elites=0, fresh=0.0
    )
    mppi.act(past)
    range_ = watched.robot.rest_high - watched.robot.rest_low
    for turn, plans in enumerate(watched.plans):
        scatter = (plans[1:] - plans[0]) / range_
        assert scatter.std() == pytest.approx(0.05 * narrowing**turn, rel=0.05)
        np.testing.assert_allclose(scatter.mean(axis=0), 0.0, atol=0.012)


@pytest.mark.parametrize("fresh", [0.0, 0.25, 1.0])
def test_a_share_of_the_plans_are_strokes_from_end_to_end(watched, task, past, fresh):
    mppi = planner(watched, task, samples=41, fresh=fresh, noise=0.01)
    mppi.act(past)
    robot = watched.robot
    relative = (watched.plans[0][1:] - robot.rest_low) / (robot.rest_high - robot.rest_low)
    stroke = np.isclose(relative, np.round(2 * relative) / 2, atol=1e-9).all(axis=(1, 2))
    assert stroke.sum() == round(40 * fresh)
    if fresh:
        np.testing.assert_allclose(np.unique(relative[stroke].round(9)), [0.0, 0.5, 1.0])


@pytest.mark.parametrize(("seconds", "knots"), [(0.1, 1), (1.5, 3), (2.0, 4)])
def test_strokes_last_as_long_as_asked(watched, task, past, seconds, knots):
    mppi = planner(
        watched, task, samples=200, fresh=1.0, fresh_seconds=seconds, horizon_seconds=6.0
    )
    mppi.act(past)
    changed = (np.abs(np.diff(watched.plans[0][1:], axis=1)) > 1e-9).any(axis=2)
    apart = [np.diff(np.flatnonzero(each)) for each in changed]
    assert np.concatenate(apart).min() == knots


def test_no_plan_leaves_the_winches_range(watched: Watched, task: Task, past: Past) -> None:
    mppi = planner(watched, task, noise=3.0)
    mppi.act(past)
    robot, plans = watched.robot, watched.plans[0]
    assert (plans >= robot.rest_low - 1e-12).all() and (plans <= robot.rest_high + 1e-12).all()
    assert (plans == robot.rest_low).any() and (plans == robot.rest_high).any()


@pytest.mark.parametrize("relative", [True, False])
def test_the_plan_is_the_mean_of_all_that_were_tried_with_their_weights(
    watched: Watched, task: Task, past: Past, relative: bool
) -> None:
    mppi = planner(watched, task, temperature=0.5, relative_temperature=relative)
    command = mppi.act(past)
    weights = softmin(task.cost(watched.rollouts[0].points), 0.5, relative)
    assert 1.5 < 1 / (weights**2).sum() < 39
    mean = np.einsum("k,ksw->sw", weights, watched.plans[0])
    np.testing.assert_allclose(command.controls[KNOT - 1], mean[0])


def test_plans_are_tried_to_the_horizon_and_no_further(watched, task, past):
    """Also where it lies between two knots."""
    planner(watched, task, horizon_seconds=1.2).act(past)
    assert watched.commands[0].shape == (40, 12, len(watched.robot.winches))


def test_paths_lead_from_the_best_plan_to_the_worst(watched, task, past):
    paths = planner(watched, task).act(past).diagnostics["paths"]
    points = watched.rollouts[0].points
    order = np.argsort(task.cost(points))
    for shown, index in ((paths[0], order[0]), (paths[-1], order[-1])):
        np.testing.assert_array_equal(shown, task.place(points[index][::KNOT]))
    ranks = [
        np.flatnonzero((task.place(points[order][:, ::KNOT]) == path).all((1, 2)))[0]
        for path in paths
    ]
    assert (np.diff(ranks) >= 39 // 11).all()  # evenly


def test_diagnostics_are_of_the_finite_costs() -> None:
    costs, weights = np.array([3.0, np.inf, 1.0, 2.0]), np.array([0.25, 0.0, 0.5, 0.25])
    points = np.arange(4.0).reshape(4, 1, 1, 1)
    shown = TriedPlans(costs, weights, Rollout(points, points[..., 0])).diagnostics()
    assert (shown["best_cost"], shown["mean_cost"]) == (1.0, 2.0)
    assert shown["effective_samples"] == pytest.approx(1 / 0.375)
    assert shown["points"] == 2.0


def test_the_time_that_planning_took_is_told(watched: Watched, task: Task, past: Past) -> None:
    begun = time.perf_counter()
    command = planner(watched, task).act(past)
    assert 0.0 < command.plan_seconds <= time.perf_counter() - begun


# Each number at the end of what it may be, and just beyond.
LIMITS = {
    "samples": (1, 0),
    "rounds": (1, 0),
    "horizon_seconds": (0.5, 0.0),
    "knot_seconds": (0.01, 0.0),
    "replan_seconds": (0.01, 0.0),
    "temperature": (1e-9, 0.0),
    "noise": (1e-9, 0.0),
    "smoothness": (0.0, -0.1),
    "narrowing": (1e-9, 0.0),
    "elites": (0, -1),
    "fresh": (0.0, -0.1),
    "fresh_seconds": (1e-9, 0.0),
}
UPPER = {"smoothness": (0.999, 1.0), "narrowing": (1.0, 1.1), "fresh": (1.0, 1.1)}


@pytest.mark.parametrize(("name", "limit"), [*LIMITS.items(), *UPPER.items()])
def test_a_setting_is_accepted_up_to_its_limit(name: str, limit: tuple[float, float]) -> None:
    last, beyond = limit
    assert getattr(MppiConfig(**{name: last}), name) == last
    with pytest.raises(ValidationError, match=name):
        MppiConfig(**{name: beyond})


def test_the_usual_settings_are_within_their_limits() -> None:
    usual = MppiConfig()
    assert MppiConfig(**usual.model_dump()) == usual


def test_a_time_may_be_a_single_step(watched: Watched, task: Task, past: Past) -> None:
    mppi = planner(watched, task, horizon_seconds=DT, knot_seconds=DT, replan_seconds=DT)
    assert len(mppi.act(past).controls) == 1


@pytest.mark.parametrize("name", MppiConfig.TIMES)
@pytest.mark.parametrize("seconds", [1e-9, 0.25 * DT, 1.04 * DT])
def test_times_that_are_no_whole_steps_are_refused(watched, name, seconds):
    changes = {"replan_seconds": DT} | {name: seconds}
    if name == "horizon_seconds":
        changes["replan_seconds"] = seconds
    with pytest.raises(ConfigError, match="must be a multiple of the model's 0.1 s"):
        Mppi(watched, MppiConfig(**changes))


def test_settings_do_not_change_while_they_are_used() -> None:
    config = MppiConfig(horizon_seconds=1.0, replan_seconds=1.0)  # all of a plan may be carried out
    with pytest.raises(ValidationError, match="frozen"):
        config.samples = 3
