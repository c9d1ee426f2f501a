"""The ground below the network's nodes."""

import dataclasses

import mujoco
import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, Simulator, View, ground_of
from flywheel.dynamics.plant.world import scene
from flywheel.dynamics.rigid_bodies.ground import flat_ground
from flywheel.errors import DataError
from flywheel.records import Observation, Past
from flywheel.terrain import Box, Terrain, with_boxes
from tests.unit.gnn.conftest import boxes_around

# Far enough that every node sees the ground, near enough that hills are more than a rounding of it.
LEAN = NetworkConfig.lean(width=16, ground_clamp=20.0)
BESIDE = NetworkConfig.lean(width=16, surfaces=3, contact_threshold=1.0, ground_clamp=20.0)


def hills(rng: np.random.Generator) -> Terrain:
    """Uneven ground that reaches at least 5 m from the robot's place to every side."""
    shape = tuple(int(n) for n in rng.integers(26, 40, 2))
    cell = float(rng.uniform(0.4, 0.9))
    origin = tuple(float(-cell * n * rng.uniform(0.48, 0.52)) for n in shape)
    return Terrain(rng.uniform(-0.3, 0.3, shape), cell, origin)


def test_it_is_the_terrains_own_surface(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrains = (hills(rng), None, hills(rng), hills(rng))
    which = rng.integers(0, 4, 30)
    places = rng.uniform(-12.0, 12.0, (2, 7, 30))
    ground = ground_of([terrains[i] for i in which])
    heights, normals = ground(torch.from_numpy(places).float())
    for sample, index in enumerate(which):
        terrain, here = terrains[index], places[:, :, sample].T
        flat = np.zeros(7), np.tile([0.0, 0.0, 1.0], (7, 1))
        expected = flat if terrain is None else terrain.at(here)
        off = np.abs(heights[:, sample].numpy() - expected[0])
        assert (off < 1e-4).sum() >= 6, seed  # rounding may step over an edge
        turned = np.abs(normals[:, :, sample].numpy().T - expected[1]).max(axis=1)
        assert (turned < 1e-3).sum() >= 6, seed


def test_a_plane_needs_no_lookup() -> None:
    assert ground_of([None]) is flat_ground
    assert ground_of([None, None, None]) is flat_ground


def test_samples_seen_from_elsewhere_stand_on_the_same_ground(seed: int) -> None:
    rng = np.random.default_rng(seed)
    terrain, angle = hills(rng), rng.uniform(-np.pi, np.pi, 20)
    places, shift = rng.uniform(-6.0, 6.0, (2, 5, 20)), rng.uniform(-3.0, 3.0, (2, 20))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    seen = np.einsum("ijk,jnk->ink", turn, places) - shift[:, None]
    view = View(torch.from_numpy(angle).float(), torch.from_numpy(shift).float())
    heights, normals = ground_of([terrain], view=view)(torch.from_numpy(seen).float())
    expected, upright = terrain.at(np.moveaxis(places, 0, -1))
    off = np.abs(heights.numpy() - expected)
    assert np.quantile(off, 0.95) < 1e-4, seed
    upright = np.moveaxis(upright, -1, 0)
    upright[:2] = np.einsum("ijk,jnk->ink", turn, upright[:2])
    assert np.quantile(np.abs(normals.numpy() - upright), 0.95) < 1e-3, seed


@pytest.mark.parametrize("config", [LEAN, BESIDE], ids=["ground", "boxes"])
def test_predictions_turn_with_robot_and_surroundings_alike(
    robots, make_network, make_window, seed, config
):
    robot = robots["prism3"]
    network, window = make_network(robot, config, seed), make_window(robot, config, seed)
    simulator, rng = Simulator(robot, config), np.random.default_rng(seed)
    terrain, angle = hills(rng), float(rng.uniform(-np.pi, np.pi))
    if config is BESIDE:
        terrain = with_boxes(None, boxes_around(seed))
    cos, sin = np.cos(angle), np.sin(angle)
    turn = torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]).float()
    other = dataclasses.replace(window, past_points=window.past_points @ turn.t())
    view = View(torch.full((3,), angle), torch.zeros(2, 3))
    here = simulator.unroll(network, *window.arguments(), ground_of([terrain])).points
    there = simulator.unroll(network, *other.arguments(), ground_of([terrain], view=view)).points
    flat = simulator.unroll(network, *window.arguments()).points
    assert not torch.equal(here, flat)
    off = (here @ turn.t() - there).abs()
    assert off.median() < 1e-4, seed


