"""The benchmark of the corrected plant, as small as it gets."""

import math

import pytest

from benchmarks import residual
from benchmarks.residual import Bench, ResidualRow, line, row_of, study, table
from benchmarks.rows import read_rows, write_rows
from flywheel.robots import load_robot
from flywheel.runtime.pool.progress import Quiet
from flywheel.training.residual import ResidualTraining


@pytest.mark.nightly
@pytest.mark.slow
def test_a_study_becomes_a_row_and_nothing_is_recorded_twice(tmp_path, monkeypatch):
    monkeypatch.setattr(residual, "SECONDS", 3.3)
    monkeypatch.setattr(residual, "FURTHER", 2)
    monkeypatch.setattr(residual, "JUDGED", ("gait", "fast_sine"))
    training = ResidualTraining(steps=2, horizon=0.5, spacing=0.4)
    bench = Bench(tmp_path, load_robot("prism3"), Quiet(), training)
    found = study(bench, "cogging", 0, 2 * 3.3 / 60, None)
    recorded = sorted(tmp_path.glob("*-learned-*.npz"))
    assert [path.stem for path in recorded] == [f"cogging-s0-learned-00{i}" for i in (0, 1)]
    assert len(list(tmp_path.glob("*-judged-*.npz"))) == 4  # with and without the effect
    row = row_of(found)
    assert 0.0 < row.floor < row.plant
    assert row.low <= row.ratio <= row.high
    assert math.isnan(row.network)
    write_rows(tmp_path / "rows.csv", [row])
    (again,) = read_rows(ResidualRow, tmp_path / "rows.csv")
    assert line(again) == line(row) == table([row])[1]
    changed = [path.stat().st_mtime_ns for path in recorded]
    bench.learned("cogging", 0, 2 * 3.3 / 60)
    assert [path.stat().st_mtime_ns for path in recorded] == changed
