"""A draft of a map has the names of the files, and what the cables tell of the winches."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.data.recordings import guess, read_recording
from flywheel.dynamics.plant import cables_by_winches
from flywheel.errors import DataError
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import TIME, check, truth
from tests.unit.data.recordings.formats.truth import Truth, made

__all__ = ["truth"]


def test_a_draft_of_two_files_is_a_map_after_the_units_of_its_commands(
    truth: Truth, tmp_path: Path
) -> None:
    writers.motive(truth, tmp_path / "take.csv", TIME)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    text = guess([tmp_path / "motors.txt", tmp_path / "take.csv"], truth.robot, tmp_path)
    draft = yaml.safe_load(text)
    assert draft["files"][0] == {"path": "take.csv"}
    assert draft["files"][1]["time"] == "c1"
    assert draft["markers"] == {n: f"Platform:{n}" for n in writers.names(truth)}
    assert draft["axes"] == {"x": "x", "y": "-z", "z": "y"}
    assert "units" not in draft  # Motive says millimetres
    draft["commands"] = {"winch_fl": "c2", "winch_fr": "c3", "rear": {"from": "c4", "unit": "m"}}
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(draft))
    check(read_recording(tmp_path / "map.yaml", truth.robot).episodes[0].trajectory, truth)


def test_winches_without_a_name_are_told_by_the_cables(tmp_path: Path) -> None:
    truth = made(20.0)
    time = np.arange(0, 19, 0.01)
    writers.qualisys(truth, tmp_path / "take.tsv", time)
    writers.motors(truth, tmp_path / "motors.txt", time, clock=1000 * (time + 3.3))
    lines = [
        " ".join([each.split()[i] for i in (0, 3, 1, 2)])
        for each in (tmp_path / "motors.txt").read_text().splitlines()
    ]
    (tmp_path / "motors.txt").write_text("stamp gamma alpha beta\n" + "\n".join(lines) + "\n")
    draft = yaml.safe_load(
        text := guess([tmp_path / "take.tsv", tmp_path / "motors.txt"], truth.robot, tmp_path)
    )
    assert draft["commands"] == {
        "winch_fl": "alpha",
        "winch_fr": "beta",
        "rear": {"from": "gamma", "unit": "m"},
    }
    assert draft["files"][1] == {"path": "motors.txt", "time": "stamp", "unit": "ms"}
    assert "guessed by what the cables do" in text
    draft["files"][1]["align"] = "auto"
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(draft))
    read = read_recording(tmp_path / "map.yaml", truth.robot, follow=cables_by_winches)
    (words,) = [f.words for f in read.report.findings if f.kind == "clock"]
    assert "its time 0 is -3.30" in words


@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_the_unit_of_the_points_is_that_of_the_robot(
    unit: str, truth: Truth, tmp_path: Path
) -> None:
    size = {"mm": 1000, "cm": 100}[unit]
    np.savez(tmp_path / "log.npz", t=TIME, m=size * truth.points(TIME), u=truth.commands(TIME))
    draft = yaml.safe_load(text := guess([tmp_path / "log.npz"], truth.robot, tmp_path))
    assert draft["units"] == {"points": unit}
    assert draft["markers"] == {"front": "m[0]", "left": "m[1]", "right": "m[2]"}
    assert "in the order of the file" in text


def test_the_command_writes_a_draft_once(truth: Truth, tmp_path: Path) -> None:
    writers.motive(truth, tmp_path / "take.csv", TIME)
    (tmp_path / "robot.xml").write_text(truth.robot.xml)
    command = [
        "recordings",
        "guess",
        str(tmp_path / "take.csv"),
        "--robot",
        str(tmp_path / "robot.xml"),
    ]
    printed = CliRunner().invoke(app, command)
    assert printed.exit_code == 0, printed.output
    assert "Platform:front" in printed.output
    for code in (0, 2):
        done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "map.yaml")])
        assert done.exit_code == code, done.output
    assert yaml.safe_load((tmp_path / "map.yaml").read_text())["files"] == [{"path": "take.csv"}]


def test_a_file_that_cannot_be_read_gives_no_draft(truth: Truth, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"\x80\x04\x95")
    with pytest.raises(DataError, match="pickle"):
        guess([tmp_path / "a.csv"], truth.robot, tmp_path)


def test_a_file_of_poses_in_an_array_is_told_with_its_columns(truth: Truth, tmp_path: Path) -> None:
    np.savez(tmp_path / "log.npz", t=TIME, p=np.zeros((len(TIME), 6)))
    text = guess([tmp_path / "log.npz"], truth.robot, tmp_path)
    assert "or poses of bodies; there are: t, p[0], p[1], p[2], p[3], p[4], p[5]\n" in text