def test_a_planner_stands_on_what_the_past_says(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    window, rng = make_window(robot, LEAN, seed), np.random.default_rng(seed)
    model = LearnedDynamics(robot, make_network(robot, LEAN, seed), block=2)
    arrays = [a.double().numpy() for a in window.arguments()[:4]]
    past = Past(Observation(arrays[0], arrays[2]), arrays[1], arrays[2])
    terrains = (hills(rng), None, hills(rng))
    uneven = dataclasses.replace(past, terrains=terrains)
    together = model.rollout(uneven, arrays[3]).points
    flat = model.rollout(past, arrays[3]).points
    assert np.abs(together[1] - flat[1]).max() < 1e-4
    for row in (0, 2):
        assert not np.array_equal(together[row], flat[row]), seed
        alone = dataclasses.replace(past, terrains=(terrains[row],))
        np.testing.assert_allclose(
            model.rollout(alone, arrays[3]).points[row], together[row], atol=1e-4
        )
    with pytest.raises(DataError, match="as many terrains"):
        dataclasses.replace(past, terrains=(None, None))


def test_the_nearest_boxes_are_where_mujoco_has_them(robots, seed):
    """The distance is measured between the surfaces of the box and of a ball."""
    boxes, robot = boxes_around(seed), robots["prism3"]
    model = scene(robot, with_boxes(None, boxes)).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    ball = int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)[0])
    radius, body = model.geom_size[ball, 0], model.geom_bodyid[ball]
    places = rng.normal(0, 2.0, (3, 20)) + [[0], [0], [2]]
    away, normal = ground_of([with_boxes(None, boxes)]).nearest(
        torch.from_numpy(places[:, :, None]).float(), 4
    )
    assert away[3].isinf().all() and not normal[:, 3].any()
    assert (away.diff(dim=0) >= 0).all()
    data.qpos[:] = robot.keyframe.qpos
    mujoco.mj_kinematics(model, data)
    start = data.geom_xpos[ball].copy()
    address = model.jnt_qposadr[model.body_jntadr[body]]
    for n, place in enumerate(places.T):
        data.qpos[address : address + 3] = (
            robot.keyframe.qpos[address : address + 3] + place - start
        )
        mujoco.mj_kinematics(model, data)
        found, between = [], np.zeros(6)
        for number in range(3):
            geom = model.geom(f"obstacle{number}").id
            apart = mujoco.mj_geomDistance(model, data, ball, geom, 99.0, between)
            found.append((apart + radius, between[:3] - between[3:]))
        found.sort(key=lambda each: each[0])
        for k, (apart, way) in enumerate(found):
            if apart > 2 * radius:
                assert float(away[k, n, 0]) == pytest.approx(apart, abs=1e-4), seed
                upright = way / np.linalg.norm(way)
                np.testing.assert_allclose(
                    normal[:, k, n, 0], upright, atol=2e-3, err_msg=str(seed)
                )


def test_a_step_along_the_normal_is_a_step_away_from_a_box_and_out_of_it(seed):
    box = boxes_around(seed)[0]
    ground, rng = ground_of([with_boxes(None, [box])]), np.random.default_rng(seed)
    own = (
        rng.uniform(-1.0, 1.0, (3, 60))
        * np.array(box.half_size)[:, None]
        * rng.choice([0.9, 3.0], 60)
    )
    places = torch.from_numpy((box.axes @ own).T + box.center).T[..., None].float()
    away, normal = ground.nearest(places, 1)
    inside = torch.from_numpy((box.beyond(places[..., 0].numpy().T) < 0).all(axis=1))
    assert 5 < inside.sum() < 55 and torch.equal(away[0, :, 0] < 0, inside)
    further, _ = ground.nearest(places + 0.01 * normal[:, 0], 1)
    torch.testing.assert_close(further, away + 0.01, rtol=0, atol=1e-5)


def test_boxes_beyond_the_ground_are_seen_only_where_they_are(
    robots, make_network, make_window, seed
):
    """The same weights: boxes that are far away, or none, leave the ground alone as it was."""
    robot = robots["prism3"]
    window, network = make_window(robot, BESIDE, seed), make_network(robot, BESIDE, seed)
    plain = BESIDE.model_copy(update={"surfaces": 1})
    ground_only = make_network(robot, plain, seed)
    ground_only.load_state_dict(network.state_dict())
    far = Box(center=(90.0, 0.0, 0.0), half_size=(1.0, 1.0, 1.0))
    wanted = Simulator(robot, plain).unroll(ground_only, *window.arguments()).points
    for boxes, same in (((), True), ((far,), True), (boxes_around(seed), False)):
        ground = ground_of([with_boxes(None, boxes)])
        got = Simulator(robot, BESIDE).unroll(network, *window.arguments(), ground).points
        assert ((got - wanted).abs().max() < 1e-5) == same, seed


def test_networks_that_see_the_ground_alone_keep_their_digests():
    assert "surfaces" not in NetworkConfig().model_dump(mode="json")
    assert NetworkConfig.model_validate(BESIDE.model_dump(mode="json")) == BESIDE
    with pytest.raises(ValueError, match="surfaces 2 need contact_edges true"):
        NetworkConfig(surfaces=2, contact_edges=False)
