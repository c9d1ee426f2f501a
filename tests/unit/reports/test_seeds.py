"""Several seeds in one table: means, spreads, and pooled goals."""

import numpy as np
import pytest

from flywheel.errors import DataError
from flywheel.reports.seeds import Spread, summarise
from tests.unit.reports.fake_run import fake_run


@pytest.fixture
def runs():
    return [fake_run(3, seed) for seed in (0, 1, 2)]


def test_every_model_and_every_line_has_a_row(runs):
    assert [row.name for row in summarise(runs)] == [
        "iteration 0",
        "iteration 1",
        "iteration 2",
        "iteration 1, control arm",
        "iteration 2, control arm",
        "floor",
        "informed floor",
        "nothing moves",
        "oracle",
        "maze, never seen",
        "maze, oracle",
    ]


def test_errors_are_averaged_and_goals_are_pooled(runs):
    row = summarise(runs)[2]
    turns = [run.of_arm("mppi")[2] for run in runs]
    errors = [run.test_errors(turn).short for run, turn in zip(runs, turns, strict=True)]
    rotations = [e.e_rot for e in errors]
    assert row.e_rot.mean == pytest.approx(np.mean(rotations))
    assert (row.e_rot.low, row.e_rot.high) == (min(rotations), max(rotations))
    assert row.success.total == sum(turn.navigation.success.total for turn in turns)
    assert row.success.reached == sum(turn.navigation.success.reached for turn in turns)
    times = [s for turn in turns for s in turn.navigation.seconds_to_goal]
    assert row.seconds == np.median(times)


def test_a_number_is_shown_with_its_ends_if_runs_differ():
    assert [str(Spread(2.0, *ends)) for ends in ((1.0, 3.0), (2.0, 2.0))] == ["2 (1-3)", "2"]


def test_a_number_that_one_run_lacks_is_not_averaged_over_the_others(runs):
    runs[1] = runs[1].model_copy(update={"informed_floor": None})
    row = next(row for row in summarise(runs) if row.name == "informed floor")
    assert row.e_rot is None


def test_unfinished_runs_and_runs_of_one_seed_are_refused(runs):
    with pytest.raises(DataError, match="has not ended"):
        summarise([runs[0], fake_run(3, 1, finished=False)])
    with pytest.raises(DataError, match="different seed, got 0, 0"):
        summarise([runs[0], runs[0]])
    with pytest.raises(DataError, match="no run"):
        summarise([])


def test_runs_that_differ_in_more_than_the_seed_are_refused(runs):
    config = {**runs[1].config, "mppi": {**runs[1].config["mppi"], "samples": 32}}
    runs[1] = runs[1].model_copy(update={"config": config})
    with pytest.raises(DataError, match=r"mppi.samples: 64 -> 32"):
        summarise(runs)
