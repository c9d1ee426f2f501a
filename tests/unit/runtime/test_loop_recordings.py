"""Recordings of a robot take part in every turn of the flywheel, however full of holes they are."""

import math

import numpy as np
import pytest

from flywheel.data.recordings import read_recording, store_recording
from flywheel.options import ImportOptions
from flywheel.robots import load_robot
from flywheel.truth_simulator.recording import record
from tests import draws
from tests.unit.runtime.tiny_run import TINY, Bench

SPLITS = ("train", "validation", "test", "test")


def logs(folder, store, rng) -> list[str]:
    """Names of stored recordings: every second row of a log, one marker hidden for a while."""
    robot, names = load_robot("prism3"), []
    for index, split in enumerate(SPLITS):
        made = record(robot, seconds=2.0, seed=int(rng.integers(2**31)))
        begin = int(rng.integers(20, 80))
        made.points[begin : begin + 60, rng.integers(6)] = np.nan
        path, _ = made.write(folder, f"log-{index}", robot)
        header, *rows = path.read_text().splitlines()
        path.write_text("\n".join([header, *rows[::2]]) + "\n")
        read = read_recording(path, robot, ImportOptions(split=split))
        names.append(store_recording(store, read)[0])
    return names


@pytest.mark.slow
def test_recordings_are_trained_on_and_scored_apart_in_every_iteration(tmp_path):
    begun = Bench(tmp_path)
    names = logs(tmp_path / "logs", begun.store, np.random.default_rng(draws.seed()))
    bench = Bench(tmp_path, collect={**TINY["collect"], "recordings": names})
    result = bench.turn()
    tests = {name for name, split in zip(names, SPLITS, strict=True) if split == "test"}
    for turn in result.iterations:
        snapshot = bench.store.snapshot(f"i{turn.iteration:04d}-mppi")
        assert snapshot.datasets == tuple(bench.config.dataset_numbers())
        assert set(names) <= {episode.id for episode in snapshot.episodes}
        assert set(turn.recordings.by_episode) == tests
        assert not tests & set(turn.test.by_episode)
        assert names[1] in turn.validation.by_episode
        assert math.isfinite(turn.recordings.short.e_pos_rmse)
    assert set(result.persistence_on_recordings.by_episode) == tests
    assert any("recordings e_pos" in line for line in bench.said)


@pytest.mark.slow
def test_a_run_without_recordings_has_no_errors_on_them(tmp_path):
    result = Bench(tmp_path, iterations=0).turn()
    assert result.iterations[0].recordings is None
    assert result.persistence_on_recordings is None
