"""Logs become episodes, and episodes logs, without a number changed on the way."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flywheel.data import SplitSource, TrajectoryStore, WindowCache
from flywheel.data.recordings import (
    RecordingMap,
    Units,
    read_map,
    read_recording,
    store_recording,
    stored_recordings,
    write_recording,
)
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, DataError
from flywheel.options import ImportOptions
from flywheel.records import Episode, Observation, Provenance, Trajectory
from flywheel.robots import load_robot
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import record
from tests.unit.data.recordings.conftest import SEED, Sheet

BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 30))


def same(one: Trajectory, two: Trajectory) -> None:
    np.testing.assert_array_equal(one.observations.points, two.observations.points)
    np.testing.assert_array_equal(one.observations.winch, two.observations.winch)
    np.testing.assert_array_equal(one.controls, two.controls)
    assert one.dt == two.dt


@pytest.mark.parametrize("name", ["prism3", "platform4"])
@pytest.mark.parametrize("dropout", [0.0, 0.2])
def test_a_log_from_outside_comes_in_to_the_bit(name: str, dropout: float, tmp_path: Path) -> None:
    robot = load_robot(name)
    settings = Measurement(dropout=dropout, winch_noise=0.001)
    made = record(robot, seconds=1.5, seed=SEED, measurement=settings)
    log, _ = made.write(tmp_path, "one", robot)
    read = read_recording(log, robot)
    (episode,) = read.episodes
    np.testing.assert_array_equal(episode.trajectory.observations.points, made.points)
    np.testing.assert_array_equal(episode.trajectory.controls, made.controls)
    for index, winch in enumerate(robot.winches):
        got = episode.trajectory.observations.winch[:, index]
        expected = made.winch[:, index] if winch.sensor else np.full(len(got), np.nan)
        np.testing.assert_array_equal(got, expected)
    origin = episode.provenance
    assert (origin.source, origin.dataset, origin.robot) == ("recording", "recording", robot.digest)
    assert {f.kind for f in read.report.findings} <= {"missing"}
    assert read.report.seen == pytest.approx(1 - dropout, abs=0.06), SEED


@pytest.mark.parametrize("name", ["prism3", "platform4"])
def test_an_episode_survives_the_way_out_and_in(name: str, tmp_path: Path) -> None:
    robot, rng = load_robot(name), np.random.default_rng(SEED)
    plant = Plant(robot)
    held = robot.holding(plant.winch(plant.rest()))[:, None]
    wiggle = 0.05 * rng.standard_normal((1, 80, len(robot.winches)))
    controls = np.clip(held + wiggle, robot.control_low, robot.control_high)
    track = plant.simulate(plant.settle(0.5), controls)
    seen = track.observations[0]
    points = np.where(rng.random((81, len(robot.points), 1)) < 0.1, np.nan, seen.points)
    sensed = np.array([bool(w.sensor) for w in robot.winches])
    winch = np.where(sensed, seen.winch, np.nan)
    one = Episode(
        "e",
        Trajectory(Observation(points, winch), controls[0], 0.01),
        Provenance(robot.digest),
        "train",
    )
    assert write_recording(one, tmp_path / "e.csv", robot) == ()
    same(read_recording(tmp_path / "e.csv", robot).episodes[0].trajectory, one.trajectory)
    with pytest.raises(DataError, match="not overwritten"):
        write_recording(one, tmp_path / "e.csv", robot)
    full = dataclasses.replace(
        one, trajectory=dataclasses.replace(one.trajectory, states=track.states)
    )
    assert write_recording(full, tmp_path / "f.csv", robot) == ("state",)
    other = load_robot("icosa6")
    with pytest.raises(DataError, match="not of icosa6"):
        write_recording(one, tmp_path / "g.csv", other)


def test_robots_that_fall_and_tumble_are_not_taken_for_leaps(robots, tmp_path):
    robot = robots["prism3"]
    plant = Plant(robot)
    start = plant.rest()
    start.qpos[..., [2, 9, 16]] += 1.5  # a fall from half a rod's length
    start.qvel[..., [3, 9, 15]] += 3.0
    controls = np.random.default_rng(SEED).uniform(-0.6, 0.6, (1, 150, 6))
    track = plant.simulate(start, controls)
    one = Episode(
        "e", Trajectory(track.observations[0], controls[0], 0.01), Provenance(robot.digest), "train"
    )
    write_recording(one, tmp_path / "e.csv", robot)
    findings = read_recording(tmp_path / "e.csv", robot).report.findings
    assert "leap" not in {finding.kind for finding in findings}


def test_a_log_of_50_hz_leaves_every_second_observation_missing(robots, tmp_path):
    robot = robots["prism3"]
    made = record(robot, seconds=1.0, seed=SEED, measurement=Measurement(dt=0.02))
    log, _ = made.write(tmp_path, "slow", robot)
    read = read_recording(log, robot)
    track = read.episodes[0].trajectory
    assert (track.steps, track.dt) == (100, 0.01)
    np.testing.assert_array_equal(track.observations.points[::2], made.points)
    assert np.isnan(track.observations.points[1::2]).all()
    np.testing.assert_array_equal(track.controls, np.repeat(made.controls, 2, axis=0))
    (found,) = read.report.findings
    assert found.kind == "rate" and "50 Hz on steps of 0.01 s" in found.words
    assert read.report.seen == 1.0
    whole = read_recording(log, robot, ImportOptions(dt=0.02))
    assert whole.report.findings == ()


def test_a_log_of_200_hz_keeps_the_mean_command(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    read = read_recording(log.save(), log.robot, ImportOptions(dt=0.02))
    track, made = read.episodes[0].trajectory, log.made
    np.testing.assert_array_equal(track.observations.points, made.points[::2])
    np.testing.assert_allclose(
        track.controls, made.controls.reshape(-1, 2, 6).mean(axis=1), atol=1e-12
    )
    (found,) = read.report.findings
    assert (found.kind, found.action, found.count) == ("rate", "left out", 100)


def test_stamps_that_jitter_a_little_are_taken_for_the_nearest_step(sheet):
    log = sheet()
    late = log.rng.uniform(-0.002, 0.002, len(log.rows))
    log.put("time", 1.7e9 + 0.01 * np.arange(len(log.rows)) + late)
    read = read_recording(log.save(), log.robot)
    (found,) = read.report.findings
    assert (found.kind, found.action) == ("irregular stamp", "resampled"), SEED
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)
    np.testing.assert_array_equal(read.episodes[0].trajectory.observations.points, log.made.points)


def test_a_stamp_that_is_far_off_is_masked(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.rows[60][0] = "0.6045"
    read = read_recording(log.save(), log.robot)
    (found,) = read.report.findings
    assert (found.kind, found.action, found.count) == ("irregular stamp", "masked", 1)
    gone = ~read.episodes[0].trajectory.observations.valid.any(axis=1)
    assert np.flatnonzero(gone).tolist() == [60]


def test_a_map_takes_foreign_names_units_and_axes(sheet: Callable[..., Sheet]) -> None:
    log = sheet("platform4")
    made, robot = log.made, log.robot
    for point in robot.points:  # y up and in cm, the others in mm
        log.move(point.name, log.positions(point.name)[:, [0, 2, 1]] * [1000, 100, -1000])
    log.put("time", 1000 * log.column("time"))
    for name in log.cells("position_"):
        log.put(name, 1000 * log.column(name))
    log.header = ["stamp" if name == "time" else f"their {name}" for name in log.header]
    log.header.append("battery")
    for row in log.rows:
        row.append("12")
    renamed = {n.removeprefix("their "): n for n in log.header if n.startswith("their ")}
    lines = "\n".join(
        f"  {ours}: {theirs}" for ours, theirs in {**renamed, "time": "stamp"}.items()
    )
    path = log.save()
    path.with_suffix(".yaml").write_text(
        f"columns:\n{lines}\nunits: {{time: ms, points: [mm, cm, mm], winch: mm}}\n"
        "axes: {x: x, y: -z, z: y}\nignore: [battery]\nconditions: new cables\n"
    )
    read = read_recording(path, robot)
    track = read.episodes[0].trajectory
    np.testing.assert_allclose(track.observations.points, made.points, rtol=1e-12)
    np.testing.assert_allclose(track.observations.winch[:, 0], made.winch[:, 0], rtol=1e-12)
    np.testing.assert_array_equal(track.controls, made.controls)
    assert read.episodes[0].provenance.conditions == "new cables"
    (ignored,) = read.report.findings
    assert (ignored.kind, ignored.action, ignored.subject) == ("column", "left out", "battery")


def test_a_log_that_ends_as_a_map_is_not_taken_for_a_broken_map(
    sheet: Callable[..., Sheet],
) -> None:
    log = sheet()
    path = log.folder / "echo.yaml"
    path.write_text("header:\n  stamp: 1\nx 5\n")
    with pytest.raises(ConfigError, match="(?s)is not YAML.*If it is a log, rename it"):
        read_recording(path, log.robot)


def test_columns_may_be_separated_by_blanks(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    path = log.folder / "log.txt"
    rows = [[cell or "nan" for cell in row] for row in log.rows]
    path.write_text("\n".join(" ".join(row) for row in (log.header, *rows)) + "\n")
    read = read_recording(path, log.robot)
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)


def test_a_step_that_fits_the_log_is_named_with_its_digits(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.put("time", np.round(log.column("time") / 1.2, 6))  # 120 Hz
    with pytest.raises(DataError, match=r"Give a step that fits \(--dt 0.00833333\d*\)"):
        read_recording(log.save(), log.robot)
    read = read_recording(log.save(), log.robot, ImportOptions(dt=1 / 120))
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)


def test_a_map_gives_dt_where_there_is_no_time(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    for row in (log.header, *log.rows):
        del row[0]
    read = read_recording(log.save(), log.robot, how=RecordingMap(dt=0.01))
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)


def test_commands_may_be_angles_of_a_drum(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.scale("ctrl.", -180 / np.pi / 0.05)
    how = RecordingMap(units=Units(control="-deg/s", drum=0.05))
    read = read_recording(log.save(), log.robot, how=how)
    np.testing.assert_allclose(read.episodes[0].trajectory.controls, log.made.controls, rtol=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colums: {}", "colums: unknown key. Did you mean 'columns'"),
        ("units: {point: mm}", "units.point: unknown key. Did you mean 'points'"),
        (
            "units: {points: [m, m, km]}",
            "units: units.points is one of m, cm, mm, in, ft, or three of them; got 'km'",
        ),
        ("units: {control: deg/s}", "is an angle: give units.drum"),
        ("units: {control: knots}", "units.control is one of m, cm"),
        ("axes: {x: y, y: x, z: z}", "without mirroring"),
        ("axes: {x: up}", "axes.x: Input should be 'x'"),
        ("repair: [everything]", "repair.0: Input should be 'swaps'"),
        ("dt: 0", "dt: must be a number from 0.0001 to 10 s"),
        ("dt: 1e-9", "dt: must be a number from 0.0001 to 10 s"),
        ("dt: .inf", "dt: must be a number from 0.0001 to 10 s"),
        ("jitter: .nan", "jitter: must be a number at least 0 and below 0.5; got nan"),
        ("origin: [.nan, 0, 0]", "origin.0: must be a number from -100,000,000 to"),
        ("origin: [0, 0, -1e300]", "origin.2: must be a number from -100,000,000 to"),
        ("units: {drum: 1e300}", "units.drum: must be a number from 0.0001 to 100 m"),
        ("conditions: !!timestamp 2020-02-31", "day is out of range for month"),
        ("jitter: !!int foo", "invalid literal for int()"),
        (f"jitter: {'1' * 5000}", "5000 digits"),
        ("ignore: " + 3000 * "[", "more than 60 brackets within brackets"),
        ('conditions: "\\e[31m"', "control characters are not allowed; got '\\x1b[31m'"),
        (f"conditions: {'x' * 1001}", "at most 1000 characters"),
        (f"ignore: [{'x' * 201}]", "at most 200 characters; got 'xxx"),
        ("\n".join(f"k{i}: 1" for i in range(1000)), "and 980 more"),
        ("a: &a [*a]", "contains itself"),
        (BOMB, "more than 1,000,000 values"),
        ("[1, 2]", "must be a mapping"),
        ("a: [", "log.yaml is not YAML"),
    ],
)
def test_a_wrong_map_is_refused_with_what_is_allowed(text, message, tmp_path):
    (tmp_path / "log.yaml").write_text(text)
    with pytest.raises(ConfigError) as raised:
        read_map(tmp_path / "log.yaml")
    assert message in str(raised.value)
    assert len(str(raised.value)) < 4000


@pytest.mark.parametrize(
    ("how", "message"),
    [
        (
            RecordingMap(columns={"s9.x": "a"}),
            "renames 's9.x', which the robot prism3 does not have",
        ),
        (
            RecordingMap(columns={"s0.x": "s1.x"}),
            "takes 's1.x' for more than one|takes s1.x for more",
        ),
        (RecordingMap(columns={"s0.x": "cap"}, ignore=("s0.x",)), "lacks 1 column .*: cap"),
        (RecordingMap(ignore=("s0.x",)), "ignores s0.x, which the robot needs"),
        (RecordingMap(ignore=("temperature",)), "has no column temperature to ignore"),
        (RecordingMap(dt=0.01), "has a time column 'time', and the map gives dt too"),
    ],
)
def test_a_map_that_does_not_fit_the_log_is_refused(how, message, sheet):
    log = sheet()
    with pytest.raises(DataError, match=message):
        read_recording(log.save(), log.robot, how=how)


def test_a_recording_is_stored_once_whatever_its_file_is_called(sheet, tmp_path):
    log, store = sheet(), TrajectoryStore(tmp_path / "store")
    read = read_recording(log.save("Monday, 2nd.csv"), log.robot, ImportOptions(split="test"))
    name, new = store_recording(store, read)
    assert new and name == f"recording-monday-2nd-{read.report.digest[:16]}"
    copy = read_recording(log.save("copy.csv"), log.robot)
    assert store_recording(store, copy) == (name, False)
    with pytest.raises(DataError, match="in the split test; .* train was requested"):
        store_recording(store, read_recording(log.save(), log.robot, ImportOptions(split="train")))
    with pytest.raises(DataError, match="read with other settings"):
        store_recording(store, read_recording(log.save(), log.robot, ImportOptions(dt=0.02)))
    assert list(stored_recordings(store)) == [name]
    same(store.read(name).trajectory, read.episodes[0].trajectory)


def test_training_reads_windows_of_recordings(sheet: Callable[..., Sheet], tmp_path: Path) -> None:
    log, store = sheet(), TrajectoryStore(tmp_path / "store")
    name, _ = store_recording(
        store, read_recording(log.save(), log.robot, ImportOptions(split="train"))
    )
    snapshot = store.seal("one", [name], datasets=["nominal", "recording"])
    cache = WindowCache.build(SplitSource(store, snapshot, "train", log.robot), tmp_path / "cache")
    batch = cache.gather(cache.starts(50)[:3], 50)
    assert batch.dataset.tolist() == [1, 1, 1]
    assert np.isfinite(batch.winch).all()
