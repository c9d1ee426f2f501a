"""The command that counts how often a diagnosis is right, on a real Ray."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flywheel.robots import load_robot
from flywheel.runtime.examination import CaseResult
from tests.conftest import Stranger


@pytest.mark.ray
@pytest.mark.slow
def test_a_case_is_diagnosed_counted_and_not_made_again(stranger: Stranger, tmp_path: Path) -> None:
    command = (
        f".venv/bin/flywheel diagnose-bench {tmp_path} --robot platform4 --groups single --sizes 1 --seeds 1 "
        "--only weak_cable"
    )
    printed, _ = stranger.run(command)
    assert "all: single" in printed and "100%" in printed
    (file,) = tmp_path.glob("*.json")
    written, result = file.stat().st_mtime_ns, CaseResult.model_validate_json(file.read_text())
    assert result.name == file.stem == "platform4.single.weak_cable.x1.s0"
    assert (result.verdict, result.failure) == ("EFFECT", "")
    assert result.first_is_right and result.contains_truth
    assert result.augmented < result.baseline
    assert max(result.augmented, result.held_out) < 1.1 * result.noise
    steps, own = np.array(result.time_steps), load_robot("platform4").timestep
    assert len(steps) and ((steps > 0) & (steps <= own)).all()
    again, _ = stranger.run(command)
    assert file.stat().st_mtime_ns == written
    assert "all: single" in again
