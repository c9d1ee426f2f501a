"""Files of each format, made from a known motion, become an episode with its positions and commands."""

from pathlib import Path

import numpy as np
import pytest

from flywheel.data.recordings import read_map, read_recording
from flywheel.data.recordings.formats import qualisys, vicon
from flywheel.data.recordings.formats.text import columns, numbers
from flywheel.errors import DataError
from flywheel.options import ImportOptions
from flywheel.records import Trajectory
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.truth import AXES, Truth, made

TIME = np.arange(301) / writers.RATE
CLOSE = 2e-6  # [m], what the files' digits leave
MOTORS, COMMANDS = writers.MOTORS, writers.COMMANDS


@pytest.fixture(scope="session")
def truth() -> Truth:
    return made(4.0)


def imported(path: Path, text: str, truth: Truth, dt: float = 0.01) -> tuple[Trajectory, set[str]]:
    (path.parent / "map.yaml").write_text(text)
    read = read_recording(
        path, truth.robot, ImportOptions(dt=dt), how=read_map(path.parent / "map.yaml")
    )
    (episode,) = read.episodes
    return episode.trajectory, {finding.words for finding in read.report.findings}


def check(track: Trajectory, truth: Truth, hidden: bool = True) -> None:
    """Raises AssertionError if an episode is not the motion, from its beginning."""
    time = track.dt * np.arange(track.steps + 1)
    points = truth.points(time)
    got = track.observations.points
    if hidden:
        assert np.isnan(got[20:30, 1]).all()
        assert np.isnan(got[..., 0]).sum() == 10
    assert np.nanmax(np.abs(got - points)) < CLOSE
    np.testing.assert_allclose(track.controls, truth.commands(time[:-1]), atol=1e-6)


@pytest.mark.parametrize("version", ["1.1", "1.23", "1.25"])
def test_motive(version: str, truth: Truth, tmp_path: Path) -> None:
    writers.motive(truth, tmp_path / "take.txt", TIME, version)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    markers = ", ".join(f'{n}: "Platform:{n}"' for n in writers.names(truth))
    text = f"files: [{{path: take.txt}}, {MOTORS}]\n{AXES}{COMMANDS}markers: {{{markers}}}\n"
    if version == "1.1":
        with pytest.raises(DataError, match="does not say the unit of its positions"):
            imported(tmp_path / "take.txt", text, truth)
        text += "units: {points: mm}\n"
    track, words = imported(tmp_path / "take.txt", text, truth)
    check(track, truth)
    assert any("Unlabeled 1189" in each and "one marker" in each for each in words)


def test_motives_body_gives_the_points_of_its_pose(truth: Truth, tmp_path: Path) -> None:
    writers.motive(truth, tmp_path / "take.csv", TIME)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    text = f"files: [{{path: take.csv}}, {MOTORS}]\n{AXES}{COMMANDS}poses: {{platform: Platform}}\n"
    check(imported(tmp_path / "take.csv", text, truth)[0], truth, hidden=False)


def test_vicon(truth: Truth, tmp_path: Path) -> None:
    writers.vicon(truth, tmp_path / "take.csv", TIME)
    text = (
        "markers: {front: 'robot:front', left: 'robot:left', right: 'robot:right'}\n"
        "commands: {winch_fl: 'Motor - Rate.winch_fl', winch_fr: 'Motor - Rate.winch_fr',\n"
        "  rear: {from: 'Motor - Rate.rear', unit: m}}\n"
    )
    check(imported(tmp_path / "take.csv", text, truth)[0], truth)


@pytest.mark.parametrize("frames", [True, False])
def test_qualisys(frames: bool, truth: Truth, tmp_path: Path) -> None:
    writers.qualisys(truth, tmp_path / "take.tsv", TIME, frames)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    text = f"files: [{{path: take.tsv}}, {MOTORS}]\n{COMMANDS}"
    check(imported(tmp_path / "take.tsv", text, truth)[0], truth)


def test_a_qualisys_file_may_begin_with_markers_that_are_null(truth: Truth, tmp_path: Path) -> None:
    path = writers.qualisys(truth, tmp_path / "take.tsv", TIME)
    whole = qualisys.read(path, ()).streams[0].columns
    lines = path.read_text().split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("1\t"))
    lines[first] = "\t".join([*lines[first].split("\t")[:2], *["null"] * 9, ""])
    path.write_text("\n".join(lines))
    for name, values in qualisys.read(path, ()).streams[0].columns.items():
        assert len(values) == len(TIME) and np.isnan(values[0])
        np.testing.assert_array_equal(values[1:], whole[name][1:])


def test_trc(truth: Truth, tmp_path: Path) -> None:
    writers.trc(truth, tmp_path / "take.csv", TIME)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    text = f"files: [{{path: take.csv}}, {MOTORS}]\n{COMMANDS}"
    check(imported(tmp_path / "take.csv", text, truth)[0], truth)


@pytest.mark.parametrize("kind", writers.MAPS)
def test_arrays_and_messages(kind: str, truth: Truth, tmp_path: Path) -> None:
    if kind in writers.NEEDS:
        pytest.importorskip(writers.NEEDS[kind])
    made_file = tmp_path / writers.log_name(kind)
    getattr(writers, kind)(truth, made_file, TIME)
    if kind == "c3d":
        writers.motors(truth, tmp_path / "motors.txt", TIME)
    track, _ = imported(made_file, writers.MAPS[kind], truth)
    check(track, truth)


def test_what_runs_code_is_refused_before_it_is_read(tmp_path: Path, truth: Truth) -> None:
    import pickle

    (tmp_path / "a.bin").write_bytes(pickle.dumps({"a": 1}))
    (tmp_path / "b.txt").write_bytes(pickle.dumps(np.arange(3), protocol=0))
    (tmp_path / "c.yaml").write_text("!!python/object/apply:os.system [ls]\n")
    np.savez(tmp_path / "d.npz", a=np.array([{}], dtype=object), t=np.arange(3))
    for name, words in (
        ("a.bin", "pickle"),
        ("b.txt", "pickle"),
        ("c.yaml", "tags"),
        ("d.npz", "pickle"),
    ):
        with pytest.raises(DataError, match=words):
            read_recording(tmp_path / name, truth.robot)


def test_a_vicon_file_without_the_line_of_a_block_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"Trajectories \n100\n")
    with pytest.raises(DataError, match="no line begins one of its blocks"):
        vicon.read(tmp_path / "log.csv", ())


def test_points_of_thousands_are_no_decimals_where_these_have_commas() -> None:
    """German spreadsheets show 999 and 1.000."""
    metres, ticks = columns(b"0,5;999\n0,6;1.000\n", ";", 2, point=",")
    assert numbers(metres, "metres").tolist() == [0.5, 0.6]
    with pytest.raises(DataError, match="row 2 of 'ticks' is '1.000'.* without separators"):
        numbers(ticks, "ticks")
