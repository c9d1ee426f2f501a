"""Results survive the disk, odd numbers included."""

import math
import random

import numpy as np
import pytest

from flywheel.errors import DataError
from flywheel.results import Navigation, RunResult, Success
from tests.unit.reports.fake_run import fake_errors, fake_run


def test_a_run_is_read_back_as_it_was_saved(tmp_path):
    seed = random.randrange(1000)
    run = fake_run(3, seed=seed)
    run.save(tmp_path)
    assert RunResult.load(tmp_path) == run, f"seed {seed}"
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_numbers_that_are_not_finite_are_read_back_as_they_were(tmp_path):
    run = fake_run(1).model_copy(update={"floor": fake_errors(math.nan), "length": math.inf})
    run.save(tmp_path)
    back = RunResult.load(tmp_path)
    assert math.isnan(back.floor.short.e_rot) and back.length == math.inf


def test_a_missing_or_damaged_file_is_named(tmp_path):
    with pytest.raises(DataError, match="started"):
        RunResult.load(tmp_path)
    (tmp_path / "result.json").write_text('{"name": "half')
    with pytest.raises(DataError, match=r"result\.json"):
        RunResult.load(tmp_path)


def test_iteration_zero_is_common_to_both_arms_and_pooled_errors_win():
    run = fake_run(3)
    assert run.arms == ("mppi", "control")
    assert [(i.iteration, i.arm) for i in run.of_arm("control")] == [
        (0, "mppi"),
        (1, "control"),
        (2, "control"),
    ]
    turn = run.iterations[1]
    other = turn.model_copy(update={"test": fake_errors(5.0)})
    assert run.test_errors(other) == turn.test
    assert run.model_copy(update={"pooled": ()}).test_errors(other) == fake_errors(5.0)


def test_rates_and_times_of_no_episode_are_unknown_not_zero():
    nothing = Navigation()
    assert math.isnan(nothing.success.rate) and math.isnan(nothing.median_seconds)
    assert nothing.success.interval == (0.0, 1.0)
    assert math.isnan(nothing.plan_quantile(0.5))


def test_the_interval_of_a_rate_is_wilsons():
    low, high = Success(reached=18, total=24).interval
    z, n, p = 1.959963984540054, 24, 0.75
    middle = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert (low, high) == pytest.approx((middle - half, middle + half))
