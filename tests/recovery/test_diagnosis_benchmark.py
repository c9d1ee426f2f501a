"""The benchmark that counts how often a diagnosis is right, on a real Ray."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis.case_result import CaseResult
from flywheel.robots import load_robot

ROOT = Path(__file__).parents[2]


@pytest.mark.nightly
@pytest.mark.ray
@pytest.mark.slow
def test_a_case_is_diagnosed_and_counted(tmp_path: Path) -> None:
    options = "--robot platform4 --groups single --sizes 1 --seeds 1 --only weak_cable"
    command = [sys.executable, "-m", "benchmarks.diagnosis", str(tmp_path), *options.split()]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    assert "all: single" in done.stdout and "100%" in done.stdout
    (file,) = tmp_path.glob("*.json")
    result = CaseResult.model_validate_json(file.read_text())
    assert result.name == file.stem == "platform4.single.weak_cable.x1.s0"
    assert (result.verdict, result.failure) == ("EFFECT", "")
    assert result.first_is_right and result.contains_truth
    assert result.augmented < result.baseline
    assert max(result.augmented, result.held_out) < 1.1 * result.noise
    steps, own = np.array(result.time_steps), load_robot("platform4").timestep
    assert len(steps) and ((steps > 0) & (steps <= own)).all()
