"""Cables end where they are attached: seen where a body's pose is, computed where a roll is not."""

import numpy as np
import pytest
import torch

from flywheel.control import RandomControls
from flywheel.dynamics.gnn import NetworkConfig, Simulator
from flywheel.dynamics.gnn.attachments import upright
from flywheel.dynamics.plant import Plant
from flywheel.records import State
from flywheel.rotations import rotate

LEAN = NetworkConfig.lean(width=16)
SAMPLES, SECONDS = 6, 4.0


@pytest.fixture
def driven(robots, seed):
    """Robot name -> frames (3, T, F, K), winch (T, W, K) and true cable ends (3, T, 2 C, K)."""

    def drive(name):
        robot = robots[name]
        plant, steps = Plant(robot), round(SECONDS / LEAN.dt)
        start = plant.settle(1.0)
        controls = RandomControls(robot, plant.dt)
        winch = plant.winch(start)[0]
        commands = np.stack([controls.sequence(winch, steps, seed + i) for i in range(SAMPLES)])
        starts = State(
            *(np.repeat(x, SAMPLES, axis=0) for x in (start.qpos, start.qvel, start.act))
        )
        trajectory = plant.simulate(starts, commands)
        poses = trajectory.states.qpos.reshape(SAMPLES, steps + 1, -1, 7)
        places = [
            poses[:, :, end.body, :3] + rotate(poses[:, :, end.body, 3:], end.offset)
            for cable in robot.cables
            for end in cable.ends
        ]

        def tensor(array):
            return torch.from_numpy(np.ascontiguousarray(array)).float()

        points = tensor(trajectory.observations.points.transpose(3, 1, 2, 0))
        parts = Simulator(robot, LEAN).parts()
        ends = tensor(np.stack(places).transpose(3, 2, 0, 1))
        winch = tensor(trajectory.observations.winch.transpose(1, 2, 0))
        return parts, parts.frames.of_points(points), winch, ends

    return drive


@pytest.mark.parametrize("name", ["prism3", "icosa6"])
def test_ends_on_moving_rods_are_found_from_the_rods_axes_alone(driven, robots, name, seed):
    parts, frames, winch, ends = driven(name)
    origin, reach = torch.zeros(2, SAMPLES), robots[name].length
    apart = []
    for step in range(50, frames.shape[1], 50):
        sides = parts.attachments.find(frames[:, step], origin, winch[step])
        found, _ = parts.attachments.positions(frames[:, step], sides, origin)
        apart.append((found - ends[:, step]).norm(dim=0))
    apart = torch.stack(apart) / reach
    assert apart.median() < 0.002 and apart.quantile(0.95) < 0.02, (seed, apart.quantile(0.95))


@pytest.mark.parametrize("name", ["prism3", "icosa6"])
def test_a_roll_that_is_followed_stays_right(driven, robots, name, seed):
    parts, frames, winch, ends = driven(name)
    origin, apart = torch.zeros(2, SAMPLES), []
    sides = parts.attachments.find(frames[:, 0], origin, winch[0])
    for step in range(LEAN.chunk, frames.shape[1], LEAN.chunk):
        sides = parts.attachments.follow(frames[:, step], sides, origin, winch[step])
        found, _ = parts.attachments.positions(frames[:, step], sides, origin)
        apart.append((found - ends[:, step]).norm(dim=0))
    late = torch.stack(apart[len(apart) // 2 :]) / robots[name].length
    assert late.median() < 0.002 and late.quantile(0.95) < 0.02, (seed, late.quantile(0.95))


def test_ends_on_a_body_whose_pose_is_seen_are_exact(robots, make_window, seed):
    robot = robots["platform4"]
    simulator, window = Simulator(robot, LEAN), make_window(robot, LEAN, seed)
    parts = simulator.parts()
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    state = start.states[-1]
    found, across = parts.attachments.positions(state.frames, state.sides, start.origin)
    assert not across.any()
    place = torch.cat([start.origin, torch.zeros_like(start.origin[:1])])
    present = window.past_points[:, -1].double().numpy()
    ends = [end for cable in robot.cables for end in cable.ends]
    body = robot.bodies[0]
    known = np.array([robot.points[p].offset for p in body.points])
    for row, end in enumerate(ends):
        got = (found[:, row] + place).t().double().numpy()
        if end.body < 0:
            np.testing.assert_allclose(got, np.broadcast_to(end.offset, got.shape), atol=1e-5)
            continue
        # distances to the tracked points do not change with the pose
        np.testing.assert_allclose(
            np.linalg.norm(got[:, None] - present, axis=-1),
            np.broadcast_to(np.linalg.norm(end.offset - known, axis=-1), present.shape[:2]),
            atol=1e-4,
        )


def test_velocities_of_ends_are_those_of_rods_that_do_not_spin(driven, seed):
    parts, frames, winch, _ = driven("prism3")
    origin, step, dt = torch.zeros(2, SAMPLES), 200, LEAN.dt
    before, after = frames[:, step], frames[:, step + 1]
    sides = parts.attachments.find(before, origin, winch[step])
    first, across = parts.attachments.positions(before, sides, origin)
    second, _ = parts.attachments.positions(after, sides, origin)  # carried along, not rolled
    nodes = torch.matmul(parts.frames.to_nodes, after - before) / dt
    speeds = parts.attachments.velocities(before, across, nodes)
    size = nodes.abs().max()
    torch.testing.assert_close(speeds, (second - first) / dt, rtol=0, atol=0.02 * float(size))


def test_gradients_pass_through_the_ends_of_upright_and_slack_robots(robots, make_window, seed):
    robot = robots["prism3"]
    simulator, window = Simulator(robot, LEAN), make_window(robot, LEAN, seed, spin=0.0)
    parts = simulator.parts()
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    frames = start.states[-1].frames.clone()
    frames[:, parts.frames.rod_rows] = torch.tensor([0.0, 0.0, 1.0])[:, None, None]
    slack = start.states[-1].winch + 100.0
    frames.requires_grad_(True)
    sides = parts.attachments.find(frames, start.origin, slack)
    sides = parts.attachments.follow(frames, sides, start.origin, slack)
    found, _ = parts.attachments.positions(frames, sides, start.origin)
    (gradient,) = torch.autograd.grad(found.square().sum(), frames)
    assert torch.isfinite(gradient).all() and gradient.any()


def test_sides_are_unit_vectors_across_the_axes(seed):
    torch.manual_seed(seed)
    axes = torch.nn.functional.normalize(torch.randn(3, 5, 7), dim=0)
    sides = upright(torch.randn(3, 5, 7), axes)
    torch.testing.assert_close((sides * sides).sum(0), torch.ones(5, 7))
    torch.testing.assert_close((sides * axes).sum(0), torch.zeros(5, 7), rtol=0, atol=1e-5)
