"""Poses from points, and back."""

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from flywheel.dynamics.gnn.nodes import body_nodes
from flywheel.dynamics.gnn.rigid import Frames, nearest_rotation


def test_the_nearest_rotation_is_that_of_the_singular_value_decomposition(seed):
    rng = np.random.default_rng(seed)
    vectors = Rotation.random(50, random_state=rng).as_matrix()
    vectors = vectors + rng.normal(0, 0.1, vectors.shape)
    left, _, right = np.linalg.svd(vectors)
    found = nearest_rotation(torch.from_numpy(vectors).permute(1, 2, 0)[:, :, None])
    np.testing.assert_allclose(found[:, :, 0].permute(2, 0, 1), left @ right, atol=1e-6)


def test_its_gradient_is_right_where_singular_values_agree():
    vectors = torch.eye(3, dtype=torch.float64)[:, :, None, None].requires_grad_()
    assert torch.autograd.gradcheck(nearest_rotation, vectors)


def frames_of(robot, decomposition="caps"):
    nodes = body_nodes(robot, decomposition)
    return Frames(robot, nodes, torch.device("cpu")), nodes


def placed(robot, offsets, bodies, rng, samples):
    """(3, M, K) offsets placed by random poses of the bodies, the same for the same rng."""
    poses = [
        (rng.normal(0, 2, (samples, 3)), Rotation.random(samples, random_state=rng))
        for _ in robot.bodies
    ]
    columns = [
        poses[b][0] + poses[b][1].apply(offset) for b, offset in zip(bodies, offsets, strict=True)
    ]
    return torch.from_numpy(np.stack(columns)).permute(2, 0, 1).float()


@pytest.mark.parametrize("decomposition", ["caps", "primitives"])
@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4"])
def test_rigidly_moved_points_come_back_with_all_nodes(robots, seed, name, decomposition):
    robot = robots[name]
    frames, nodes = frames_of(robot, decomposition)
    offsets, bodies = [p.offset for p in robot.points], [p.body for p in robot.points]
    points = placed(robot, offsets, bodies, np.random.default_rng(seed), 6)
    found = frames.of_points(points)
    torch.testing.assert_close(frames.to_points @ found, points, rtol=0, atol=2e-5)
    expected = placed(
        robot, [n.offset for n in nodes], [n.body for n in nodes], np.random.default_rng(seed), 6
    )
    torch.testing.assert_close(frames.to_nodes @ found, expected, rtol=0, atol=2e-5)
    torch.testing.assert_close(frames.of_nodes(expected), found, rtol=0, atol=2e-5)


def test_a_stretched_rod_is_put_back_about_its_middle(robots):
    robot = robots["prism3"]
    frames, _ = frames_of(robot)
    offsets, bodies = [p.offset for p in robot.points], [p.body for p in robot.points]
    points = placed(robot, offsets, bodies, np.random.default_rng(0), 1)
    middle = 0.5 * (points[:, 0] + points[:, 1])
    stretched = points.clone()
    stretched[:, :2] = middle[:, None] + 1.2 * (points[:, :2] - middle[:, None])
    torch.testing.assert_close(
        frames.to_points @ frames.of_points(stretched), points, rtol=0, atol=1e-5
    )


@pytest.mark.parametrize("offsets", [
    [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]],
    [[0.0, 0, 0.2], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[0.3, 0.1, 0.2]],
])  # fmt: skip
def test_planes_bodies_and_single_points_are_fitted_too(robots, seed, offsets):
    robot = robots["platform4"]
    offsets = [np.array(o) for o in offsets]
    points = tuple(
        dataclasses.replace(robot.points[0], name=f"p{i}", offset=o) for i, o in enumerate(offsets)
    )
    body = dataclasses.replace(robot.bodies[0], points=tuple(range(len(points))))
    robot = dataclasses.replace(robot, bodies=(body,), points=points)
    frames, _ = frames_of(robot)
    places = placed(robot, offsets, [0] * len(points), np.random.default_rng(seed), 4)
    back = frames.to_points @ frames.of_points(places)
    torch.testing.assert_close(back, places, rtol=0, atol=2e-5)
