"""What one launches: `python pipelines/NAME.py`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PIPELINES = Path(__file__).parents[2] / "pipelines"
LONGEST = 40  # lines: they only launch what stands elsewhere


@pytest.mark.parametrize("file", sorted(PIPELINES.glob("*.py")), ids=lambda path: path.stem)
def test_a_pipeline_is_short_and_says_what_it_takes(file: Path, tmp_path: Path) -> None:
    assert len(file.read_text().splitlines()) <= LONGEST
    done = subprocess.run(
        [sys.executable, file, "--help"], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_nothing_of_them_is_a_package() -> None:
    assert not list(PIPELINES.rglob("__init__.py"))


@pytest.mark.ray
@pytest.mark.slow
def test_the_loop_is_turned_and_goes_on(tmp_path: Path) -> None:
    command = [
        sys.executable,
        PIPELINES / "loop.py",
        "smoke",
        "iterations=0",
        "evaluate.video=false",
    ]
    for _ in range(2):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "runs" / "smoke" / "result.json").exists()
