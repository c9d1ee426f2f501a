"""A motion is written and imported again by the benchmark; what misses a goal, or is refused, is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import log_formats
from benchmarks.log_formats import FORMATS, LogFormat, measured, table
from tests.unit.data.recordings.formats.truth import Truth, made

NPZ = next(case for case in FORMATS if case.title == "NPZ")


@pytest.fixture(scope="module")
def truth() -> Truth:
    return made(log_formats.SECONDS)


def test_a_motion_in_two_files_of_two_clocks_comes_back(truth: Truth, tmp_path: Path) -> None:
    row = measured(NPZ, truth, tmp_path)
    assert row.good and not row.problem and row.kept == 1.0
    assert 0.0 < row.offset < 1e-3 and 0.0 < abs(row.pace) < 2e-5
    assert table([row])[2].startswith("| NPZ | NumPy | 1 | ")


@pytest.mark.parametrize(
    ("change", "value", "good"),
    [
        ("offset", 2.1e-3, False),
        ("pace", -1.1e-4, False),
        ("position", 0.11, False),
        ("position", 0.09, True),
        ("problem", "refused", False),
    ],
)
def test_a_row_is_good_within_the_goals(change: str, value: object, good: bool) -> None:
    row = log_formats.LogFormatRow("a", "b", 1, 0.0, 0.0, 0.0, 1.0, 1.0, "")
    assert replace(row, **{change: value}).good is good


def test_a_wrong_number_in_a_file_and_a_refusal_are_told(truth: Truth, tmp_path: Path) -> None:
    def moved(truth: Truth, path: Path, time: np.ndarray) -> Path:
        made = NPZ.markers(truth, path, time)
        arrays = dict(np.load(made))
        arrays["markers"][700, 2, 1] += 2e-4
        np.savez(made, **arrays)
        return made

    (tmp_path / "a").mkdir()
    row = measured(replace(NPZ, markers=moved), truth, tmp_path / "a")
    assert row.position == pytest.approx(0.2, abs=1e-3) and not row.good
    (tmp_path / "b").mkdir()
    alone: LogFormat = replace(NPZ, answers={})  # no clock is asked for
    row = measured(alone, truth, tmp_path / "b")
    assert not row.good and np.isnan(row.offset) and not row.problem
