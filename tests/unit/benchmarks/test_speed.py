"""`python -m benchmarks.speed` measures in turns, says what it measured on, and refuses nonsense."""

import json

import pytest
from typer.testing import CliRunner

from benchmarks.speed import benches, network
from benchmarks.speed.__main__ import app, parsed_threads
from benchmarks.speed.benches import BENCHES
from flywheel.errors import ConfigError

run = CliRunner().invoke


@pytest.mark.slow
@pytest.mark.parametrize("name", BENCHES)
def test_a_bench_gives_finite_numbers_in_the_table_and_in_json(name, tmp_path, monkeypatch):
    monkeypatch.setattr(benches, "PLANS", (8,))
    monkeypatch.setattr(benches, "PLAN_SECONDS", 0.5)
    monkeypatch.setattr(network, "_LEAST_ROUNDS", 1)
    monkeypatch.setattr(network, "STEPS", 16)
    file = tmp_path / "bench.json"
    done = run(
        app,
        ["--only", name, "--threads", "1", "--seconds", "0.01", "--output", str(file)],
        catch_exceptions=False,
    )
    assert done.exit_code == 0
    record = json.loads(file.read_text())
    assert record["machine"]["cores"] >= 1
    assert record["measurements"]
    for measured in record["measurements"]:
        assert measured["value"] > 0
        assert measured["of"] in done.output


@pytest.mark.parametrize(
    "text", ["", "0", "1,", "two", "1,-2", "nan", "inf", "1e300", "5%", "1" * 5000]
)
def test_threads_that_are_no_numbers_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="1,2"):
        parsed_threads(text)


def test_an_unknown_bench_is_bad_input_and_the_known_ones_are_listed() -> None:
    done = run(app, ["--only", "plants"])
    assert done.exit_code == 2
    assert "Did you mean 'plant'" in done.stderr
