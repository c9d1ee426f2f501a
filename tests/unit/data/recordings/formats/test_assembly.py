"""Several files with their own times, rates and units become one recording."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.data.recordings import read_map, read_recording
from flywheel.errors import ConfigError, DataError
from flywheel.records import Floats
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import (
    COMMANDS,
    MOTORS,
    TIME,
    check,
    imported,
    truth,
)
from tests.unit.data.recordings.formats.truth import HELD, Truth

__all__ = ["truth"]
FILES = f"files: [{{path: take.tsv}}, {MOTORS}]\n"


@pytest.fixture
def folder(truth: Truth, tmp_path: Path) -> Path:
    writers.qualisys(truth, tmp_path / "take.tsv", TIME)
    writers.motors(truth, tmp_path / "motors.txt", TIME)
    return tmp_path


def refused(folder: Path, text: str, truth: Truth) -> str:
    with pytest.raises((DataError, ConfigError)) as raised:
        imported(folder / "take.tsv", text, truth)
    return str(raised.value)


def markers(truth: Truth, path: Path, time: Floats, first: str = "time") -> Path:
    """A table of the points in metres."""
    names = [f"{n}.{a}" for n in writers.names(truth) for a in "xyz"]
    rows = np.concatenate([time[:, None], truth.points(time).reshape(len(time), -1)], axis=1)
    lines = [",".join([first, *names])]
    path.write_text(
        "\n".join([*lines, *(",".join(f"{v:.9f}" for v in row) for row in rows)]) + "\n"
    )
    return path


def test_a_map_without_a_log_names_the_files(folder: Path, truth: Truth) -> None:
    (folder / "monday.yaml").write_text(FILES + COMMANDS)
    (episode,) = read_recording(folder / "monday.yaml", truth.robot).episodes
    check(episode.trajectory, truth)
    (folder / "empty.yaml").write_text(COMMANDS)
    with pytest.raises(ConfigError, match="must name the logs"):
        read_recording(folder / "empty.yaml", truth.robot)


def test_offset_and_pace_turn_a_files_clock_into_the_firsts(folder: Path, truth: Truth) -> None:
    slow = np.arange(0, 3.2, 0.004)
    writers.motors(truth, folder / "motors.txt", slow, clock=(slow - 1.8) / 1.001)
    entry = MOTORS.replace("}", ", offset: 1.8, pace: 1.001}")
    text = f"files: [{{path: take.tsv}}, {entry}]\n{COMMANDS}winches: {{rear: {{from: rear, unit: mm}}}}\n"
    track, _ = imported(folder / "take.tsv", text, truth)
    got = track.observations.winch[:, 2]
    assert np.abs(got - truth.winch(0.01 * np.arange(track.steps + 1))[:, 2]).max() < 5e-5
    after = 0.01 * np.arange(track.steps) % HELD > 0.005  # not the step in which a command changes
    told = truth.commands(0.01 * np.arange(track.steps))
    np.testing.assert_allclose(track.controls[after], told[after], atol=5e-5)


def test_units_signs_ticks_and_one_column_for_two_winches(folder: Path, truth: Truth) -> None:
    text = FILES + (
        "commands: {winch_fl: -a, winch_fr: {from: a, unit: -cm/s}, rear: hold}\n"
        "winches:\n"
        "  winch_fl: {from: ticks, unit: ticks, per: 4096 / turn, drum: 20 mm}\n"
        "  rear: {from: rear, unit: mm, add: -0.1}\n"
    )
    track, _ = imported(folder / "take.tsv", text, truth)
    time = 0.01 * np.arange(track.steps + 1)
    told, winch = truth.commands(time)[:-1], truth.winch(time)
    np.testing.assert_allclose(track.controls[:, 0], -told[:, 0], atol=1e-6)
    np.testing.assert_allclose(track.controls[:, 1], -0.01 * told[:, 0], atol=1e-6)
    np.testing.assert_allclose(track.observations.winch[:, 0], winch[:, 0], atol=1e-6)
    np.testing.assert_allclose(track.observations.winch[:, 2], winch[:, 2] - 0.1, atol=1e-6)
    assert np.ptp(track.controls[:, 2]) == 0
    assert track.controls[0, 2] == pytest.approx(np.median(winch[:, 2]) - 0.1, abs=1e-3)


def test_a_position_every_half_second_is_a_recording(truth: Truth, folder: Path) -> None:
    rng = np.random.default_rng(1)
    rare = np.sort(0.01 * np.rint(100 * (0.45 * np.arange(7) + rng.uniform(0, 0.2, 7))))
    markers(truth, folder / "rare.csv", rare)
    text = f"files: [{{path: rare.csv}}, {MOTORS}]\n{COMMANDS}"
    track, words = imported(folder / "rare.csv", text, truth)
    seen = np.flatnonzero(np.isfinite(track.observations.points[:, 0, 0]))
    np.testing.assert_array_equal(seen, np.rint(100 * (rare - rare[0])).astype(int))
    assert np.abs(track.observations.points[seen] - truth.points(rare)).max() < 1e-6
    told = truth.commands(rare[0] + 0.01 * np.arange(track.steps))
    np.testing.assert_allclose(track.controls, told, atol=1e-6)
    assert any("those between are missing" in each for each in words)


def test_commands_that_are_written_only_when_they_change_hold(truth: Truth, folder: Path) -> None:
    changes = HELD * np.arange(10)
    writers.motors(truth, folder / "motors.txt", changes)
    held = COMMANDS.replace("a,", "{from: a, held: true},").replace("b,", "{from: b, held: true},")
    held = held.replace("unit: m}", "unit: m, held: true}")
    track, _ = imported(folder / "take.tsv", FILES + held, truth)
    check(track, truth)


def test_rows_without_commands_are_left_out(truth: Truth, folder: Path) -> None:
    part = TIME[(TIME > 0.995) & ((TIME < 1.605) | (TIME > 2.195))]
    writers.motors(truth, folder / "motors.txt", part)
    (folder / "map.yaml").write_text(FILES + COMMANDS)
    read = read_recording(folder / "take.tsv", truth.robot, how=read_map(folder / "map.yaml"))
    first, second = (episode.trajectory for episode in read.episodes)
    assert (first.steps, second.steps) == (61, 80)
    assert np.abs(first.observations.points - truth.points(1 + 0.01 * np.arange(62))).max() < 2e-6
    assert (
        np.abs(second.observations.points - truth.points(2.2 + 0.01 * np.arange(81))).max() < 2e-6
    )


@pytest.mark.parametrize(
    ("stamp", "unit"),
    [(lambda t: 1000 * t, "ms"), (lambda t: t / 60, "min"), (lambda t: 1e9 * t, "ns")],
)
def test_times_in_any_unit(stamp, unit: str, truth: Truth, folder: Path) -> None:
    writers.motors(truth, folder / "motors.txt", TIME, clock=stamp(TIME))
    text = FILES.replace("rear]", f"rear], unit: {unit}") + COMMANDS
    track, _ = imported(folder / "take.tsv", text, truth)
    assert (
        np.abs(track.observations.points[40:] - truth.points(TIME)[40 : track.steps + 1]).max()
        < 2e-6
    )
    np.testing.assert_allclose(track.controls, truth.commands(TIME)[: track.steps], atol=2e-2)


@pytest.mark.parametrize("zone", ["", "Z", "+01:00"])
def test_dates_as_times(zone: str, truth: Truth, tmp_path: Path) -> None:
    told = truth.commands(TIME)
    points = truth.points(TIME).reshape(len(TIME), -1)
    names = [f"{n}.{a}" for n in writers.names(truth) for a in "xyz"]
    lines = [",".join(["when", *(f"ctrl.{w.name}" for w in truth.robot.winches), "note", *names])]
    for i, now in enumerate(TIME):
        date = f"2026-11-29T10:00:{now:09.6f}{zone}"
        cells = [
            *map(repr, told[i].tolist()),
            "going, 'up'" if i % 2 else "",
            *map(repr, points[i].tolist()),
        ]
        lines.append(",".join([date, *(f'"{c}"' for c in cells)]))
    (tmp_path / "take.csv").write_text("\n".join(lines) + "\n")
    text = "files: [{path: take.csv}]\nunits: {control: m/s}\n"
    check(imported(tmp_path / "take.csv", text, truth)[0], truth, hidden=False)


def test_rows_of_one_kind_out_of_a_log_of_messages(truth: Truth, folder: Path) -> None:
    lines = (folder / "motors.txt").read_text().splitlines()
    mixed = [line for each in lines for line in (f"told {each}", f"other {each.replace('0', '7')}")]
    (folder / "motors.txt").write_text("\n".join(mixed) + "\n")
    text = (
        FILES.replace("[t,", "[kind, t,").replace("rear]", "rear], where: {kind: told}") + COMMANDS
    )
    check(imported(folder / "take.tsv", text, truth)[0], truth)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (COMMANDS, "no column 'a'"),
        (FILES, "winch_fl has no commands"),
        (FILES + COMMANDS.replace("a,", "aa,"), "Did you mean 'a'"),
        (FILES + COMMANDS + "markers: {front: frnt}", "no marker 'frnt'. Did you mean 'front'"),
        (FILES + COMMANDS + "markers: {nose: front}", "the robot platform4 has front, left, right"),
        (FILES + COMMANDS + "poses: {platform: front}", "no rotation 'front'"),
        (FILES + COMMANDS + "winches: {winch_fr: b}", "does not measure"),
        (FILES + "commands: {winch_fl: {from: a, unit: ticks/s}}", "give drum, its radius"),
        (FILES + "commands: {winch_fl: {from: a, unit: ticks/s, drum: 0.02}}", "needs per"),
        (FILES + "commands: {winch_fl: {from: a, unit: furlong}}", "one of m, cm, mm"),
        (FILES + "commands: {winch_fl: {from: a, unit: mm}}", "'mm', which is no rate; give mm/s"),
        (FILES + COMMANDS.replace("unit: m", "unit: mm/s"), "'mm/s', which is a rate; give mm"),
        (FILES + COMMANDS.replace("unit: m", "noise: 1mm"), "rear have a noise, which has no eff"),
        (FILES + "commands: {winch_fl: {hold: true, drum: 5cm}}", "drum: no effect on a winch on"),
        (FILES + COMMANDS + "markers: {front: 3}", "markers.front: must be a list; got 3"),
        (FILES + COMMANDS + "lengths: {cable_fl: {from: a, noise: 1N}}", "noise is in m, cm, mm"),
        (FILES + "commands: {winch_fl: {unit: m}}", "give from, a column, or hold"),
        (FILES.replace("motors.txt", "gone.txt") + COMMANDS, "There is no recording"),
        (FILES.replace("}, {", ", format: c4d}, {") + COMMANDS, "format is one of motive"),
        (FILES.replace("[t,", "[x,") + COMMANDS, "no column is known to be the time"),
        (
            FILES.replace("rear]", "rear], offset: 100") + COMMANDS,
            "Do the files have different clocks?",
        ),
        (FILES.replace("rear]", "rear], where: {a: 99}") + COMMANDS, "0 of 301 rows have a: 99"),
    ],
)
def test_what_a_map_lacks_is_told(text: str, words: str, truth: Truth, folder: Path) -> None:
    assert words in refused(folder, text, truth)


@pytest.mark.parametrize(
    ("time", "align", "words"),
    [
        ("nan", "", "row 301 has no time"),
        ("inf", ", align: auto", "row 301 has no time"),
        ("1e300", ", align: auto", "Is the unit of its times right?"),
    ],
)
def test_times_that_are_none_are_refused(
    time: str, align: str, words: str, truth: Truth, folder: Path
) -> None:
    lines = (folder / "motors.txt").read_text().splitlines()
    lines[-1] = " ".join([time, *lines[-1].split()[1:]])
    (folder / "motors.txt").write_text("\n".join(lines) + "\n")
    assert words in refused(folder, FILES.replace("rear]", f"rear]{align}") + COMMANDS, truth)


def test_a_marker_in_parts_is_one(truth: Truth, folder: Path) -> None:
    lines = (
        (folder / "take.tsv").read_text().replace("left", "a").replace("right", "b").splitlines()
    )
    (folder / "take.tsv").write_text("\n".join(lines) + "\n")
    text = FILES + COMMANDS + "markers: {left: [a, a], right: b}\n"
    check(imported(folder / "take.tsv", text, truth)[0], truth)
    assert "left, right of the robot" in refused(folder, FILES + COMMANDS, truth)


def test_angles_tell_the_pose_of_a_body(truth: Truth, folder: Path) -> None:
    from scipy.spatial.transform import Rotation

    place, turn = truth.pose(TIME)
    angles = Rotation.from_quat(turn).as_euler("XYZ", degrees=True)
    rows = np.concatenate([TIME[:, None], 100 * place, angles], axis=1)
    (folder / "pose.txt").write_text("\n".join(" ".join(f"{v:.8f}" for v in row) for row in rows))
    entry = "{path: pose.txt, columns: [time, px, py, pz, r, p, y]}"
    pose = (
        "poses: {platform: {position: [px, py, pz], rotation: [r, p, y], order: XYZ, unit: deg}}\n"
    )
    text = f"files: [{entry}, {MOTORS.replace('[t,', '[time,')}]\n{COMMANDS}units: {{points: cm}}\n{pose}"
    check(imported(folder / "take.tsv", text, truth)[0], truth, hidden=False)
    assert "give order, three letters" in refused(folder, text.replace("order: XYZ, ", ""), truth)
    twice = refused(folder, text.replace("order: XYZ", "order: XXZ"), truth)
    assert "order turns twice about one axis in a row; got XXZ" in twice


def test_the_frame_of_a_files_body_may_be_another(truth: Truth, folder: Path) -> None:
    from scipy.spatial.transform import Rotation

    place, turn = truth.pose(TIME)
    ours, tilt = Rotation.from_quat(turn), Rotation.from_euler("z", 90, degrees=True)
    theirs = ours * tilt.inv()  # ours in theirs is the tilt
    at = np.array([0.02, -0.01, 0.03])
    place = place - theirs.apply(at)
    rows = np.concatenate([TIME[:, None], place, theirs.as_quat(scalar_first=True)], axis=1)
    (folder / "pose.txt").write_text("\n".join(" ".join(f"{v:.9f}" for v in row) for row in rows))
    entry = "{path: pose.txt, columns: [time, px, py, pz, w, x, y, z]}"
    pose = "poses: {platform: {position: [px, py, pz], rotation: [w, x, y, z], order: wxyz, "
    pose += "at: [20 mm, -0.01, 3 cm], turned: [0.70710678, 0, 0, 0.70710678]}}\n"
    text = f"files: [{entry}, {MOTORS.replace('[t,', '[time,')}]\n{COMMANDS}{pose}"
    check(imported(folder / "take.tsv", text, truth)[0], truth, hidden=False)


def test_the_command_takes_a_log_or_a_map_that_names_it(truth: Truth, folder: Path) -> None:
    (folder / "monday.yaml").write_text(FILES + COMMANDS)
    (folder / "other.yaml").write_text(COMMANDS)
    (folder / "robot.xml").write_text(truth.robot.xml)
    base = [
        "recordings",
        "import",
        "--robot",
        str(folder / "robot.xml"),
        "--store",
        str(folder / "store"),
    ]
    named, plain = ["--map", str(folder / "monday.yaml")], ["--map", str(folder / "other.yaml")]
    done = CliRunner().invoke(app, [*base, *named])
    assert done.exit_code == 0, done.output
    assert "301 rows, 3 s at 100 Hz" in done.output
    for wrong, words in (
        (plain, "Give a log, or a map that names them"),
        ([*named, str(folder / "take.tsv")], "names its files: give no other logs"),
    ):
        refusal = CliRunner().invoke(app, [*base, *wrong])
        assert refusal.exit_code == 2
        assert words in " ".join(refusal.output.split())


def test_rows_of_points_that_were_sent_twice_are_dropped_beside_commands_of_another_file(
    folder: Path, truth: Truth
) -> None:
    lines = (folder / "take.tsv").read_text().splitlines()
    changes = round(HELD * writers.RATE)  # the row in which a command changes
    row = next(i for i, line in enumerate(lines) if line.startswith(f"{changes + 1}\t"))
    (folder / "take.tsv").write_text("\n".join([*lines[: row + 1], *lines[row:]]) + "\n")
    track, _ = imported(folder / "take.tsv", FILES + COMMANDS, truth)
    check(track, truth)


@pytest.mark.parametrize(
    ("entry", "more", "words"),
    [
        ("time: tt", "", "no column 'tt', which the map gives as time. Did you mean 't'"),
        ("time: kind", "", "the times 'kind' begin with 'told'"),
        ("where: {knd: told}", "", "no column 'knd', which the map gives as where. Did you mean"),
        ("unit: s", "columns: {time: tt}\n", "has no column 'tt'. Did you mean 't'"),
        ("unit: s", "columns: {frnt.x: a}\n", "renames 'frnt.x', which .* does not have"),
        ("unit: s", "columns: {ctrl.rear: time}\n", "gives ctrl.rear twice: under columns"),
        ("unit: s", "dt: 0.02\n", "it has times, and the map gives dt too"),
        ("offset: 1", "", "the first file's clock is that of the recording"),
        ("pace: 1.1", "", "the first file's clock is that of the recording"),
    ],
)
def test_a_part_of_a_map_without_an_effect_is_refused(
    entry: str, more: str, words: str, truth: Truth, tmp_path: Path
) -> None:
    writers.table(truth, path := tmp_path / "log.csv", TIME)
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([f"{header},kind", *(f"{row},told" for row in rows)]) + "\n")
    told = "commands: {rear: ctrl.rear}\n"
    imported(path, f"files: [{{path: log.csv, unit: s}}]\n{told}", truth)
    with pytest.raises((DataError, ConfigError), match=words):
        imported(path, f"files: [{{path: log.csv, {entry}}}]\n{more}{told}", truth)


@pytest.mark.parametrize("key", ["drum: 5 cm", "per: 100"])
def test_a_drum_of_a_winch_in_metres_is_refused(key: str, folder: Path, truth: Truth) -> None:
    text = FILES + COMMANDS.replace("rear: {", f"rear: {{{key}, ")
    assert f"for which {key.split(':')[0]} has no effect" in refused(folder, text, truth)


def test_files_of_one_name_are_told_apart_by_their_folders(truth: Truth, tmp_path: Path) -> None:
    for part in ("points", "motors"):
        (tmp_path / part).mkdir()
        writers.table(truth, tmp_path / part / "log.csv", TIME)
    files = "files: [{path: points/log.csv}, {path: motors/log.csv}]\n"
    text = files + "".join(
        f"{key}: {{{', '.join(f'{n}: {folder}/log.csv/{before}{n}' for n in names)}}}\n"
        for key, folder, before, names in (
            ("markers", "points", "", writers.names(truth)),
            ("commands", "motors", "ctrl.", [w.name for w in truth.robot.winches]),
        )
    )
    check(imported(tmp_path / "log.csv", text, truth)[0], truth)
    twice = files.replace("motors/log", "points/log")
    with pytest.raises(DataError, match="is there 2 times: is a file given twice"):
        imported(
            tmp_path / "log.csv", twice + text.split("\n", 1)[1].replace("motors", "points"), truth
        )
