import numpy as np
import pytest

from flywheel.dynamics.gnn import NetworkConfig
from flywheel.dynamics.plant import Plant
from flywheel.training import Schedule, Stage, TrainingConfig
from tests.unit.training.memory_cache import MemoryCache


def _cache(robot, seed: int, episodes: int, steps: int) -> MemoryCache:
    plant = Plant(robot)
    rng = np.random.default_rng(seed)
    low, high = robot.control_low, robot.control_high
    knots = rng.uniform(low, high, (episodes, -(-steps // 50), len(robot.winches)))
    controls = np.repeat(knots, 50, axis=1)[:, :steps]
    seen = plant.simulate(plant.rest(), controls).observations
    return MemoryCache(seen.points, controls, seen.winch, np.zeros(episodes, np.int64))


@pytest.fixture(scope="session")
def cache_of():
    """Random episodes of a robot: seed, how many, of how many steps."""
    return _cache


@pytest.fixture(scope="session")
def train(robot) -> MemoryCache:
    return _cache(robot, 0, 3, 200)


@pytest.fixture(scope="session")
def validation(robot) -> MemoryCache:
    return _cache(robot, 1, 2, 150)


@pytest.fixture(scope="session")
def network_config() -> NetworkConfig:
    return NetworkConfig(width=16, rounds=1, chunk=4, control_history=8, warmup_chunks=1)


@pytest.fixture
def make_config():
    """A recipe for tests: two short stages."""

    def make(steps: int = 12, **changes) -> TrainingConfig:
        stages = (Stage(chunks=1, share=0.5), Stage(chunks=2, share=0.5))
        schedule = Schedule(steps=steps, stages=stages, learning_rate=5e-3, warmup_steps=2)
        settings = {
            "initial": schedule,
            "fine_tuning": schedule,
            "chunks_per_batch": 16,
            "least_windows": 32,
            "validate_every": 5,
            "validation_windows": 4,
            "validation_seconds": 0.2,
            "checkpoint_every": 3,
            "report_every": 1,
        }
        return TrainingConfig(**(settings | changes))

    return make
