"""What somebody changed in an MJCF, or in its commands, is found in logs of plain MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from flywheel.data.recordings import read_recording
from flywheel.diagnosis import diagnose
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.robots import load_robot
from tests import draws
from tests.recovery.edited_mjcf import EDITS, record
from tests.unit.diagnosis.conftest import QUICK

LIBRARY = {each.__name__: EFFECTS[each.__name__] for each in EDITS}
SECONDS = 2.0


@pytest.mark.slow
def test_an_edit_is_named_placed_and_measured(tmp_path: Path) -> None:
    seed, robot = draws.seed(), load_robot("prism3")
    rng = np.random.default_rng(seed)
    edit = rng.choice(EDITS)(mujoco.MjSpec.from_string(robot.xml), rng)
    record(robot.xml, edit, SECONDS, rng, tmp_path / "log.csv")
    (log,) = read_recording(tmp_path / "log.csv", robot).episodes
    found = diagnose(Plant(robot), [log.trajectory], library=LIBRARY, settings=QUICK)
    named = [(each.effect, each.location) for each in found.answers[0]]
    assert named == [(edit.effect, edit.location)], (seed, found.verdict)
    (answer,) = found.answers[0]
    (value,) = answer.values
    certain = max(0.2 * abs(edit.value), value.high - value.low)  # twice a 95 % interval
    assert value.value == pytest.approx(edit.value, abs=certain), seed
    assert found.errors.augmented < found.errors.baseline, seed
