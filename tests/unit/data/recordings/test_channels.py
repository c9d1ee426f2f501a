"""Tensions and lengths of cables in logs: with units and noise, to the store and back."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flywheel.data.packing import pack, unpack
from flywheel.data.recordings import RecordingMap, read_recording, write_recording
from flywheel.data.recordings.exports import write_lerobot
from flywheel.data.recordings.formats import open_log
from flywheel.errors import DataError
from flywheel.records import Episode, MeasuredChannel, Observation, Provenance, Trajectory
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator.recording import record
from tests.unit.data.recordings.formats.truth import made

FIRST, SECOND = 0, 1


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("platform4")


@pytest.fixture(scope="module")
def episode(robot: Robot) -> Episode:
    """Half a second with a tension and a length, of which samples are missing."""
    log = record(robot, seconds=0.5, seed=1)
    rng, rows = np.random.default_rng(1), len(log.points)
    tension, length = rng.normal(20, 1, rows), rng.normal(1.8, 1e-3, rows)
    tension[7] = np.nan
    names = [cable.name for cable in robot.cables]
    channels = (
        MeasuredChannel("tension", names[FIRST], tension, 0.5),
        MeasuredChannel("length", names[SECOND], length, None),
    )
    track = Trajectory(Observation(log.points, log.winch), log.controls, 0.01, channels=channels)
    return Episode("e", track, Provenance(robot.digest, source="recording"), "train")


def same(got: Trajectory, wanted: Trajectory, noises: tuple[float | None, ...]) -> None:
    for one, other, noise in zip(got.channels, wanted.channels, noises, strict=True):
        assert (one.key, one.noise) == (other.key, noise)
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12)


def test_channels_survive_the_store_and_a_csv(
    robot: Robot, episode: Episode, tmp_path: Path
) -> None:
    track = episode.trajectory
    same(unpack(*pack([episode]))[0].trajectory, track, (0.5, None))
    write_recording(episode, tmp_path / "log.csv", robot)
    same(read_recording(tmp_path / "log.csv", robot).episodes[0].trajectory, track, (None, None))
    bare = replace(track, channels=())
    with pytest.raises(DataError, match="same points"):
        pack([episode, replace(episode, id="f", trajectory=bare)])
    with pytest.raises(DataError, match="as many|51 observations, got 50"):
        replace(track, channels=(track.channels[0][1:],))


def test_a_map_tells_columns_units_and_noise(
    robot: Robot, episode: Episode, tmp_path: Path
) -> None:
    track, (one, other) = episode.trajectory, (robot.cables[i].name for i in (FIRST, SECOND))
    write_recording(episode, tmp_path / "whole.csv", robot)
    with (tmp_path / "whole.csv").open() as file:
        header, *rows = csv.reader(file)
    cells = [[float(x or "nan") for x in row] for row in rows]
    beside = [header.index(f"tension.{one}"), header.index(f"length.{other}")]
    with (tmp_path / "log.csv").open("w") as file:
        csv.writer(file).writerows([header[: beside[0]], *(row[: beside[0]] for row in rows)])
    late = [
        [
            row[0] - 0.102,
            row[beside[0]] / 9.80665,
            1000 * row[beside[1]],
            row[beside[0]] / 9.80665e-3,
        ]
        for row in cells
    ]
    with (tmp_path / "cells.csv").open("w") as file:
        csv.writer(file).writerows([["t", "pull", "wire", "far"], *late])
    winch = robot.winches[0]
    how = RecordingMap.model_validate(
        {
            "files": [{"path": "log.csv"}, {"path": "cells.csv", "time": "t", "offset": 0.1}],
            "tensions": {one: {"from": "pull", "unit": "kgf", "noise": "0.05 kgf"}},
            "lengths": {other: {"from": "wire", "unit": "mm", "noise": "0.2 mm"}},
            "winches": {winch.name: {"from": winch.sensor, "noise": 1e-4}},
        }
    )
    got = read_recording(tmp_path / "log.csv", robot, how=how).episodes[0].trajectory
    *cables, position = got.channels
    same(replace(got, channels=tuple(cables)), track, (0.05 * 9.80665, pytest.approx(2e-4)))
    assert (*position.key, position.noise) == ("winch", winch.name, 1e-4)
    np.testing.assert_array_equal(position.values, got.observations.winch[:, 0])
    wrong = how.model_copy(
        update={"lengths": {other: how.lengths[other].model_copy(update={"unit": "m"})}}
    )
    with pytest.raises(
        DataError, match=rf"the length of '{other}' is usually 180\d m, .* its unit right"
    ):
        read_recording(tmp_path / "log.csv", robot, how=wrong)
    told = {one: how.tensions[one].model_copy(update={"unit": "-kgf"})}
    with pytest.raises(
        DataError, match=rf"the tension of '{one}' is usually -[12]\d.* N, but cables pull"
    ):
        read_recording(tmp_path / "log.csv", robot, how=how.model_copy(update={"tensions": told}))
    assert not [
        f
        for f in read_recording(tmp_path / "log.csv", robot, how=how).report.findings
        if f.kind == "channel"
    ]
    told = {one: how.tensions[one].model_copy(update={"source": "far", "unit": "kgf"})}
    read = read_recording(
        tmp_path / "log.csv", robot, how=how.model_copy(update={"tensions": told})
    )
    (words,) = [f.words for f in read.report.findings if f.subject == f"tension.{one}"]
    assert "its winch pulls 2000 N at most: is its unit right?" in words
    wrong = how.model_copy(update={"tensions": {"c9": how.tensions[one]}})
    with pytest.raises(DataError, match=f"tensions has c9; the robot platform4 has {one}, {other}"):
        read_recording(tmp_path / "log.csv", robot, how=wrong)


@pytest.mark.parametrize(("factor", "far"), [(1.0, False), (100.0, True)])
def test_a_tension_far_from_its_cable_s_law_is_reported(
    factor: float, far: bool, tmp_path: Path
) -> None:
    truth, time = made(3.0), np.arange(250) / 100
    robot = truth.robot
    channel = MeasuredChannel("tension", robot.cables[2].name, np.full(250, factor * 15.0), 1.0)
    assert robot.winches[robot.cables[2].winch].kind == "position"
    seen = Observation(truth.points(time), truth.winch(time))
    track = Trajectory(seen, truth.commands(time[:-1]), 0.01, channels=(channel,))
    log = Episode("e", track, Provenance(robot.digest, "recording"), "train")
    write_recording(log, tmp_path / "log.csv", robot)
    found = read_recording(tmp_path / "log.csv", robot).report.findings
    words = [f.words for f in found if f.subject == f"tension.{robot.cables[2].name}"]
    assert [each.startswith("is usually 1500 N, but the cable is") for each in words] == [
        True
    ] * far


@pytest.mark.parametrize(
    ("where", "noise", "known"),
    [
        ("tensions", "1 Pa", "N, kN, kgf, gf, lbf"),
        ("tensions", "0.5 mm", "N, kN, kgf, gf, lbf"),
        ("lengths", "0.5 N", "m, cm, mm, in, ft"),
        ("winches", "1 Pa", "m, cm, mm, in, ft, N, kN, kgf, gf, lbf"),
    ],
)
def test_a_noise_has_a_unit_of_what_is_measured(where: str, noise: str, known: str) -> None:
    with pytest.raises(ValueError, match=f"noise is in {known}; got '{noise}'"):
        RecordingMap.model_validate({where: {"c": {"from": "x", "noise": noise}}})


def test_a_lerobot_data_set_has_channels(robot: Robot, episode: Episode, tmp_path: Path) -> None:
    write_lerobot([episode], tmp_path / "set", robot)
    columns = open_log(tmp_path / "set").streams[0].columns
    for channel in episode.trajectory.channels:
        got = columns[f"observation.{channel.kind}.{channel.name}"]
        np.testing.assert_array_equal(got, channel.values[:-1])
    bare = replace(episode, id="f", trajectory=replace(episode.trajectory, channels=()))
    with pytest.raises(DataError, match="has the same of all"):
        write_lerobot([episode, bare], tmp_path / "other", robot)
