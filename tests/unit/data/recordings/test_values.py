"""Numbers that no robot can have are refused or masked, whatever they would do to arithmetic."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from flywheel.data.recordings import Imported, RecordingMap, Units, read_recording
from flywheel.data.recordings.clock import MOST_GAPS
from flywheel.data.recordings.commands import read_commands
from flywheel.data.recordings.grid import most_rows
from flywheel.data.recordings.tables.columns import winch_names
from flywheel.errors import DataError, FlywheelError
from flywheel.options import ImportOptions
from tests.unit.data.recordings.conftest import Sheet


def read(log: Sheet, dt: float = 0.01, how: RecordingMap | None = None) -> Imported:
    """Read it; whatever overflows or is divided by zero on the way is an error."""
    with np.errstate(all="raise", under="ignore"):
        return read_recording(log.save(), log.robot, ImportOptions(dt=dt), how=how)


def everywhere(sheet: Sheet, prefix: str, value: float) -> None:
    for name in sheet.cells(prefix):
        sheet.put(name, np.full(len(sheet.rows), value))


@pytest.mark.parametrize("value", [1e7, 1e160, 1e200, -1.7e308])
def test_points_beyond_all_measure_are_refused(value: float, sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    everywhere(log, "s", value)
    with pytest.raises(
        DataError, match=r"100% of the positions are more than 2.95e\+06 m .*'s0' at 0 s"
    ):
        read(log)


def test_a_single_point_beyond_all_measure_is_masked(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.rows[50][log.header.index("s2.y")] = "-1e200"
    one = read(log)
    (found,) = one.report.findings
    assert (found.kind, found.action, found.subject, found.count) == ("far", "masked", "s2", 1)
    gone = ~one.episodes[0].trajectory.observations.valid
    assert np.argwhere(gone).tolist() == [[50, 2]]


def test_winch_positions_beyond_all_measure_are_refused_or_masked(sheet):
    log = sheet("platform4")
    index = winch_names(log.robot)["position_fl"]
    log.rows[7][log.header.index("position_fl")] = "1e300"
    one = read(log)
    (found,) = one.report.findings
    assert (found.kind, found.subject, found.count) == ("far", "position_fl", 1)
    got = one.episodes[0].trajectory.observations.winch[:, index]
    expected = log.made.winch[:, index].copy()
    expected[7] = np.nan
    np.testing.assert_array_equal(got, expected)
    everywhere(log, "position_fl", 1e300)
    with pytest.raises(DataError, match="100% of the positions .* first of 'position_fl'"):
        read(log)


@pytest.mark.parametrize("value", [1e12, -1e200, 1e308])
def test_a_time_beyond_all_clocks_is_refused(value: float, sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.rows[-1][0] = repr(value)
    with pytest.raises(DataError, match=r"line 202: the time is .* at most 1e\+11 s"):
        read(log)


def test_values_that_overflow_in_another_unit_count_as_infinite(sheet):
    log = sheet()
    log.rows[9][log.header.index("ctrl.winch_35")] = "1e308"
    with pytest.raises(DataError, match="line 11: the command in 'ctrl.winch_35' is -inf"):
        read(log, how=RecordingMap(units=Units(control="-rad/s", drum=100.0)))


def test_a_log_whose_measurements_are_nearly_all_wrong_is_refused(sheet):
    log = sheet()
    for name in [f"{point.name}.x" for point in log.robot.points]:
        log.put(name, log.column(name) + 500.0 * (np.arange(len(log.rows)) >= 10))
    message = (
        "only 60 of 1206 measured points .* at least 10% are needed. Found: s0 leap .191 times"
    )
    with pytest.raises(DataError, match=message):
        read(log)


def test_a_robot_that_is_elsewhere_in_every_row_is_refused(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    away = log.rng.uniform(0, 300, len(log.rows))
    for name in [f"{point.name}.x" for point in log.robot.points]:
        log.put(name, log.column(name) + away)
    with pytest.raises(DataError, match=r"the points usually move by [0-9.]+ m from row to row"):
        read(log)


@pytest.mark.parametrize(
    ("seen", "message"),
    [(0, "no marker was ever measured"), (3, "only 1.49% .* are present; at least 2% are needed")],
)
def test_a_log_that_hardly_measures_anything_is_refused(seen, message, sheet):
    log = sheet()
    for name in log.cells("s"):
        log.put(name, np.where(np.arange(len(log.rows)) < seen, log.column(name), np.nan))
    with pytest.raises(DataError, match=message):
        read(log)


@pytest.mark.parametrize("dt", [1e-7, 1e-9, 5e-324, 9.9e-5, 0.0, -1.0, 11.0, 1e300, np.inf, np.nan])
def test_what_is_no_control_step_is_refused(dt: float, sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    asked = ImportOptions(dt=dt)
    for ask in (partial(read_recording, options=asked), partial(read_commands, dt=dt)):
        with pytest.raises(
            DataError, match="A control step, dt, must be a number from 0.0001 to 10 s; got"
        ):
            ask(log.save(), log.robot)
    track = read(log).episodes[0].trajectory
    with pytest.raises(DataError, match="A control step, dt,"):
        replace(track, dt=dt)
    replace(track, dt=1e-4)
    replace(track, dt=10.0)


def test_a_log_of_one_row_a_second_is_right_for_steps_of_a_second(sheet):
    log = sheet()
    log.scale("time", 100.0)
    with pytest.raises(DataError, match=r"rows are 1 s apart, at most 0.5 s .*give a longer step"):
        read(log)
    track = read(log, dt=1.0).episodes[0].trajectory
    np.testing.assert_array_equal(track.controls, log.made.controls)
    assert track.dt == 1.0
    log.scale("time", 10.0)
    with pytest.raises(DataError, match=r"10 s apart, at most 2.5 s .*units: \{time: ms\}"):
        read(log, dt=1.0)


def test_rows_that_are_nanoseconds_apart_are_in_another_unit(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    with pytest.raises(DataError, match="rows are 1e-11 s apart, at least 1e-06 s are expected"):
        read(log, how=RecordingMap(units=Units(time="ns")))


def test_more_steps_than_fit_in_memory_are_refused(sheet, monkeypatch):
    log = sheet()
    assert most_rows(log.robot) > 1.75 * 3600 * 100  # rows of 1.75 hours at 100 Hz
    monkeypatch.setattr("flywheel.data.recordings.grid.MOST_NUMBERS", 30 * 250)
    assert read(log).report.rows == 201
    asked = ImportOptions(dt=0.005)
    for ask in (partial(read_recording, options=asked), partial(read_commands, dt=0.005)):
        with pytest.raises(DataError, match="2 s are 400 control steps of 0.005 s; .* most 250"):
            ask(log.save(), log.robot)
    monkeypatch.setattr("flywheel.data.recordings.grid.MOST_NUMBERS", 30 * 200)
    with pytest.raises(DataError, match="log.csv has more than 200 lines"):
        read(log)


def test_more_gaps_than_a_log_can_have_are_refused(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    count = 3 * (MOST_GAPS + 2)
    log.rows = [list(log.rows[i % 200]) for i in range(count)]
    log.put("time", np.round(0.01 * np.arange(count) + 0.05 * (np.arange(count) // 3), 9))
    with pytest.raises(DataError, match="1,001 gaps"):
        read(log)


STRANGE = [
    "1e308",
    "-1e200",
    "1e12",
    "1e7",
    "5e-324",
    "inf",
    "-inf",
    "nan",
    "1e400",
    "0",
    "",
    "1" * 5000,
]


@pytest.mark.parametrize("seed", range(40))
def test_whatever_stands_in_a_log_it_is_read_or_refused(seed, sheet):
    rng = np.random.default_rng(seed)
    log = sheet("prism3" if seed % 2 else "platform4")
    log.rows = log.rows[: rng.choice([3, 20, 100])]
    for _ in range(rng.integers(1, 4)):
        column, rows = int(rng.integers(len(log.header))), len(log.rows)
        begin, end = sorted(rng.integers(0, rows + 1, 2))
        for row in log.rows[begin:end]:
            row[column] = str(rng.choice(STRANGE))
    for dt in (1e-4, 0.01, 10.0):
        try:
            read(log, dt)
            with np.errstate(all="raise", under="ignore"):
                read_commands(log.save(), log.robot, dt=dt)
        except FlywheelError as error:
            assert len(str(error)) < 1000
