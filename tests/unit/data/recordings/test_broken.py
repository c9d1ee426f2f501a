"""Every way in which a log can be broken is named, or masked and reported."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flywheel.data.recordings import RecordingMap, read_recording
from flywheel.errors import DataError
from tests.unit.data.recordings.conftest import SEED, Sheet


def forget_header(sheet: Sheet) -> None:
    sheet.header = sheet.rows.pop(0)


def one_row(sheet: Sheet) -> None:
    del sheet.rows[1:]


def different_duplicate(sheet: Sheet) -> None:
    sheet.rows[7][0] = sheet.rows[6][0]


def backward(sheet: Sheet) -> None:
    sheet.rows[7], sheet.rows[8] = sheet.rows[8], sheet.rows[7]


def irregular(sheet: Sheet) -> None:
    sheet.put("time", np.cumsum(sheet.rng.uniform(0.001, 0.03, len(sheet.rows))))


def seconds_as_milliseconds(sheet: Sheet) -> None:
    sheet.scale("time", 1000.0)


def no_number(sheet: Sheet) -> None:
    sheet.rows[3][4] = "n/a"


def decimal_comma(sheet: Sheet) -> None:
    sheet.rows[3][4] = "0,3"


def thousands(sheet: Sheet) -> None:
    sheet.rows[3][4] = "-1,234.5"


def microseconds(sheet: Sheet) -> None:
    sheet.scale("time", 1e6)


def one_marker_for_all(sheet: Sheet) -> None:
    for point in sheet.robot.points:
        sheet.move(point.name, sheet.positions("s0"))


def other_case(sheet: Sheet) -> None:
    sheet.header[1:] = [name.upper() for name in sheet.header[1:]]


def short_line(sheet: Sheet) -> None:
    del sheet.rows[3][-1]


def command_missing(sheet: Sheet) -> None:
    sheet.rows[3][1] = ""


def command_infinite(sheet: Sheet) -> None:
    sheet.rows[3][1] = "inf"


def time_missing(sheet: Sheet) -> None:
    sheet.rows[3][0] = "nan"


def millimetres(sheet: Sheet) -> None:
    for axis in sheet.cells("s"):
        sheet.put(axis, 1000 * sheet.column(axis))


def height_in_millimetres(sheet: Sheet) -> None:
    for axis in sheet.cells("s"):
        if axis.endswith(".z"):
            sheet.put(axis, 1000 * sheet.column(axis))


def feet(sheet: Sheet) -> None:
    for axis in sheet.cells("s"):
        sheet.put(axis, sheet.column(axis) / 0.3048)


def centimetres_per_second(sheet: Sheet) -> None:
    sheet.scale("ctrl.", 100.0)


def degrees_of_the_drum(sheet: Sheet) -> None:
    sheet.scale("ctrl.", 180 / np.pi)


def beyond_the_range(sheet: Sheet) -> None:
    sheet.rows[9][2] = "1.5"


def missing_column(sheet: Sheet) -> None:
    index = sheet.header.index("s3.y")
    for row in (sheet.header, *sheet.rows):
        del row[index]


def unknown_column(sheet: Sheet) -> None:
    sheet.header.append("battery")
    for row in sheet.rows:
        row.append("12.1")


def misspelt_column(sheet: Sheet) -> None:
    sheet.header[sheet.header.index("ctrl.winch_35")] = "ctrl.winch35"


def same_column_twice(sheet: Sheet) -> None:
    sheet.header[sheet.header.index("s3.y")] = "s3.x"


def no_time(sheet: Sheet) -> None:
    for row in (sheet.header, *sheet.rows):
        del row[0]


def other_rods(sheet: Sheet) -> None:
    """A robot of the same build, with rods of 2.4 m."""
    for a, b in (("s0", "s1"), ("s2", "s3"), ("s4", "s5")):
        one, two = sheet.positions(a), sheet.positions(b)
        middle, half = (one + two) / 2, (one - two) / 2 * 2.4 / 2.95
        sheet.move(a, middle + half)
        sheet.move(b, middle - half)


def exchanged_from_the_start(sheet: Sheet) -> None:
    exchange(sheet, "s1", "s3", 0)


def y_up(sheet: Sheet) -> None:
    for point in sheet.robot.points:
        sheet.move(point.name, sheet.positions(point.name)[:, [0, 2, 1]] * [1, 1, -1])


def exchange(sheet: Sheet, one: str, two: str, begin: int, end: int | None = None) -> None:
    a, b = sheet.positions(one), sheet.positions(two)
    rows = slice(begin, end)
    a[rows], b[rows] = b[rows].copy(), a[rows].copy()
    sheet.move(one, a)
    sheet.move(two, b)


REFUSED = [
    (forget_header, "has no header: its first line is 0.0, .* time, ctrl.<actuator>"),
    (one_row, "has 1 rows under its header; a recording needs at least 2"),
    (different_duplicate, "line 9: the time 0.06 s is in two different rows"),
    (backward, "line 10: time runs backward, from 0.08 to 0.07 s, 1 time in all"),
    (irregular, "irregular time stamps: only .* samples .* grid of 0.01 s.*jitter"),
    (seconds_as_milliseconds, r"rows are 10 s apart, .* write units: \{time: ms\}"),
    (no_number, "line 5, column 'ctrl.winch_02': 'n/a' is not a number"),
    (decimal_comma, "'0,3' is not a number.*with a point"),
    (thousands, "'-1,234.5' is not a number.*without separators"),
    (microseconds, r"rows are 10000 s apart, .* write units: \{time: us\}"),
    (one_marker_for_all, "distances on 3 of 3 pairs .*: s0 to s1 is 0 m instead of 2.95 m"),
    (other_case, "CTRL.WINCH_35, .*Did you mean 'ctrl.winch_35'"),
    (short_line, "line 5 has 24 cells, the header has 25 columns"),
    (command_missing, "line 5: the command in 'ctrl.winch_35' is missing, in 1 place in all"),
    (command_infinite, "line 5: the command in 'ctrl.winch_35' is inf"),
    (time_missing, "line 5: the time in 'time' is missing"),
    (millimetres, r"the MJCF says 2.95 m, .* in mm: write units: \{points: mm\}"),
    (height_in_millimetres, r"if their z were in mm: write units: \{points: \[m, m, mm\]\}"),
    (feet, r"in ft: write units: \{points: ft\}"),
    (centimetres_per_second, r"allowed are -0.645 to 0.645 m/s; .*\{control: cm/s\}"),
    (degrees_of_the_drum, r"degrees for radians of a drum \(units: \{control: deg/s"),
    (
        beyond_the_range,
        "'ctrl.winch_13' is 1.5 m/s, allowed are .*; 1 command out of range, of ctrl.winch_13.$",
    ),
    (missing_column, "lacks 1 column of the robot prism3: s3.y"),
    (unknown_column, "1 column that the robot prism3 does not have: battery.*under ignore"),
    (misspelt_column, "ctrl.winch35. Did you mean 'ctrl.winch_35'"),
    (same_column_twice, "columns of the same name: 's3.x'"),
    (no_time, "has no column 'time'.*or give dt"),
    (other_rods, "s0 to s1 is 2.(4|39).* m instead of 2.95 m.*another robot"),
    (exchanged_from_the_start, "Swapping s0 with s2 or s1 with s3 would make them right"),
    (y_up, r"below the ground.*axes: \{x: x, y: -z, z: y\}"),
]


@pytest.mark.parametrize(
    ("break_it", "message"), REFUSED, ids=lambda value: getattr(value, "__name__", "")
)
def test_a_broken_log_is_refused_with_where_and_why(break_it, message, sheet):
    broken = sheet()
    break_it(broken)
    with pytest.raises(DataError) as raised:
        read_recording(broken.save(), broken.robot)
    assert re.search(message, str(raised.value)), f"{raised.value} (seed {SEED})"
    assert "log.csv" in str(raised.value)


@pytest.mark.parametrize("end", [0, None])
def test_columns_without_a_name_are_not_asked_about(end, sheet):
    """Spreadsheets end lines with separators, and pandas begins them with a number."""
    usual, padded = sheet(), sheet()
    for number, row in enumerate((padded.header, *padded.rows)):
        place = len(row) if end is None else end
        row[place:place] = [str(number or "")] if end == 0 else ["", ""]
    found = read_recording(padded.save(), padded.robot).episodes[0].trajectory
    kept = read_recording(usual.save(), usual.robot).episodes[0].trajectory
    np.testing.assert_array_equal(found.observations.points, kept.observations.points)


@pytest.mark.parametrize("content", ["", "\n \n"])
def test_an_empty_file_is_refused(content, tmp_path, sheet):
    (tmp_path / "log.csv").write_text(content)
    with pytest.raises(DataError, match="log.csv is empty"):
        read_recording(tmp_path / "log.csv", sheet().robot)


def test_a_file_that_is_not_there_is_named(tmp_path: Path, sheet: Callable[..., Sheet]) -> None:
    with pytest.raises(DataError, match="no recording .*nothing.csv"):
        read_recording(tmp_path / "nothing.csv", sheet().robot)


def test_a_log_of_another_robot_is_refused(sheet: Callable[..., Sheet]) -> None:
    with pytest.raises(DataError, match="prism3 does not have: ctrl.winch_fl.*another robot"):
        read_recording(sheet("platform4").save(), sheet().robot)


def test_winch_positions_in_another_unit_are_refused(sheet: Callable[..., Sheet]) -> None:
    log = sheet("platform4")
    log.scale("position_", 1000.0)
    with pytest.raises(DataError, match="'position_fl' is usually .* from 0.8 to 2.8 m.*winch: mm"):
        read_recording(log.save(), log.robot)


def test_rows_that_repeat_are_left_out_and_counted(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.rows.insert(50, list(log.rows[50]))
    read = read_recording(log.save(), log.robot)
    (found,) = read.report.findings
    assert (found.kind, found.action, found.count) == ("duplicate stamp", "left out", 1)
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)


@pytest.mark.parametrize(
    ("cell", "kind"), [("nan", "missing"), ("", "missing"), ("-inf", "infinite")]
)
def test_a_sample_that_is_no_position_masks_its_marker(cell, kind, sheet):
    log = sheet()
    rows = np.sort(log.rng.choice(200, 5, replace=False))
    for row in rows:
        log.rows[row][log.header.index("s4.y")] = cell
    read = read_recording(log.save(), log.robot)
    (found,) = read.report.findings
    assert (found.kind, found.action, found.subject, found.count) == (kind, "masked", "s4", 5)
    gone = ~read.episodes[0].trajectory.observations.valid
    assert np.flatnonzero(gone[:, 4]).tolist() == rows.tolist(), SEED
    assert gone.sum() == 5


def test_one_missing_row_is_bridged_and_a_gap_begins_another_episode(sheet):
    log = sheet()
    del log.rows[120:150], log.rows[40]
    read = read_recording(log.save(), log.robot)
    first, second = read.episodes
    assert (first.trajectory.steps, second.trajectory.steps) == (119, 50)
    assert first.split == second.split
    assert not first.trajectory.observations.valid[40].any()
    controls = log.made.controls.copy()
    controls[40] = controls[39]
    np.testing.assert_array_equal(first.trajectory.controls, controls[:119])
    np.testing.assert_array_equal(second.trajectory.controls, controls[150:])
    bridged, split = (f for f in read.report.findings if f.kind == "gap")
    assert (bridged.action, bridged.count) == ("masked", 1)
    assert (split.action, split.count) == ("split", 30)
    assert split.spans == (pytest.approx((1.19, 1.5)),)


PAIRS = [("s0", "s1"), ("s1", "s3"), ("s0", "s5"), ("s2", "s4")]  # on one rod, and on two


@pytest.mark.parametrize(("one", "two"), PAIRS)
@pytest.mark.parametrize("repair", [False, True])
def test_exchanged_markers_are_found_with_their_times(one, two, repair, sheet):
    log = sheet()
    begin, end = log.rng.integers(20, 90), log.rng.integers(100, 190)
    exchange(log, one, two, begin, end)
    how = None if repair else RecordingMap(repair=())
    read = read_recording(log.save(), log.robot, how=how)
    (found,) = read.report.findings
    assert (found.kind, found.subject) == ("swap", f"{one} and {two}"), SEED
    assert found.count == end - begin, SEED
    assert found.spans == (pytest.approx((0.01 * begin, 0.01 * (end - 1))),), SEED
    points = read.episodes[0].trajectory.observations.points
    if repair:
        np.testing.assert_array_equal(points, log.made.points)
        assert found.action == "repaired" and "repair: []" in found.words
    else:
        names = [p.name for p in log.robot.points]
        expected = log.made.points.copy()
        expected[begin:end, [names.index(one), names.index(two)]] = np.nan
        np.testing.assert_array_equal(points, expected)
        assert found.action == "masked"


@pytest.mark.parametrize("back", [False, True])
def test_exchanged_markers_that_come_back_from_anywhere_are_not_guessed(back, sheet):
    log = sheet()
    begin, unseen = log.rng.integers(20, 40), log.rng.integers(60, 80)
    seen = unseen + 80  # 0.8 s later, and elsewhere: the rod may have been turned round
    expected = log.made.points.copy()
    expected[seen:, :, 0] += 2.0
    expected[unseen:seen] = np.nan
    exchange(log, "s0", "s1", begin, unseen if back else len(log.rows))
    for column in log.cells("s"):
        values = log.column(column)
        values[unseen:seen] = np.nan
        values[seen:] += 2.0 if column.endswith(".x") else 0.0
        log.put(column, values)
    read = read_recording(log.save(), log.robot)
    points = read.episodes[0].trajectory.observations.points
    expected[seen:, :2] = np.nan
    np.testing.assert_allclose(points, expected, rtol=0, atol=1e-12)
    repaired, *masked = (f for f in read.report.findings if f.kind == "swap")
    assert (repaired.action, repaired.count) == ("repaired", unseen - begin), SEED
    assert [(m.action, m.subject, m.count) for m in masked] == [
        ("masked", name, len(log.rows) - seen) for name in ("s0", "s1")
    ], SEED


def test_exchanged_markers_of_which_one_was_unseen_stay_known(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    begin, unseen = log.rng.integers(20, 40), log.rng.integers(60, 80)
    hidden = log.rng.choice(["s0", "s1"])
    exchange(log, "s0", "s1", begin, len(log.rows))
    for column in log.cells(hidden):
        values = log.column(column)
        values[unseen : unseen + 80] = np.nan
        log.put(column, values)
    read = read_recording(log.save(), log.robot)
    points = read.episodes[0].trajectory.observations.points
    known = np.isfinite(points)
    np.testing.assert_array_equal(points[known], log.made.points[known])
    assert np.count_nonzero(~known[..., 0]) == 80, SEED


def test_a_marker_that_leaps_is_masked_while_it_is_away(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    rows = np.sort(log.rng.choice(np.arange(5, 195), 3, replace=False))
    away = log.column("s2.x")
    away[rows] += log.rng.choice([-1, 1]) * log.rng.uniform(0.8, 2.0, 3)
    log.put("s2.x", away)
    read = read_recording(log.save(), log.robot)
    (found,) = read.report.findings
    assert (found.kind, found.action, found.subject, found.count) == ("leap", "masked", "s2", 3), (
        SEED
    )
    expected = log.made.points.copy()
    expected[rows, 2] = np.nan
    np.testing.assert_array_equal(read.episodes[0].trajectory.observations.points, expected)


def test_a_marker_that_slips_along_its_rod_is_masked_with_its_partner(sheet):
    log = sheet()
    share = np.linspace(-0.3, 0.15, 201).clip(0)  # slowly, so that it never leaps
    one, two = log.positions("s2"), log.positions("s3")
    log.move("s2", one + share[:, None] * (two - one))
    read = read_recording(log.save(), log.robot)
    kinds = {(f.kind, f.subject, f.action) for f in read.report.findings}
    assert kinds == {("rod length", "s2", "masked"), ("rod length", "s3", "masked")}, SEED


def test_a_robot_that_floats_is_reported_and_the_map_puts_it_down(sheet):
    log = sheet()
    for point in log.robot.points:
        log.put(f"{point.name}.z", log.column(f"{point.name}.z") + 1.2)
    (found,) = read_recording(log.save(), log.robot).report.findings
    assert (found.kind, found.action) == ("height", "noted") and "the ground at 0" in found.words
    down = read_recording(log.save(), log.robot, how=RecordingMap(origin=(0, 0, -1.2)))
    assert down.report.findings == ()
    np.testing.assert_allclose(
        down.episodes[0].trajectory.observations.points, log.made.points, atol=1e-12
    )
