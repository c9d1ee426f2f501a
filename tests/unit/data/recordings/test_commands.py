"""Command scripts are written and read back as they were; what is none is refused."""

import errno
from pathlib import Path

import numpy as np
import pytest

from flywheel.data.recordings.commands import read_commands, write_commands
from flywheel.data.recordings.writing import new_csv
from flywheel.errors import DataError, RunError
from flywheel.robots import Robot, load_robot
from tests import draws


@pytest.fixture(scope="module")
def prism() -> Robot:
    return load_robot("prism3")


@pytest.fixture
def script(prism: Robot) -> np.ndarray:
    """(50, W) random commands."""
    return np.random.default_rng(draws.seed()).uniform(-0.6, 0.6, (50, len(prism.winches)))


def test_a_script_comes_back_to_the_bit(prism: Robot, script: np.ndarray, tmp_path: Path) -> None:
    path = write_commands(script, 0.01, tmp_path / "a.csv", prism)
    assert np.array_equal(read_commands(path, prism), script)
    with pytest.raises(DataError, match="not overwritten"):
        write_commands(script, 0.01, path, prism)


def test_another_control_step_holds_or_averages(prism, script, tmp_path):
    path = write_commands(script, 0.02, tmp_path / "a.csv", prism)
    assert np.allclose(read_commands(path, prism, dt=0.01), np.repeat(script, 2, axis=0))
    pairs = script.reshape(25, 2, -1).mean(axis=1)
    assert np.allclose(read_commands(path, prism, dt=0.04), pairs)


def test_points_of_a_recording_are_not_looked_at(prism, script, tmp_path):
    path = write_commands(script, 0.01, tmp_path / "a.csv", prism)
    lines = path.read_text().splitlines()
    with_points = [lines[0] + ",s0.x", *(line + ",9999" for line in lines[1:])]
    path.write_text("\n".join(with_points))
    assert np.array_equal(read_commands(path, prism), script)


def test_what_is_no_script_of_the_robot_is_refused(prism, script, tmp_path):
    path = write_commands(script, 0.01, tmp_path / "a.csv", prism)
    lines, other = path.read_text().splitlines(), tmp_path / "b.csv"
    rest = lines[6].split(",", 2)[2]
    for content, message in {
        (lines[0].replace("winch_35", "winch_36"), *lines[1:]): "Did you mean 'ctrl.winch_35'",
        (*lines[:20], *lines[30:]): "b.csv: a gap: there are no commands from 0.18 to 0.29 s",
        (*lines[:6], f"0.05,7,{rest}", *lines[7:]): "7 m/s, allowed are -0.645 to 0.645 m/s",
        (
            *lines[:6],
            f"0.05,,{rest}",
            *lines[7:],
        ): "line 7: the command in 'ctrl.winch_35' is missing",
        (lines[0],): "recording needs at least 2",
    }.items():
        other.write_text("\n".join(content))
        with pytest.raises(DataError, match=message):
            read_commands(other, prism)
    with pytest.raises(DataError, match="There is no recording"):
        read_commands(tmp_path / "none.csv", prism)
    with pytest.raises(
        DataError, match="A control step, dt, must be a number from 0.0001 to 10 s; got 0.0"
    ):
        read_commands(path, prism, dt=0.0)


def test_text_beside_the_commands_is_not_looked_at(prism, script, tmp_path):
    path = write_commands(script, 0.01, tmp_path / "a.csv", prism)
    head, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{head},s0.x,note", *(f"{row},unseen,windy" for row in rows)]))
    (tmp_path / "a.yaml").write_text("ignore: [note]")
    assert np.array_equal(read_commands(path, prism), script)


def test_a_script_that_could_not_be_written_to_its_end_is_not_left_behind(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="The log cannot be written: .*a.csv: the disk is full"):
        with new_csv(tmp_path / "a.csv") as writer:
            writer.writerow(["time"])
            raise OSError(errno.ENOSPC, "No space left on device")
    with pytest.raises(KeyboardInterrupt):
        with new_csv(tmp_path / "a.csv"):
            raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
