"""Plants, pasts and corrections for the tests of the corrected plant."""

import numpy as np
import torch

from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.residual import ResidualConfig, ResidualDynamics, ResidualNetwork
from flywheel.records import Floats, Past, Trajectory
from flywheel.robots import Robot

SMALL = ResidualConfig(width=8, interval=0.2, past=0.6)
SAID = 0.3  # how much an "eager" network says, over what is typical


def plant_of(robot: Robot, threads: int = 1) -> RestartedPlant:
    return RestartedPlant(Plant(robot, threads=threads), window=5, degree=2, roll="relaxed")


def network_of(robot: Robot, seed: int, eager: bool = True) -> ResidualNetwork:
    """A network that corrects something, as trained ones do, if it is eager."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = ResidualNetwork(robot, SMALL)
        if eager:
            for decoder in (network.present, network.wrench, network.cable):
                torch.nn.init.normal_(decoder[2].weight, std=SAID)
    return network


def model_of(robot: Robot, seed: int = 0, eager: bool = True) -> ResidualDynamics:
    return ResidualDynamics(plant_of(robot), network_of(robot, seed, eager))


def moving(robot: Robot, seed: int, batch: int, steps: int = 60) -> tuple[Trajectory, Past, Floats]:
    """Motions of a plant under random controls, a past within them, and the controls from there on."""
    plant, rng = Plant(robot), np.random.default_rng(seed)
    low, high = robot.control_low, robot.control_high
    now = robot.winch_of(robot.keyframe)
    around = np.where(robot.rate_driven, 0.0, now)
    drawn = rng.uniform(-0.3, 0.3, (batch, 8, len(low))) * (high - low) / 2
    controls = np.repeat(np.clip(around + drawn, low, high), 20, axis=1)
    truth = plant.simulate(plant.rest(batch), controls)
    at = 160 - steps
    seen = truth.observations[:, : at + 1]
    return truth, Past(seen, controls[:, :at], seen.winch), controls[:, at:]
