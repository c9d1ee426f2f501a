"""Episodes in formats of others come back as they were, and are as these formats demand."""

import json
from dataclasses import replace

import numpy as np
import pandas
import pytest
from pyarrow import parquet

from flywheel.data.recordings import RecordingMap, read_recording
from flywheel.data.recordings.exports import write_lerobot, write_mcap
from flywheel.data.recordings.formats import open_log
from flywheel.errors import DataError
from flywheel.records import Episode, Observation, Provenance, Trajectory
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("platform4")


@pytest.fixture(scope="module")
def episodes(robot: Robot) -> list[Episode]:
    """Two episodes of half a second, in the first of which a marker is not seen for a while."""
    found = []
    for seed, split in enumerate(("train", "validation")):
        made = record(robot, seconds=0.5, seed=seed, measurement=Measurement())
        points = made.points.copy()
        points[20:30, 1] = np.nan if seed == 0 else points[20:30, 1]
        winch = np.full((len(points), len(robot.winches)), np.nan)
        winch[:, 0] = made.winch[:, 0]
        track = Trajectory(Observation(points, winch), made.controls, 0.01)
        origin = Provenance(robot.digest, controller="random", conditions="new cables")
        found.append(Episode(f"e{seed}", track, origin, split))
    return found


def mapped(robot: Robot, path: str, points: str, commands: str, **entry: object) -> RecordingMap:
    return RecordingMap.model_validate(
        {
            "files": [{"path": path, **entry}],
            "markers": {p.name: [f"{points}.{p.name}.{a}" for a in "xyz"] for p in robot.points},
            "commands": {w.name: f"{commands}.{w.name}" for w in robot.winches},
        }
    )


def test_a_lerobot_data_set_comes_back(robot, episodes, tmp_path):
    frames, left = write_lerobot(episodes, tmp_path / "set", robot)
    assert (frames, left) == (100, ())
    for index, episode in enumerate(episodes):
        how = mapped(robot, "set", "observation.state", "action", where={"episode_index": index})
        back = read_recording(tmp_path / "set", robot, how=how).episodes[0].trajectory
        np.testing.assert_array_equal(
            back.observations.points, episode.trajectory.observations.points[:-1]
        )
        np.testing.assert_array_equal(back.controls, episode.trajectory.controls[:-1])


def test_a_lerobot_data_set_is_what_its_description_says(robot, episodes, tmp_path):
    folder = tmp_path / "set"
    write_lerobot(episodes, folder, robot)
    info = json.loads((folder / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"]) == ("v3.0", 100)
    assert info["splits"] == {"train": "0:1", "validation": "1:2"}
    place = info["data_path"].format(chunk_index=0, file_index=0)
    frames = parquet.read_table(folder / place)
    assert set(frames.column_names) == set(info["features"])
    for name, about in info["features"].items():
        first = frames[name][0].as_py()
        assert about["shape"] == [len(first) if isinstance(first, list) else 1]
        assert about["names"] is None or len(about["names"]) == about["shape"][0]
    assert frames["index"].to_pylist() == list(range(100))
    assert frames["timestamp"].type == "float" and frames["frame_index"][51].as_py() == 1
    rows = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(r["dataset_from_index"], r["dataset_to_index"]) for r in rows] == [(0, 50), (50, 100)]
    assert rows[0]["tasks"] == ["random"] and rows[1]["flywheel/episode"] == "e1"
    tasks = pandas.read_parquet(folder / "meta/tasks.parquet")
    assert tasks.index.tolist() == ["random"] and tasks["task_index"].tolist() == [0]


def test_statistics_are_those_of_all_numbers_that_are_there(robot, episodes, tmp_path):
    write_lerobot(episodes, tmp_path / "set", robot)
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    seen = np.concatenate([e.trajectory.observations.points[:-1].reshape(50, -1) for e in episodes])
    state = stats["observation.state"]
    np.testing.assert_allclose(state["mean"], np.nanmean(seen, axis=0), rtol=1e-12)
    np.testing.assert_allclose(state["std"], np.nanstd(seen, axis=0), rtol=1e-9)
    np.testing.assert_array_equal(state["min"], np.nanmin(seen, axis=0))
    np.testing.assert_array_equal(state["max"], np.nanmax(seen, axis=0))
    numbers = [x for each in stats.values() for statistic in each.values() for x in statistic]
    assert np.isfinite(numbers).all()


def test_frames_go_into_several_files_where_one_would_be_too_large(
    robot, episodes, tmp_path, monkeypatch
):
    monkeypatch.setattr("flywheel.data.recordings.exports.lerobot.LARGEST", 0.001)
    write_lerobot(episodes, tmp_path / "set", robot)
    rows = parquet.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [row["data/file_index"] for row in rows] == [0, 1]
    (stream,) = open_log(tmp_path / "set").streams
    assert stream.columns["index"].tolist() == list(range(100))


def test_what_is_no_data_set_leaves_nothing_behind(robot, episodes, tmp_path):
    folder = tmp_path / "set"
    slower = replace(episodes[1], trajectory=replace(episodes[1].trajectory, dt=0.02))
    with pytest.raises(DataError, match=r"e1 has steps of 0.02 s, others of 0.01 s"):
        write_lerobot([episodes[0], slower], folder, robot)
    with pytest.raises(DataError, match="no episode"):
        write_lerobot([], folder, robot)
    with pytest.raises(DataError, match="not of prism3"):
        write_lerobot(episodes, folder, load_robot("prism3"))
    assert not folder.exists()
    folder.mkdir()
    with pytest.raises(DataError, match="exists already"):
        write_lerobot(episodes, folder, robot)
    assert folder.exists()


def test_an_mcap_file_comes_back(robot, episodes, tmp_path):
    pytest.importorskip("mcap")
    path = tmp_path / "e.mcap"
    assert write_mcap(episodes[0], path, robot) == ()
    how = mapped(robot, "e.mcap", "/points", "/commands")
    back = read_recording(path, robot, how=how).episodes[0].trajectory
    track = episodes[0].trajectory
    np.testing.assert_array_equal(back.observations.points, track.observations.points)
    np.testing.assert_array_equal(back.controls, track.controls)
    with pytest.raises(DataError, match="exists already"):
        write_mcap(episodes[0], path, robot)
