"""The controller in the loop, as one command, at its smallest size."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.chaos.killing import ROOT


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_the_loop_goes_round_three_times_and_into_the_maze_on_one_page(tmp_path: Path) -> None:
    command = (sys.executable, "pipelines/paper_table.py", "loop", "--size", "smoke")
    subprocess.run([*command, "--folder", tmp_path], cwd=ROOT, check=True)
    lines = (tmp_path / "table.md").read_text().splitlines()
    for name in (*(f"iteration {number}" for number in range(4)), "floor", "maze, never seen"):
        assert sum(line.startswith(f"| {name} |") for line in lines) == 1
    assert (tmp_path / "loop.png").exists() and (tmp_path / "s0" / "report.html").exists()
