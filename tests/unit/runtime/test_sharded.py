"""Rollouts shared out over helpers are those of the model itself, to the bit."""

import numpy as np
import pytest

from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.dynamics.gnn.learned import BLOCK
from flywheel.records import Observation, Past
from flywheel.robots import load_robot
from flywheel.runtime.workers.sharded import ShardedDynamics
from tests import draws

ROBOT = load_robot("prism3")
CONFIG = NetworkConfig(width=8, rounds=1, warmup_chunks=1)


@pytest.fixture(scope="module", params=[1, 2])
def model(request):
    return LearnedDynamics(ROBOT, ChunkNetwork(ROBOT, CONFIG), threads=request.param)


def past(batch: int, rng: np.random.Generator) -> Past:
    steps = CONFIG.history
    points = rng.normal(size=(batch, 1, len(ROBOT.points), 3)) + rng.normal(
        scale=0.01, size=(batch, steps + 1, len(ROBOT.points), 3)
    )
    winch = np.broadcast_to((ROBOT.rest_low + ROBOT.rest_high) / 2, (batch, steps + 1, 6)).copy()
    return Past(Observation(points, winch), rng.normal(size=(batch, steps, 6)) * 0.1, winch)


@pytest.mark.parametrize("same_past", [True, False])
def test_shared_out_rollouts_are_the_same_to_the_bit(model, same_past):
    seed = draws.seed()
    rng = np.random.default_rng(seed)
    count = int(rng.integers(BLOCK + 1, 3 * BLOCK))
    present = past(1 if same_past else count, rng)
    controls = rng.uniform(-0.3, 0.3, (count, 12, 6))
    asked = []

    def ask(parts):
        asked.append([len(controls) for _, controls in parts])
        answers = [model.rollout(*part) for part in parts]
        found = [(a.points, a.winch) for a in answers]
        found[1] = None  # this helper is gone
        return found

    whole, shared = (
        model.rollout(present, controls),
        ShardedDynamics(model, ask).rollout(present, controls),
    )
    assert len(asked[0]) > 1 and sum(asked[0]) == count
    np.testing.assert_array_equal(shared.points, whole.points, f"seed {seed}")
    np.testing.assert_array_equal(shared.winch, whole.winch, f"seed {seed}")


def test_what_the_oracle_alone_may_see_is_not_sent(model):
    import dataclasses

    from flywheel.dynamics.plant import Plant

    present = dataclasses.replace(past(1, np.random.default_rng(0)), state=Plant(ROBOT).rest())
    sent = []

    def ask(parts):
        sent.extend(part[0].state for part in parts)
        return [None] * len(parts)

    ShardedDynamics(model, ask).rollout(present, np.zeros((2, 6, 6)))
    assert sent == [None]
