"""The corrected plant: untrained it is the plant, errors obey mechanics, wrong files are refused."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from flywheel.control import Mppi, MppiConfig
from flywheel.dynamics.plant import Plant, RestartedPlant, with_effects
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.dynamics.residual import (
    Knots,
    Lookout,
    ResidualDynamics,
    ResidualWeights,
    displaced,
    is_residual,
    knots_of,
    mean_offsets,
)
from flywheel.dynamics.residual.features import features
from flywheel.dynamics.residual.mechanics import structure_of
from flywheel.dynamics.residual.model import between
from flywheel.dynamics.residual.motion import matrices
from flywheel.effects import EFFECTS, Scales, Term
from flywheel.errors import ModelError
from flywheel.records import Observation, State
from flywheel.robots import load_robot
from flywheel.rotations import about_axis, rotate
from flywheel.tasks import TaskConfig, sample_task
from tests.antagonists import antagonists
from tests.unit.residual.cases import SMALL, model_of, moving, network_of, plant_of

PRISM = load_robot("prism3")


def term_of(name: str, times: float = 1.0) -> Term:
    effect, scales = EFFECTS[name], Scales.of(PRISM)
    values = tuple(times * p.typical(scales) for p in effect.parameters)
    return Term(effect, effect.places(PRISM)[0], values)


def test_an_untrained_network_leaves_the_plant_as_it_is_to_the_bit():
    _, past, controls = moving(PRISM, 1, 3)
    plant = plant_of(PRISM).rollout(past, controls)
    untrained = model_of(PRISM, eager=False).rollout(past, controls)
    none_of_it = ResidualDynamics(plant_of(PRISM), network_of(PRISM, 0), share=0.0)
    for got in (untrained, none_of_it.rollout(past, controls)):
        assert np.array_equal(got.points, plant.points)
        assert np.array_equal(got.winch, plant.winch)


def test_half_of_a_correction_is_nearly_half_the_way():
    _, past, controls = moving(PRISM, 2, 2)
    plant, network = plant_of(PRISM), network_of(PRISM, 0)
    none, half, whole = (
        ResidualDynamics(plant, network, share).rollout(past, controls).points
        for share in (0.0, 0.5, 1.0)
    )
    assert np.abs(half - (none + whole) / 2).max() < 0.2 * np.abs(whole - none).max()


def test_threads_change_nothing_but_rounding():
    _, past, controls = moving(PRISM, 3, 2)
    controls = np.repeat(controls[:1], 80, axis=0)
    one = type(past)(past.observations[:1], past.controls[:1], past.winch[:1])
    plant, network = plant_of(PRISM), network_of(PRISM, 0)
    got = [ResidualDynamics(plant, network, 1.0, t).rollout(one, controls).points for t in (1, 2)]
    np.testing.assert_allclose(got[0], got[1], atol=1e-4)


def test_points_that_are_missing_are_bridged():
    _, past, controls = moving(PRISM, 4, 2)
    points = past.observations.points.copy()
    points[:, 40:90:3, 0] = np.nan
    points[:, -2:, 3] = np.nan
    gaps = dataclasses.replace(past, observations=Observation(points, past.observations.winch))
    model = model_of(PRISM)
    assert np.isfinite(model.rollout(gaps, controls).points).all()


def test_a_point_that_comes_into_sight_late_is_enough_and_one_that_never_does_is_not():
    _, past, controls = moving(PRISM, 4, 1)
    model, points = model_of(PRISM), past.observations.points.copy()
    points[:, : -model.plant.window, 2] = np.nan
    seen = dataclasses.replace(past, observations=Observation(points, past.observations.winch))
    assert np.isfinite(model.rollout(seen, controls).points).all()
    points[:, :, 2] = np.nan
    with pytest.raises(ModelError, match="not seen"):
        model.rollout(seen, controls)


def test_offsets_are_means_of_what_was_measured():
    points = np.zeros((1, 7, 2, 3))
    measured = points + np.arange(7.0)[None, :, None, None]
    measured[0, 3:, 1] = np.nan
    off, seen = mean_offsets(points, measured, 3)
    np.testing.assert_allclose(off[0, :, 0, 0], [0.5, 3.0, 5.5])  # only what is within counts
    np.testing.assert_allclose(off[0, :, 1, 0], [0.5, 2.0, 0.0])
    np.testing.assert_allclose(seen[0, :, 1], [2 / 3, 1 / 3, 0.0])


def test_places_move_with_their_bodies():
    rng = np.random.default_rng(0)
    arms, shift, turn = rng.normal(size=(3, 5, 3))
    angle = np.linalg.norm(turn, axis=-1)
    want = rotate(about_axis(turn / angle[:, None], angle), arms) - arms + shift
    got = displaced(*(torch.from_numpy(a) for a in (arms, shift, turn)))
    np.testing.assert_allclose(got.numpy(), want, atol=1e-12)


def test_between_knots_are_straight_lines():
    knots = torch.tensor([[0.0, 2.0, 0.0]])[..., None]
    np.testing.assert_allclose(between(knots, 2)[0, :, 0], [0, 1, 2, 1, 0])


def test_matrices_turn_as_quaternions_do():
    rng = np.random.default_rng(1)
    axis = rng.normal(size=(4, 3))
    q = about_axis(axis / np.linalg.norm(axis, axis=-1, keepdims=True), rng.uniform(0, 6, 4))
    v = rng.normal(size=(4, 3))
    np.testing.assert_allclose((matrices(q) @ v[..., None])[..., 0], rotate(q, v), atol=1e-12)


def shown_of(plant: Plant, state: State, controls) -> tuple[Knots, Lookout]:
    lookout = Lookout(RestartedPlant(plant), SMALL)
    motion = plant.simulate(state, controls)
    return knots_of(plant.robot, lookout.units, motion, lookout.every), lookout


def test_one_winch_strains_its_two_cables_in_opposite_ways():
    robot = antagonists()
    plant = Plant(robot)
    state, network = plant.settle(1.0), network_of(robot, 0)
    controls = np.full((1, round(SMALL.interval / plant.dt), 1), 0.1)
    knots, _ = shown_of(plant, state, controls)
    shown = features(network.layout, SMALL, knots, past=False)
    after = plant.simulate(state, controls).states[:, -1]
    lengths = robot.cable_lengths(after.qpos.reshape(1, -1, 7))
    want = (lengths - rest_lengths(robot, plant.winch(after)))[0] / robot.length
    np.testing.assert_allclose(shown.strain[0, -1, ::2], want, atol=1e-6)


@pytest.mark.parametrize("cable", [0, 3])
def test_errors_grow_as_those_of_the_plant_do_when_a_cable_is_longer(cable):
    """The linearised mechanics beside MuJoCo: a robot at rest, one of whose winches has paid out more."""
    plant = Plant(PRISM)
    state, count = plant.settle(3.0), 5
    winch = PRISM.cables[cable].winch
    more = np.zeros(len(PRISM.winches))
    more[winch] = -0.002 * PRISM.length  # shorter: it pulls the harder
    moved = State(state.qpos, state.qvel, plant.activation(plant.winch(state) + more))
    lookout = Lookout(RestartedPlant(plant), SMALL)
    controls = np.zeros((1, count * lookout.every, len(PRISM.winches)))
    knots, _ = shown_of(plant, state, controls)
    true = plant.simulate(moved, controls).observations.points
    want = (true - plant.simulate(state, controls).observations.points)[0, :: lookout.every]
    network = network_of(PRISM, 0)
    shown = features(network.layout, SMALL, knots, past=False)
    structure = structure_of(network.layout, shown)
    error = velocity = torch.zeros(1, 18)
    longer = torch.zeros(1, len(PRISM.cables))
    longer[0, cable] = float(more[winch]) / PRISM.length
    for k in range(1, count + 1):
        error, velocity = structure.step(
            k, SMALL.interval, error, velocity, longer, torch.zeros(1, 18)
        )
    twists = error.view(1, 3, 2, 3)[:, network.layout.point_body]
    got = displaced(shown.point_arms[:, -1], twists[..., 0, :], twists[..., 1, :])[0]
    got = PRISM.length * got.numpy()
    assert np.linalg.norm(want[-1]) > 1e-3
    assert np.linalg.norm(got - want[-1]) < 0.7 * np.linalg.norm(want[-1])
    assert (got * want[-1]).sum() > 0.8 * np.linalg.norm(got) * np.linalg.norm(want[-1])


def test_a_file_brings_the_model_back(tmp_path):
    plant = with_effects(Plant(PRISM), (term_of("winch_gain"),))
    model = ResidualDynamics(
        RestartedPlant(plant, 5, 2, "relaxed"), network_of(PRISM, 3), share=0.75
    )
    path = tmp_path / "m.npz"
    digest = ResidualWeights.of(model).write(path, {"seconds": 60.0})
    assert is_residual(path)
    weights = ResidualWeights.read(path, PRISM)
    assert weights.digest == digest
    assert json.loads(path.with_suffix(".json").read_text())["notes"] == {"seconds": 60.0}
    _, past, controls = moving(PRISM, 5, 2)
    again = weights.dynamics(PRISM)
    assert np.array_equal(
        again.rollout(past, controls).points, model.rollout(past, controls).points
    )
    assert ResidualWeights.read(path, PRISM, plant).digest == digest
    with pytest.raises(ModelError, match="winch_gain.*no effects"):
        ResidualWeights.read(path, PRISM, Plant(PRISM))
    with pytest.raises(ModelError, match=r"steps of 0\.01 s; this one has 0\.02"):
        ResidualWeights.read(path, PRISM, with_effects(Plant(PRISM, 0.02), plant.terms))
    with pytest.raises(ModelError, match="another robot"):
        ResidualWeights.read(path, load_robot("icosa6"))
    with pytest.raises(ModelError, match="corrects the plant of robot"):
        ResidualDynamics(plant_of(load_robot("icosa6")), model.network)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("share", 0.5, "digest"),
        ("share", 7, "share"),
        ("config", {"width": -1}, "width"),
        ("corrected", {}, "dt"),
        ("format", 99, "format 99"),
        ("digest", "0" * 64, "digest"),
    ],
)
def test_a_side_file_that_was_altered_is_refused(tmp_path, key, value, words):
    path = tmp_path / "m.npz"
    ResidualWeights.of(model_of(PRISM)).write(path)
    side = path.with_suffix(".json")
    side.write_text(json.dumps(json.loads(side.read_text()) | {key: value}))
    with pytest.raises(ModelError, match=words):
        ResidualWeights.read(path, PRISM)


def test_a_file_that_is_cut_off_or_missing_is_refused(tmp_path):
    path = tmp_path / "m.npz"
    ResidualWeights.of(model_of(PRISM)).write(path)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ModelError, match="damaged"):
        ResidualWeights.read(path, PRISM)
    path.unlink()
    with pytest.raises(ModelError, match="no weights"):
        ResidualWeights.read(path, PRISM)
    with pytest.raises(ModelError, match="npz"):
        ResidualWeights.of(model_of(PRISM)).write(tmp_path / "m.json")


def test_mppi_plans_with_it():
    _, past, _ = moving(PRISM, 6, 1)
    start = past.observations.points[0, -1]
    rng = np.random.default_rng(0)
    task = sample_task("reach", PRISM, start, rng, TaskConfig(goal=(6.0, 0.0)))
    mppi = Mppi(model_of(PRISM), MppiConfig(samples=6, horizon_seconds=1.0))
    mppi.reset(task, 0)
    plan = mppi.act(past)
    assert plan.controls.shape[1] == len(PRISM.winches) and np.isfinite(plan.controls).all()
