"""What the network is shown: which nodes and edges there are, and what they feel."""

import dataclasses

import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, Simulator
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.nodes import standardised
from flywheel.errors import ModelError

LEAN = NetworkConfig.lean(width=16)
PAPER = NetworkConfig.paper(width=8)


def test_the_papers_robot_has_eight_nodes_per_rod(robots):
    graph = RobotGraph(robots["prism3"], PAPER)
    assert graph.body_count == 24
    heights = sorted(round(float(n.offset[2]), 3) for n in graph.nodes if n.body == 0)
    assert heights == [-1.475, -1.039, -0.983, 0.0, 0.0, 0.983, 1.039, 1.475]
    masses = [sum(n.mass for n in graph.nodes if n.body == b) for b in range(3)]
    assert masses == pytest.approx([242.9] * 3)


@pytest.mark.parametrize(
    ("name", "nodes", "body", "cable", "contact"),
    [("prism3", 6, 6, 30, 12), ("icosa6", 12, 12, 48, 24)],
)
def test_the_lean_graph_has_a_node_per_end_cap(robots, name, nodes, body, cable, contact):
    graph = RobotGraph(robots[name], LEAN)
    assert (graph.body_count, graph.count) == (nodes, nodes + 1)
    sizes = {n: len(r.senders) for n, r in graph.relations.items()}
    assert sizes == {"body": body, "cable": cable, "contact": contact}


def test_every_edge_has_its_way_back(robots):
    for robot in robots.values():
        for config in (LEAN, PAPER):
            for relation in RobotGraph(robot, config).relations.values():
                ways = list(
                    zip(relation.senders.tolist(), relation.receivers.tolist(), strict=True)
                )
                assert sorted(ways) == sorted((b, a) for a, b in ways)


def test_groups_hold_all_edges_of_their_receivers(robots):
    for robot in robots.values():
        for config in (LEAN, PAPER):
            for relation in RobotGraph(robot, config).relations.values():
                for group in relation.groups:
                    expected = torch.tensor(group.receivers).repeat_interleave(group.degree)
                    assert torch.equal(relation.receivers[group.edges], expected)
                assert sum(group.size for group in relation.groups) == len(relation.senders)


def test_what_rounding_leaves_of_a_constant_is_no_feature():
    """The frames that an MJCF puts a robot's pieces in, which mean nothing, differ by so much."""
    rounded = np.array([[0.0, 3.0, 0.2], [8e-17, 3.0 + 4e-16, 0.1], [-3e-17, 3.0, 0.3]])
    columns = standardised(rounded)
    assert (columns[:, :2] == 0.0).all()
    np.testing.assert_allclose(columns[:, 2], [0.0, -(1.5**0.5), 1.5**0.5], atol=1e-12)


def test_cables_from_the_world_end_at_anchors(robots):
    robot = robots["platform4"]
    graph = RobotGraph(robot, LEAN)
    fixed = {tuple(end.offset) for cable in robot.cables for end in cable.ends if end.body < 0}
    assert graph.anchors.shape == (3, len(fixed)) and len(fixed) == 4


def test_axes_turn_with_robots_that_no_cable_holds_in_the_world(robots):
    turning = {name: RobotGraph(robot, LEAN).turning for name, robot in robots.items()}
    assert turning == {"prism3": True, "icosa6": True, "platform4": False, "pair": False}
    assert not RobotGraph(robots["prism3"], NetworkConfig.lean(yaw_frame=False)).turning


def test_a_body_without_a_tracked_point_is_refused(robots):
    robot = robots["prism3"]
    bare = dataclasses.replace(robot.bodies[0], points=())
    with pytest.raises(ModelError, match="no tracked point"):
        RobotGraph(dataclasses.replace(robot, bodies=(bare, *robot.bodies[1:])), LEAN)


def features(robot, config, window, controls=None):
    simulator = Simulator(robot, config)
    parts = simulator.parts()
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    state = start.states[-1]
    steps = config.control_history + config.chunk
    shape = (len(robot.winches), len(window.dataset), steps)
    controls = torch.zeros(shape) if controls is None else controls
    heading = parts.builder.heading(state)
    return parts.builder(state, start.origin, heading, controls, window.dataset), parts


