"""Short recordings of a robot that is, or is not, what its plant says."""

import numpy as np
import pytest

from flywheel.diagnosis.comparison import Comparison, Subject, compare
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.options import ComparisonOptions
from flywheel.records import Trajectory
from flywheel.robots import Robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import record
from tests import draws


@pytest.fixture(scope="session")
def seed() -> int:
    """A fresh one; shown where a test fails."""
    return draws.seed()


def recordings(
    robot: Robot, effect: str, seed: int, seconds: float = 1.6, size: float = 1.0
) -> list[Trajectory]:
    """Two of them, with an effect of so many typical sizes or none."""
    rng = np.random.default_rng(seed)
    hidden = [hidden_effect(effect).typical(robot, rng).scaled(size)] if effect else []
    return [record(robot, hidden, seconds=seconds, seed=seed + i).trajectory for i in range(2)]


def plant_of(robot: Robot, name: str = "plant") -> Subject:
    return Subject(name, RestartedPlant(Plant(robot), window=20, degree=2, roll="relaxed"))


@pytest.fixture(scope="session")
def nothing_hidden(robot: Robot, seed: int) -> list[Trajectory]:
    return recordings(robot, "", seed)


@pytest.fixture(scope="session")
def found(robot: Robot, nothing_hidden: list[Trajectory], seed: int) -> Comparison:
    return compare(
        [plant_of(robot)], nothing_hidden, ComparisonOptions(horizon=0.5, draws=60, seed=seed)
    )
