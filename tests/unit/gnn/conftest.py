"""Windows of a robot whose bodies fly apart rigidly: easy to make, and exact in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
from flywheel.robots import Robot, load_robot
from flywheel.terrain import Box
from tests import draws
from tests.antagonists import antagonists


@dataclass(frozen=True)
class Window:
    """Arguments of `Simulator.unroll`, and what flying bodies really do."""

    past_points: torch.Tensor
    past_controls: torch.Tensor
    past_winch: torch.Tensor
    controls: torch.Tensor
    dataset: torch.Tensor
    points: torch.Tensor

    def arguments(self) -> tuple[torch.Tensor, ...]:
        return (self.past_points, self.past_controls, self.past_winch, self.controls, self.dataset)


def boxes_around(seed: int) -> tuple[Box, ...]:
    """Three, in any orientation, where bodies fly."""
    rng = np.random.default_rng(seed)
    quaternions = Rotation.random(3, random_state=rng).as_quat(scalar_first=True)
    return tuple(
        Box(center=tuple(center), half_size=tuple(half), quaternion=tuple(quaternion))
        for center, half, quaternion in zip(
            rng.normal(0, 1.5, (3, 3)) + [0, 0, 2.0],
            rng.uniform(0.2, 1.0, (3, 3)),
            quaternions,
            strict=True,
        )
    )


def fly(robot: Robot, seed: int, samples: int, steps: int, dt: float, spin: float) -> np.ndarray:
    """(B, T, P, 3) points of bodies that move at constant velocity and turn at constant rate."""
    rng = np.random.default_rng(seed)
    times = dt * np.arange(steps)
    points = np.zeros((samples, steps, len(robot.points), 3))
    for b, body in enumerate(robot.bodies):
        place = rng.normal(0, 1.0, (samples, 1, 3)) + [0, 0, 2.0]
        velocity = rng.normal(0, 0.5, (samples, 1, 3))
        start = Rotation.random(samples, random_state=rng)
        rate = spin * rng.normal(0, 1.0, (samples, 3))
        for p in (p for p, point in enumerate(robot.points) if point.body == b):
            arm = robot.points[p].offset - body.com
            for t, time in enumerate(times):
                turned = (Rotation.from_rotvec(rate * time) * start).apply(arm)
                points[:, t, p] = place[:, 0] + velocity[:, 0] * time + turned
    return points


@pytest.fixture(scope="session")
def robots() -> dict[str, Robot]:
    shipped = {name: load_robot(name) for name in ("prism3", "icosa6", "platform4")}
    return shipped | {"pair": antagonists()}


@pytest.fixture
def seed() -> int:
    """A fresh one for every test; pytest prints it where a test fails."""
    return draws.seed()


@pytest.fixture
def make_window() -> Callable[..., Window]:
    def make(
        robot: Robot,
        config: NetworkConfig,
        seed: int,
        samples: int = 3,
        steps: int = 12,
        spin: float = 0.3,
    ) -> Window:
        rng = np.random.default_rng(seed)
        history, winches = config.history, len(robot.winches)
        points = fly(robot, seed, samples, history + 1 + steps, config.dt, spin)
        low, high = robot.control_low, robot.control_high
        controls = rng.uniform(low, high, (samples, history + steps, winches))
        rest = rng.uniform(robot.rest_low, robot.rest_high, (samples, winches))
        winch = robot.dead_reckon(rest, controls[:, :history], config.dt)

        def tensor(array: np.ndarray) -> torch.Tensor:
            return torch.from_numpy(array).float()

        return Window(
            past_points=tensor(points[:, : history + 1]),
            past_controls=tensor(controls[:, :history]),
            past_winch=tensor(winch),
            controls=tensor(controls[:, history:]),
            dataset=torch.from_numpy(rng.integers(0, config.datasets, samples)),
            points=tensor(points[:, history + 1 :]),
        )

    return make


@pytest.fixture
def make_network() -> Callable[..., ChunkNetwork]:
    def make(robot: Robot, config: NetworkConfig, seed: int) -> ChunkNetwork:
        """Random weights whose outputs are not small, and random normalisation."""
        torch.manual_seed(seed)
        network = ChunkNetwork(robot, config)
        with torch.no_grad():
            for parameter in network.node_decoder.linears[-1].parameters():
                parameter.mul_(10.0)
            for normaliser in network.normalisers.values():
                size = len(normaliser.mean)
                mean = 0.3 * normaliser.scale * torch.randn(size)
                normaliser.fit(mean, normaliser.scale * (0.2 + torch.rand(size)))
        return network

    return make
