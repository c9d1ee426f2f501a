"""The hybrid network: cables and gravity come from mechanics, and only the rest is learned."""

import numpy as np
import pytest
import torch
from pydantic import ValidationError

from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, Simulator, fit_normalisation
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.plant import Plant
from flywheel.records import Observation, State
from flywheel.robots import Robot, load_robot
from tests.unit.gnn.test_normalisation import split

STEPS = 30


class Falling:
    """Episodes of a robot that nothing touches, pulled by its cables, as a window of the past."""

    def __init__(self, robot: Robot, samples: int, spread: float) -> None:
        plant, rng = Plant(robot, 0.01), np.random.default_rng(0)
        start = plant.rest(samples)
        qpos = start.qpos.copy()
        if not robot.tethered:
            qpos.reshape(samples, -1, 7)[..., 2] += 50.0
        qvel = spread * rng.normal(size=start.qvel.shape)
        winch = plant.winch(start)[:, None]
        controls = np.repeat(robot.holding(winch), STEPS + 1, axis=1)
        seen = plant.simulate(State(qpos, qvel, start.act), controls).observations
        self.seen: Observation = seen
        points, winch, controls = (
            torch.from_numpy(each).float() for each in (seen.points, seen.winch, controls)
        )
        self.past_points, self.past_controls, self.past_winch = (
            points[:, :2],
            controls[:, :1],
            winch[:, :2],
        )
        self.controls, self.points = controls[:, 1:], points[:, 2:]
        self.dataset = torch.zeros(samples, dtype=torch.int64)


def silent(robot: Robot, config: NetworkConfig) -> ChunkNetwork:
    """A network that changes nothing."""
    network = ChunkNetwork(robot, config)
    with torch.no_grad():
        for parameter in network.node_decoder.parameters():
            parameter.zero_()
    return network


@pytest.mark.parametrize(("name", "share"), [("prism3", 0.005), ("icosa6", 0.01)])
def test_without_contact_there_is_nothing_left_to_learn(robots, name, share) -> None:
    robot, config = robots[name], NetworkConfig.hybrid(width=8)
    fall = Falling(robot, 2, 0.1)
    with torch.no_grad():
        got = Simulator(robot, config).unroll(
            silent(robot, config),
            fall.past_points,
            fall.past_controls,
            fall.past_winch,
            fall.controls,
            fall.dataset,
        )
    travelled = (fall.points - fall.past_points[:, -1:]).abs().max()
    assert (got.points - fall.points).abs().max() < share * travelled


def test_a_robot_that_hangs_on_anchors_stays_where_it_hangs(robots) -> None:
    robot, config = robots["platform4"], NetworkConfig.hybrid(width=8)
    hangs = Falling(robot, 1, 0.0)
    # Far from the origin of the network's axes: anchors are in the world.
    simulator = Simulator(robot, config)
    past = hangs.past_points, hangs.past_controls, hangs.past_winch
    got = simulator.unroll(silent(robot, config), *past, hangs.controls, hangs.dataset)
    assert (got.points - hangs.points).abs().max() < 1e-4 * robot.length


def test_scales_are_those_of_what_is_left_to_learn(robots) -> None:
    robot, fall = robots["prism3"], Falling(robots["prism3"], 20, 0.1)
    scales = {}
    for mechanics in ("learned", "mjcf"):
        config = NetworkConfig.hybrid(width=8, mechanics=mechanics)
        network = ChunkNetwork(robot, config)
        fit_normalisation(Simulator(robot, config), network, [split(fall)])
        scales[mechanics] = network.velocity_scale.item()
    assert scales["mjcf"] < 0.2 * scales["learned"]


def test_a_gradient_goes_through_the_mechanics(robots) -> None:
    robot, config = robots["prism3"], NetworkConfig.hybrid(width=8)
    fall, network = Falling(robot, 2, 0.1), ChunkNetwork(robot, config)
    got = Simulator(robot, config).unroll(
        network,
        fall.past_points,
        fall.past_controls,
        fall.past_winch,
        fall.controls[:, :5],
        fall.dataset,
    )
    got.points.square().sum().backward()
    for parameter in network.node_decoder.parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all()
        assert parameter.grad.abs().max() > 0


@pytest.mark.parametrize("mechanics", ["heuristic", "uninformed"])
def test_guessed_attachments_are_those_of_the_graph(mechanics) -> None:
    robot = load_robot("prism3")
    graph = RobotGraph(robot, NetworkConfig.hybrid(mechanics=mechanics))
    own = [end.offset for cable in robot.cables for end in cable.ends]
    guessed = [end.offset for cable in graph.robot.cables for end in cable.ends]
    assert all(np.abs(a - b).max() > 1e-3 for a, b in zip(own, guessed, strict=True))


@pytest.mark.parametrize("mechanics", ["mjcf", "heuristic", "uninformed"])
def test_cables_are_as_taut_in_the_keyframe_as_the_mjcfs(mechanics) -> None:
    robot = load_robot("prism3")
    graph = RobotGraph(robot, NetworkConfig.hybrid(mechanics=mechanics))
    winch = torch.from_numpy(robot.winch_of(robot.keyframe)).float()[:, None]
    poses, cable = robot.keyframe.qpos.reshape(1, -1, 7), graph.relations["cable"].origin // 2
    strain = graph.robot.cable_lengths(poses)[0][cable] - graph.rest_lengths(winch)[:, 0].numpy()
    own = robot.cable_lengths(poses)[0] - [each.rest_length for each in robot.cables]
    np.testing.assert_allclose(strain, own[cable], atol=1e-6)


@pytest.mark.parametrize("changes", [{"chunk": 6}, {"cable_ends": "nodes"}])
def test_mechanics_need_single_steps_and_attachments(changes) -> None:
    with pytest.raises(ValidationError, match="needs a chunk of 1"):
        NetworkConfig.hybrid(**changes)