def test_cable_features_between_nodes_are_what_they_are_called(robots, make_window, seed):
    robot = robots["prism3"]
    config = NetworkConfig.lean(width=16, yaw_frame=False, cable_ends="nodes", load_features=False)
    window = make_window(robot, config, seed)
    shown, parts = features(robot, config, window)
    graph, present = parts.graph, window.past_points[:, -1]
    before = window.past_points[:, -2]
    for edge in range(len(graph.relations["cable"].senders)):
        relation = graph.relations["cable"]
        cable = robot.cables[int(relation.origin[edge]) // 2]
        sender = graph.nodes[int(relation.senders[edge])].point
        receiver = graph.nodes[int(relation.receivers[edge])].point
        assert {sender, receiver} == {end.point for end in cable.ends}
        way = present[:, sender] - present[:, receiver]
        length = way.norm(dim=-1)
        speed = (way - before[:, sender] + before[:, receiver]) / config.dt
        rest = torch.full_like(length, cable.rest_length)
        if cable.winch >= 0:
            first = robot.cables[robot.winches[cable.winch].cables[0]].rest_length
            rest = rest + window.past_winch[:, -1, cable.winch] - first
        got = shown.edges["cable"][:, edge]
        torch.testing.assert_close(got[:3].t(), way, rtol=0, atol=1e-4)
        torch.testing.assert_close(got[3], length, rtol=0, atol=1e-4)
        torch.testing.assert_close(got[4:7].t(), way / length[:, None], rtol=0, atol=1e-4)
        rate = (speed * way).sum(-1) / length
        torch.testing.assert_close(got[7], rate, rtol=0, atol=2e-3)
        torch.testing.assert_close(got[8], rest, rtol=0, atol=1e-5)
        torch.testing.assert_close(got[9], length - rest, rtol=0, atol=1e-4)


def test_cable_features_between_attachments_are_what_they_are_called(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, yaw_frame=False)
    window = make_window(robot, config, seed)
    shown, parts = features(robot, config, window)
    simulator = Simulator(robot, config)
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    state, relation = start.states[-1], parts.graph.relations["cable"]
    ends, across = parts.attachments.positions(state.frames, state.sides, start.origin)
    speeds = parts.attachments.velocities(state.frames, across, state.velocities)
    nodes = torch.matmul(parts.frames.to_nodes, state.frames)
    weight = 9.81 * sum(body.mass for body in robot.bodies)
    for edge, origin in enumerate(relation.origin.tolist()):
        cable, got = robot.cables[origin // 2], shown.edges["cable"][:, edge]
        sender, receiver = ends[:, origin], ends[:, origin ^ 1]
        length = (sender - receiver).norm(dim=0)
        rate = (speeds[:, origin] - speeds[:, origin ^ 1]) * (sender - receiver) / length
        torch.testing.assert_close(got[:3], sender - receiver)
        torch.testing.assert_close(got[3], length)
        torch.testing.assert_close(got[7], rate.sum(0), rtol=0, atol=1e-4)
        torch.testing.assert_close(got[9], length - got[8], rtol=0, atol=1e-5)
        arm = receiver - nodes[:, int(relation.receivers[edge])]
        torch.testing.assert_close(got[10:13], arm, rtol=0, atol=1e-5)
        offset = cable.ends[1 - origin % 2].offset
        node = robot.points[cable.ends[1 - origin % 2].point].offset
        torch.testing.assert_close(
            arm.norm(dim=0), torch.full_like(length, float(np.linalg.norm(offset - node)))
        )
        torch.testing.assert_close(got[13:16], sender - nodes[:, int(relation.senders[edge])])
        pull, drag = cable.stiffness * got[9] / weight, cable.damping * got[7] / weight
        torch.testing.assert_close(got[16:18], torch.stack([pull, drag]).asinh())


def test_node_velocity_and_distance_to_the_ground_are_the_measured_ones(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, yaw_frame=False)
    window = make_window(robot, config, seed)
    shown, parts = features(robot, config, window)
    for node, at in enumerate(parts.graph.nodes):
        way = window.past_points[:, -1, at.point] - window.past_points[:, -2, at.point]
        got = shown.nodes["body_node"][:, node]
        torch.testing.assert_close(got[:3].t(), way / config.dt, rtol=0, atol=1e-3)
        clearance = window.past_points[:, -1, at.point, 2] - robot.points[at.point].radius
        clamp = config.ground_clamp * robot.length
        torch.testing.assert_close(got[3], clearance.clamp(max=clamp), rtol=0, atol=1e-4)


def test_velocities_are_fitted_over_the_window(robots, make_window, seed):
    robot = robots["prism3"]
    errors = []
    noise = np.random.default_rng(seed).normal(0, 0.01, (40, 41, 6, 3))
    for steps in (1, 6, 20):
        config = NetworkConfig.lean(width=16, velocity_window=steps, yaw_frame=False)
        window = make_window(robot, config, seed, samples=40, spin=0.0)
        true = (window.past_points[:, -1] - window.past_points[:, -2]) / config.dt
        window.past_points.add_(torch.from_numpy(noise[:, : config.history + 1]).float())
        shown, _ = features(robot, config, window)
        errors.append(float((shown.nodes["body_node"][:3].permute(2, 1, 0) - true).std()))
    assert errors[0] > 3 * errors[1] > 9 * errors[2], (seed, errors)


def test_contact_edges_are_there_only_near_the_ground(robots, make_network, make_window, seed):
    """What is said of the ground's edges reaches a node below the threshold, and none above it."""
    robot = robots["prism3"]
    config = NetworkConfig.lean(width=16, rounds=1, ground_clamp=0.01, contact_threshold=0.1)
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, samples=1, steps=6, spin=0.0)
    simulator = Simulator(robot, config)
    graph = simulator.parts().graph
    heights = window.past_points[0, -1, [n.point for n in graph.nodes], 2]

    def predict(height: float, loud: bool) -> torch.Tensor:
        points = window.past_points - heights.min() * torch.tensor([0, 0, 1.0])
        lift = robot.points[0].radius + height * robot.length
        raised = dataclasses.replace(window, past_points=points + torch.tensor([0, 0, lift]))
        with torch.no_grad():
            network.rounds[0].messages["contact"].linears[0].bias.fill_(3.0 if loud else 0.0)
        return simulator.unroll(network, *raised.arguments()).velocities

    assert torch.equal(
        predict(0.2, True), predict(0.2, False)
    )  # all above: the edges are not there
    near = (predict(0.05, True) - predict(0.05, False)).abs().amax(dim=(0, 1, 3))
    touching = heights - heights.min() < 0.05 * robot.length
    assert near[touching].min() > 1e-4, seed
    assert touching.all() or near[~touching].max() == 0.0, seed


def test_without_contact_edges_there_is_no_ground_node(robots):
    graph = RobotGraph(robots["prism3"], NetworkConfig.lean(contact_edges=False))
    assert graph.ground == -1 and graph.count == 6 and "contact" not in graph.relations


def test_a_slope_enters_as_height_and_normal(robots, make_window, seed):
    """On a plane that rises to the east, a robot farther west is farther from the ground."""
    robot = robots["prism3"]
    window = make_window(robot, LEAN, seed)
    normal = torch.tensor([-0.6, 0.0, 0.8]).view(3, 1, 1)

    def slope(places):
        return 0.75 * places[:1].squeeze(0), normal

    simulator = Simulator(robot, NetworkConfig.lean(width=16, ground_clamp=1e3))
    shown, distances = simulator.parts(), []
    for east in (0.0, -1.0):
        points = window.past_points + torch.tensor([east, 0.0, 0.0])
        start = simulator.start(points, window.past_controls, window.past_winch)
        distances.append(shown.builder.memory_features(start.states[-1], start.origin, slope)[3])
    torch.testing.assert_close(distances[1] - distances[0], torch.full_like(distances[0], 0.6))
    network = ChunkNetwork(robot, simulator.config)
    flat = simulator.unroll(network, *window.arguments()).points
    uphill = simulator.unroll(network, *window.arguments(), slope).points
    assert torch.isfinite(uphill).all() and not torch.equal(flat, uphill)


def test_the_data_sets_number_matters(robots, make_network, make_window, seed):
    robot = robots["prism3"]
    network = make_network(robot, LEAN, seed)
    window = make_window(robot, LEAN, seed)
    simulator = Simulator(robot, LEAN)
    said = [
        simulator.unroll(network, *window.arguments()[:4], torch.full((3,), d)).points
        for d in (0, 0, 9)
    ]
    assert torch.equal(said[0], said[1])
    assert (said[0] != said[2]).float().mean() > 0.5, seed  # how much is up to chance, untrained


def test_only_the_last_h_controls_and_the_chunks_own_matter_at_first(
    robots, make_network, make_window, seed
):
    robot = robots["prism3"]
    config = NetworkConfig.lean(width=16, control_history=5, warmup_chunks=3)
    network = make_network(robot, config, seed)
    window = make_window(robot, config, seed, steps=12)
    assert config.history == 19
    simulator = Simulator(robot, config)
    base = simulator.unroll(network, *window.arguments()).points

    def differs(past=None, ahead=None) -> list[bool]:
        other = dataclasses.replace(
            window, past_controls=window.past_controls.clone(), controls=window.controls.clone()
        )
        if past is not None:
            other.past_controls[:, past] *= -1
        if ahead is not None:
            other.controls[:, ahead] *= -1
        points = simulator.unroll(network, *other.arguments()).points
        return [bool((points[:, c] != base[:, c]).any()) for c in (slice(0, 6), slice(6, 12))]

    assert differs(past=slice(0, 14)) == [False, False]
    assert differs(past=slice(14, 15)) == [True, True]
    assert differs(ahead=slice(5, 6)) == [True, True]
    assert differs(ahead=slice(6, 12)) == [False, True]


def test_the_lstm_sees_the_measured_past_up_to_the_present(robots, make_network, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16, control_history=0)
    assert config.history == 19
    window = make_window(robot, config, seed, steps=6)
    for recurrent, when, matters in (
        (True, slice(0, 2), True),  # the oldest chunk's start, with its velocity
        (True, slice(2, 6), False),  # between two chunk starts and their velocities
        (False, slice(0, -2), False),
    ):
        config = NetworkConfig.lean(width=16, control_history=19, recurrent=recurrent)
        network = make_network(robot, config, seed)
        simulator = Simulator(robot, config)
        other = dataclasses.replace(window, past_points=window.past_points.clone())
        other.past_points[:, when] += 0.05 * torch.randn_like(other.past_points[:, when])
        said = [simulator.unroll(network, *w.arguments()).points for w in (window, other)]
        assert bool((said[0] != said[1]).any()) == matters
