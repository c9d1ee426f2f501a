"""The error budget: substitutions in a network's predictions, and the regions of windows."""

import numpy as np
import pytest
import torch

from benchmarks.budget import (
    AS_IS,
    CASES,
    EACH_CHUNK,
    EVERYTHING,
    KEPT,
    RESTARTED,
    Budget,
    measured,
    regions,
    shares_of,
)
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig, Simulator
from flywheel.robots import load_robot


@pytest.fixture(scope="module")
def budget() -> Budget:
    robot = load_robot("prism3")
    torch.manual_seed(0)
    config = NetworkConfig.lean(width=8, rounds=1, velocity_window=20)
    return Budget(robot, ChunkNetwork(robot, config), episodes=2, starts=3)


def test_without_a_substitution_it_is_the_simulators_prediction(budget: Budget) -> None:
    simulator, now = Simulator(budget.robot, budget.config), budget.config.history
    past, ahead = np.split(budget.controls, [now], axis=1)
    given = (torch.from_numpy(each) for each in (budget.seen, past, budget.known))
    with torch.no_grad():
        start, ready = simulator.start(*given), simulator.prepare(budget.network)
        rolled = simulator.roll(ready, start, torch.from_numpy(ahead), torch.tensor([0]))
    np.testing.assert_allclose(budget.predicted(CASES[AS_IS]), rolled.points, rtol=0, atol=1e-6)


def test_true_states_are_those_that_a_past_without_noise_gives(budget: Budget) -> None:
    config = budget.config.model_copy(update={"velocity_window": 1})
    simulator, at = Simulator(budget.robot, config), 30  # steps after the present
    first, last = budget.config.history + at - config.history, budget.config.history + at
    winch = budget.plant.winch(budget.states)[:, first : last + 1]
    given = budget.points[:, first : last + 1], budget.controls[:, first:last], winch
    start = simulator.start(*map(torch.from_numpy, given))
    true, seen = budget.true_states(slice(None), start.origin)[at], start.states[-1]
    for name in ("frames", "velocities", "winch"):
        np.testing.assert_allclose(getattr(true, name), getattr(seen, name), atol=2e-4)
    assert true.sides is not None and seen.sides is not None
    assert (true.sides * seen.sides).sum(0).median() > np.cos(0.05)  # computed from the cables


def test_substitutions_change_chunks_after_the_first_and_all_parts_together_leave_least(
    budget: Budget,
) -> None:
    rows, places, tables = measured(budget)
    of = {row.replaced: row for row in rows}
    assert of[EVERYTHING].e_pos < 0.5 * of[AS_IS].e_pos
    assert of[EVERYTHING].e_rot < of[AS_IS].e_rot
    assert of[EACH_CHUNK].first == of[RESTARTED].first == of[KEPT].first
    assert of[RESTARTED].e_pos < of[KEPT].e_pos < of[EACH_CHUNK].e_pos
    assert {row.region: row.error for row in places}["all"] == pytest.approx(100.0)
    assert set(tables) == set(of)
    as_is, chunk = budget.predicted(()), budget.config.chunk
    for name in ("sides", "velocities", "ground", "frames"):
        other = budget.predicted((name,))
        np.testing.assert_array_equal(other[:, :chunk], as_is[:, :chunk])
        assert (other != as_is)[:, chunk : 2 * chunk].any(), name


def test_regions_and_their_shares() -> None:
    contact, slack = np.zeros((4, 5, 2), bool), np.zeros((4, 5, 1), bool)
    contact[0, 2, 0] = True  # for a moment
    contact[1, 3:, 1] = True  # to the end
    slack[2] = True
    inside = regions(contact, slack)
    assert inside["a contact begins or ends"].tolist() == [True, True, False, False]
    assert inside["the robot tips"].tolist() == [False, True, False, False]
    assert inside["a cable is slack"].tolist() == [False, False, True, False]
    assert not inside["a cable becomes slack or taut"].any()
    assert inside["none of these"].tolist() == [False, False, False, True]
    squared = np.ones((4, 4))
    squared[1] = 5.0
    whole = shares_of((contact, slack), squared, 4)
    assert whole["the robot tips"] == (25.0, 62.5)
    halves = shares_of((contact, slack), squared, 2)  # the end of one is the beginning of the next
    assert halves["the robot tips"] == (25.0, pytest.approx(100 * 12 / 32))
