"""Commands that were measured are told by their noise; commands that were given are not."""

from collections.abc import Callable

import numpy as np
import pytest

from flywheel.data.recordings import read_recording
from flywheel.data.recordings.noise import last_digit, white_noise
from tests.unit.data.recordings.conftest import SEED, Sheet


@pytest.mark.parametrize("share", [0.02, 0.35])
def test_commands_with_noise_are_told_with_its_size(share, sheet):
    log = sheet()
    names = log.cells("ctrl.")[1:3]
    for name in names:
        given = 0.3 * log.column(name)
        log.put(name, given + share * 0.3 * log.rng.standard_normal(len(given)).clip(-3, 3))
    told = read_recording(log.save(), log.robot).report.findings
    assert [(f.kind, f.action, f.subject) for f in told] == [
        ("channel", "noted", name) for name in names if share * 0.3 > 0.01 * 1.29
    ], SEED
    for finding in told:
        size = float(finding.words.split("standard deviation of ")[1].split()[0])
        assert size == pytest.approx(share * 0.3, rel=0.35), SEED


@pytest.mark.parametrize("shape", ["steps", "sine", "fast sine", "coarse"])
def test_commands_without_noise_say_nothing(shape: str, sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    time = 0.01 * np.arange(len(log.rows))
    for name in log.cells("ctrl."):
        values = {
            "steps": log.column(name),
            "sine": 0.4 * np.sin(5 * time),
            "fast sine": 0.4 * np.sin(40 * time),
            "coarse": np.round(0.4 * np.sin(3 * time), 2),
        }[shape]
        log.put(name, values)
    assert read_recording(log.save(), log.robot).report.findings == (), SEED


def test_the_noise_of_a_motion_is_that_on_it() -> None:
    rng = np.random.default_rng(5)
    time = 0.01 * np.arange(4000)[:, None]
    motion = 0.3 * np.sin(time * [2.0, 9.0, 0.0])
    assert (white_noise(motion, last_digit(motion, 1e-7)) == 0).all()
    noisy = motion + 1e-3 * rng.standard_normal(motion.shape)
    np.testing.assert_allclose(white_noise(noisy, last_digit(noisy, 1e-7)), 1e-3, rtol=0.25)
