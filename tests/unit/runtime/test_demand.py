"""What a configuration asks of a machine."""

import pytest

from flywheel.errors import ConfigError
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.loop import cores_of
from flywheel.validation import validated


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"collect": {"random": 10_000, "random_seconds": 3600}}, "all 36.* take about 7,2.. GB"),
        ({"network": {"dt": 1e-4}, "task": {"seconds": 3600}}, r"episodes of 3600 s \(task.seconds\)"),
        ({"task": {"seconds": 3600}, "evaluate": {"tasks": 100}}, "evaluate.full"),
        ({"iterations": 1000, "collect": {"mppi": 1000}}, "2,0.* episodes .*; at most 100,000"),
        ({"mppi": {"samples": 10_000, "horizon_seconds": 60}}, r"10,000 plans \(mppi.samples\)"),
        ({"collect": {"mppi_samples": 10_000}, "mppi": {"horizon_seconds": 60}}, "10,000 plans"),
        ({"evaluate": {"horizon_seconds": 600}}, "evaluate.horizon_seconds.* of 600 s"),
        ({"training": {"validation_windows": 10_000, "validation_seconds": 60}}, "validation_windows"),
        ({"network": {"width": 4096, "rounds": 64}}, "the weights of a network of 64 rounds"),
        ({"training": {"chunks_per_batch": 100_000}}, "batches of 100,000 chunks"),
        ({"training": {"least_windows": 10_000}}, "batches of 160,000 chunks"),
        ({"collect": {"drop_seconds": 0.001}}, r"drop_seconds \(0.001 s\) is shorter than a control step"),
        ({"mppi": {"knot_seconds": 0.123}}, "mppi.knot_seconds must be a multiple of .* 0.01 s"),
    ],
)  # fmt: skip
def test_what_no_machine_could_do_is_refused_with_what_it_would_take(asked, said):
    with pytest.raises(ConfigError, match=said):
        validated(RunConfig, asked, "x", ConfigError)


@pytest.mark.parametrize(
    "asked",
    [
        {"network": {"preset": "paper"}},  # of width 512
        {"mppi": {"samples": 1000, "horizon_seconds": 5.0}},
        {"collect": {"random": 1000, "mppi_seconds": 300.0}, "evaluate": {"tasks": 100}},
        {"collect": {"drops": 0, "drop_seconds": 0.001}},  # of which there are none
    ],
)
def test_what_a_large_machine_can_do_is_allowed(asked: dict) -> None:
    assert validated(RunConfig, asked, "x", ConfigError)


def test_no_machine_starts_far_more_processes_than_it_has_cores() -> None:
    workers = RunConfig.model_validate({"workers": {"cores": 10_000}}).workers
    with pytest.raises(ConfigError, match="workers.cores is 10,000, this machine has"):
        cores_of(workers, None)
    assert cores_of(workers, "head:6379") == 10_000
