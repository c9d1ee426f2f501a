"""Verdicts on models whose worth is known."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from flywheel.diagnosis.comparison import Outcome, Subject, compare
from flywheel.diagnosis.comparison.result import LOUD
from flywheel.dynamics import Persistence
from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.errors import DataError, ModelError
from flywheel.options import ComparisonOptions
from flywheel.records import Floats, Past, Rollout, Trajectory
from flywheel.robots import Robot, load_robot
from tests.unit.comparison.conftest import plant_of, recordings

pytestmark = pytest.mark.slow


def test_where_nothing_is_hidden_little_is_left_of_the_plants_error(found, seed):
    (plant,) = found.models
    assert plant.outcome is Outcome.NOISE_ONLY or plant.excess < LOUD + 0.1, seed
    low, _, high = plant.noise_rms
    assert 0.8 * low < plant.rms < 1.5 * high, seed
    assert (plant.by_lead < found.persistence)[found.windows.steps // 2 :].all(), seed


@pytest.mark.parametrize(("effect", "size"), [("cable_damping", 3.0), ("winch_gain", 1.0)])
def test_a_hidden_effect_is_more_than_noise(effect: str, size: float, seed: int) -> None:
    robot = load_robot("platform4")
    with_effect = recordings(robot, effect, seed, 2.0, size)
    found = compare(
        [plant_of(robot)], with_effect, ComparisonOptions(horizon=0.7, draws=90, seed=seed)
    )
    assert found.models[0].outcome is Outcome.MORE_THAN_NOISE, (seed, found.models[0].excess)
    assert found.exit_code == 1


def test_an_untrained_network_is_more_than_noise_though_noise_moves_it_far(
    robot: Robot, nothing_hidden: list[Trajectory], seed: int
) -> None:
    # Of two recordings, noise makes as much of one network in five.
    logs = [*nothing_hidden, *recordings(robot, "", seed + 2)]
    torch.manual_seed(seed)
    network = LearnedDynamics(robot, ChunkNetwork(robot, NetworkConfig()))
    both = [Subject("network", network), plant_of(robot)]
    found = compare(both, logs, ComparisonOptions(horizon=0.4, draws=60, seed=seed))
    untrained, plant = found.models
    assert untrained.outcome is Outcome.MORE_THAN_NOISE, seed
    assert untrained.noise_rms[0] > plant.noise_rms[2], seed
    assert np.array_equal(untrained.squares.count, plant.squares.count)  # the same windows


def test_a_model_in_which_nothing_moves_is_the_line_of_persistence(robot, nothing_hidden, found):
    still = Persistence(robot, 0.01, found.windows.lead)
    again = compare(
        [Subject("still", still)], nothing_hidden, ComparisonOptions(horizon=0.5, draws=40)
    )
    assert np.allclose(again.models[0].by_lead, again.persistence)
    assert again.models[0].outcome is Outcome.MORE_THAN_NOISE


class FarOff(Persistence):
    """Nothing moves, two kilometres away along every axis: some million noises."""

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        found = super().rollout(past, controls)
        return dataclasses.replace(found, points=found.points + 2000.0)


def test_the_error_of_a_model_that_is_far_off_is_told_in_full(robot, nothing_hidden, seed):
    far = Subject("far", FarOff(robot, 0.01))
    found = compare([far], nothing_hidden[:1], ComparisonOptions(horizon=0.5, draws=40, seed=seed))
    summary = found.summary()["models"][0]
    assert summary["error"]["rms"] == pytest.approx(2000.0, abs=1.0)
    by_lead = np.mean(summary["by_lead_time"]["mean_square"]) * found.windows.sigma**2
    assert summary["error"]["rms"] == pytest.approx(np.sqrt(by_lead))
    for part in summary["where"]["points by end cap"]:
        assert part["mean_square"] * found.windows.sigma**2 == pytest.approx(2000.0**2, rel=1e-3)


def test_the_same_seed_gives_the_same_numbers_and_another_other_draws(robot, nothing_hidden):
    def summary(seed: int) -> dict[str, object]:
        found = compare(
            [plant_of(robot)],
            nothing_hidden[:1],
            ComparisonOptions(horizon=0.5, draws=40, seed=seed),
        )
        return {**found.summary(), "seconds": 0.0}

    assert summary(1) == summary(1)
    one, other = (summary(seed)["models"][0] for seed in (1, 2))
    assert one["error"]["rms"] == other["error"]["rms"]
    assert one["by_lead_time"] != other["by_lead_time"]


def test_missing_measurements_are_neither_counted_nor_held_against_a_model(
    robot: Robot, nothing_hidden: list[Trajectory], seed: int
) -> None:
    gappy = []
    rng = np.random.default_rng(seed)
    for t in nothing_hidden:
        points = t.observations.points.copy()
        points[rng.random(points.shape[:2]) < 0.1] = np.nan
        gappy.append(
            dataclasses.replace(t, observations=dataclasses.replace(t.observations, points=points))
        )
    found = compare([plant_of(robot)], gappy, ComparisonOptions(horizon=0.4, draws=40, seed=seed))
    assert found.models[0].whole.count == np.isfinite(found.windows.measured).sum()
    assert found.models[0].whole.count < found.windows.measured.size
    assert found.models[0].excess < LOUD + 0.15, seed


def test_the_summary_is_plain_json_and_speaks_for_the_last_model(robot, nothing_hidden):
    still = Subject("still", Persistence(robot, 0.01))
    found = compare(
        [plant_of(robot), still], nothing_hidden[:1], ComparisonOptions(horizon=0.5, draws=40)
    )
    summary = json.loads(json.dumps(found.summary()))
    assert summary["verdict"] == summary["models"][1]["verdict"] == "MORE_THAN_NOISE"
    assert summary["models"][0]["where"]["points by end cap"][0]["bin"] == robot.points[0].name


def test_models_that_do_not_fit_are_refused(robot: Robot, nothing_hidden: list[Trajectory]) -> None:
    plant = plant_of(robot)
    with pytest.raises(ModelError, match="no model"):
        compare([], nothing_hidden)
    with pytest.raises(ModelError, match="different names, got plant, plant"):
        compare([plant, plant], nothing_hidden)
    with pytest.raises(ModelError, match="icosa6"):
        compare([plant, plant_of(load_robot("icosa6"), "other")], nothing_hidden)
    slow = Subject("slow", RestartedPlant(Plant(robot, 0.02)))
    with pytest.raises(ModelError, match=r"slow predicts at 0.02 s, a recording has 0.01 s"):
        compare([slow], nothing_hidden)
    with pytest.raises(DataError, match="40 draws to tell noise from more, got 3"):
        compare([plant], nothing_hidden, ComparisonOptions(draws=3))
