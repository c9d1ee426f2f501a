"""A draft of the map of a recording: names of its files, and what the cables tell of the winches."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flywheel.data.recordings.formats import (
    POSITION,
    QUATERNION,
    TIME_NAMES,
    LogFile,
    Stream,
    named_time,
    open_log,
)
from flywheel.data.recordings.geometry import pairs, usual_distances
from flywheel.data.recordings.joining.alignment import (
    Mover,
    Witness,
    comparable,
    likeness,
    seen_lengths,
)
from flywheel.data.recordings.joining.channels import points_of
from flywheel.data.recordings.joining.lookup import Sheets, no_times
from flywheel.data.recordings.joining.series import Clock
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.sources import ANGLES, HOLD, LENGTHS, TIMES
from flywheel.data.recordings.spelling import (
    alike,
    by_name,
    markers,
    numbered,
    pose,
    quaternions,
    spelled,
    threes,
    unit_of,
)
from flywheel.errors import ConfigError, DataError
from flywheel.files import yaml_text
from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.robots.parts import WinchKind
from flywheel.validation import validated

PERIODS = (1e-4, 0.5)  # usual times between rows [s]
EPISODE = "episode_index"  # of data sets, which begin their times anew with each episode
FEW_TWICE = 0.9  # share of the rows that are later than the one before, in a column of times
EVEN = 0.2  # share by which the steps of a column of times differ
UNIT = 0.1  # share by which distances may be off the MJCF's
ALIKE = 0.7  # correlation from which a column is that of a winch
MOST = 60  # columns that are compared with the cables
COUNTS = re.compile(r"frame|index|seq|count|sample|row|step")  # columns that are no times
Y_UP = {"x": "x", "y": "-z", "z": "y"}


@dataclass
class Draft:
    """Parts of a map, remarks about its values, and its files by their paths there.

    Attributes:
      robot: of the recording.
      folder: that the map's paths are relative to.
    """

    robot: Robot
    folder: Path
    values: dict[str, object] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    files: dict[str, LogFile] = field(default_factory=dict)

    def how(self) -> RecordingMap:
        """The map so far."""
        return validated(RecordingMap, self.values, "the draft of the map", ConfigError)

    def text(self) -> str:
        """YAML, with its remarks before it."""
        return "".join(f"# {each}\n" for each in self.remarks) + yaml_text(self.values)


def guess(paths: Sequence[Path], robot: Robot, folder: Path) -> str:
    """A draft of the map of a recording, in YAML, with remarks about what is guessed or missing.

    Args:
      paths: of its files.
      robot: of the recording.
      folder: that the map's paths shall be relative to.

    Raises:
      DataError: a file cannot be read, or is given twice, or none has points.
    """
    if len({path.resolve() for path in paths}) < len(paths):
        raise DataError(f"Give each file once; got {', '.join(map(str, paths))}.")
    files = [(path, open_log(path)) for path in paths]
    count = len(robot.points)
    files.sort(key=lambda each: -max(len(markers(each[1])), len(threes(each[1], count))))
    draft = Draft(robot, folder)
    entries = [_entry(path, file, draft) for path, file in files]
    draft.values["files"] = entries
    _add_points(draft, files[0][1])
    _add_commands(draft, _placed(draft))
    for entry in entries:
        if "rate" in entry:  # nobody knows it
            entry["rate"] = None
    return draft.text()


def _entry(path: Path, file: LogFile, draft: Draft) -> dict[str, object]:
    """The entry of a file, with its times."""
    entry: dict[str, object] = {"path": os.path.relpath(path, draft.folder)}
    draft.files[str(entry["path"])] = file
    for stream in file.streams:
        episodes = np.unique(stream.columns.get(EPISODE, np.zeros(1)))
        if len(episodes) > 1:
            entry["where"] = {EPISODE: int(episodes[0])}
            draft.remarks.append(
                f"{file.name} has the episodes {episodes[0]:g} to {episodes[-1]:g}: one is a recording"
            )
    if any(stream.rows is not None for stream in file.streams):
        draft.remarks.append(
            f"{file.name} has a row for each marker and time: its markers are taken as columns"
        )
    timeless = [stream for stream in file.streams if stream.time is None and not stream.stamps]
    if not timeless:
        return entry
    columns = list(timeless[0].columns)
    if file.title == "table" and columns[:1] == ["column 1"]:
        entry["columns"] = [f"c{i}" for i in range(1, 1 + len(columns) + len(timeless[0].texts))]
        draft.remarks.append(f"{file.name} has no header: c1, c2, ... are its columns; name them")
    times = [
        (name, each.columns[name]) for each in timeless if (name := _time_of(each)) is not None
    ]
    if not times:
        entry["rate"] = 100.0  # for the rest of the draft
        draft.remarks += _why_timeless(file, timeless)
        return entry
    renamed = [n.replace("column ", "c") if "columns" in entry else n for n, _ in times]
    entry["time"] = renamed[0] if len(renamed) == 1 else renamed
    step = float(np.nanmedian(np.diff(times[0][1])))
    fitting = [
        u for u, factor in TIMES.items() if PERIODS[0] <= step * factor <= PERIODS[1] and u != "h"
    ]
    if fitting and fitting[0] != "s":
        entry["unit"] = fitting[0]
    if fitting != ["s"]:
        draft.remarks.append(
            f"{file.name}: steps of {times[0][0]!r} are {step:g}; its unit is guessed"
        )
    return entry


def _why_timeless(file: LogFile, streams: Sequence[Stream]) -> list[str]:
    """Remarks about a file none of whose columns are times."""
    found = [no_times(each, n) for each in streams for n in each.texts if named_time(n)]
    found.append("it has no column of times: its rate [Hz] is to fill in")
    found += [
        f"{name!r} has times more than once; rows of several things at a time need where: {{COLUMN: VALUE}}, "
        "which chooses those of one, or columns of their own"
        for each in streams
        for name in each.columns
        if named_time(name)
    ]
    return [f"{file.name}: {words}" for words in found]


def _time_of(stream: Stream) -> str | None:
    """The column that is most likely the time."""
    named = [name for name in stream.columns if named_time(name)]
    others = [n for n in stream.columns if not COUNTS.match(n.lower())]
    for name in [*named, *others]:
        steps = np.diff(stream.columns[name])
        rises = len(steps) and (steps >= 0).all() and (steps > 0).mean() > FEW_TWICE
        if rises and (name in named or _even(steps)):
            return name
    return None


def _even(steps: Floats) -> bool:
    return bool(np.ptp(np.percentile(steps, [25, 75])) <= EVEN * np.median(steps))


def _add_points(draft: Draft, file: LogFile) -> None:
    """Markers by their names, or in their order, and poses of bodies where there are no markers."""
    bodies = [body.name for body in draft.robot.bodies]
    names = [point.name for point in draft.robot.points]
    known = markers(file)
    found = by_name(names, known)
    turned = [name for name in known if f"{name}{QUATERNION[0]}" in file.columns]
    if len(found) < len(names):
        poses: Mapping[str, object] = by_name(bodies, turned)
        if len(turned) == len(bodies) == 1:
            poses = {bodies[0]: turned[0]}
        if len(poses) == len(bodies):
            draft.values["poses"] = poses
            draft.remarks.append("poses are those of the MJCF's bodies if at and turned are right")
            return
        if len(bodies) == 1 and (found_pose := pose(known, file)):
            draft.values["poses"] = {bodies[0]: found_pose}
            draft.remarks.append("the pose is that of the MJCF's body if at and turned are right")
            return
    plain = [name for name in known if name not in turned and not name.endswith("(solved)")]
    if len(found) < len(names):
        plain = alike(plain, len(names))
    rows = threes(file, len(names))
    if len(found) < len(names) == len(rows):
        found, plain = dict(zip(names, rows, strict=True)), []
        draft.remarks.append("markers are in the order of the file, three numbers for each")
    if len(found) < len(names) == len(plain):
        found = dict(zip(names, plain, strict=True))
        draft.remarks.append("markers are in the order of the file: their names tell nothing")
    columns = spelled(file)
    draft.values["markers"] = {
        name: columns.get(marker, marker) if (marker := found.get(name)) else None for name in names
    }
    units = {unit_of(columns[marker][0]) for marker in found.values() if marker in columns}
    if len(units) == 1 and (unit := units.pop()) in LENGTHS:
        draft.values["units"] = {"points": unit}
    missing = [name for name in names if name not in found]
    if missing:
        draft.remarks.append(
            f"markers of {', '.join(missing)} are to fill in, or poses of bodies; there are: "
            f"{', '.join((plain or file.columns)[:40])}"
        )


def _placed(draft: Draft) -> tuple[Floats, Floats] | None:
    """Times (N,) and positions (N, P, 3) by the draft, which gets unit and axes; None without any point."""
    try:
        points = _positions(draft)
    except DataError as error:
        if "unit of its positions" not in str(error):
            return None
        draft.values["units"] = {"points": "m"}
        points = _positions(draft)
    if points is None:
        return None
    rods = pairs(draft.robot)
    ratios = (
        usual_distances(points[1], rods) / [rod.distance for rod in rods] if rods else np.ones(1)
    )
    ratio = float(np.nanmedian(ratios)) if np.isfinite(ratios).any() else 1.0
    told = draft.how().units.metres[0]
    for unit, factor in LENGTHS.items():
        if abs(ratio - 1) > UNIT > abs(ratio * factor / told - 1):
            draft.values["units"] = {"points": unit}
            draft.remarks.append(f"the unit of the points, {unit}, is that of the MJCF's distances")
    if abs(ratio * draft.how().units.metres[0] / told - 1) > UNIT:
        draft.remarks.append(
            f"distances on bodies are {ratio:.3g} times the MJCF's: are these its markers?"
        )
    _add_axes(draft, (_positions(draft) or points)[1])
    return _positions(draft)


def _positions(draft: Draft) -> tuple[Floats, Floats] | None:
    how = draft.how()
    sheets = Sheets(draft.folder, how, how.files[:1], draft.files)
    series, _ = points_of(sheets, [Clock(0.0, 1.0)], draft.robot, how)
    known = next((each for each in series if each is not None), None)
    if known is None:
        return None
    unseen = np.full_like(known.values, np.nan)
    points = [unseen if each is None else each.values for each in series]
    return known.time, np.stack(points, axis=1)


def _add_axes(draft: Draft, points: Floats) -> None:
    """Axes with y up, where heights of the points fit the keyframe's better than with z up."""
    robot = draft.robot
    seen = np.asarray(np.isfinite(points).any(axis=0)).all(axis=1)
    if not robot.free or not seen.any():
        return
    wanted = robot.points_of(robot.keyframe)[seen, 2]
    usual = np.nanmedian(points[:, seen], axis=0)

    def off(axis: int) -> float:
        beyond = usual[:, axis] - wanted
        return float(
            np.std(beyond) + (abs(beyond.mean()) if robot.grounded or robot.tethered else 0.0)
        )

    if off(1) < off(2):
        draft.values["axes"] = Y_UP
        draft.remarks.append("axes are guessed: heights fit with y up; compare with your tracker's")


def _add_commands(draft: Draft, points: tuple[Floats, Floats] | None) -> None:
    """Columns of the winches by their names, else by what the cables do."""
    robot, how = draft.robot, draft.how()
    sheets = Sheets(draft.folder, how, how.files, draft.files)
    columns = _others(sheets, draft)
    winches = [winch.name for winch in robot.winches]
    found = by_name(winches, columns)
    if len(found) < len(winches):
        found = _in_order(winches, columns, draft) or found
    by_cables = robot.free and not robot.tension_driven
    if len(found) < len(winches) and by_cables and points is not None:
        found = _by_cables(sheets, columns, points, draft)
    missing = [name for name in winches if name not in found]
    if missing:
        draft.remarks.append(
            f"commands of {', '.join(missing)} are to fill in ({HOLD}: never moved); there are: "
            f"{', '.join(columns[:40])}"
        )
    told = {winch.name: _command(found.get(winch.name), winch.kind) for winch in robot.winches}
    draft.values["commands"] = told
    draft.remarks.append(
        "commands are taken for m/s, those of positions for m, tensions for N: compare with the log's units"
    )
    units = [each["unit"] for each in told.values() if isinstance(each, dict)]
    if any(unit.removesuffix("/s") in ANGLES for unit in units):
        draft.remarks.append(
            "commands that are angles of a drum need its radius, as drum: 0.02 (m)"
        )
    sensors = {winch.sensor: winch.name for winch in robot.winches if winch.sensor}
    if measured := by_name(list(sensors), columns):
        draft.values["winches"] = {sensors[name]: their for name, their in measured.items()}
        draft.remarks.append("positions of winches are taken for m")
    if len({each.file for each in sheets.sources}) > 1:
        draft.remarks.append(
            "a file with a clock of its own needs align: auto, or offset (seconds)"
        )


def _others(sheets: Sheets, draft: Draft) -> list[str]:
    """Columns that are no times, frames, positions or rotations."""
    how = draft.how()
    used = {name for entry in how.files for name in _listed(entry.time)}
    used |= {f"{n}{end}" for n in sheets.markers() for end in (*POSITION, *QUATERNION)}
    for file in draft.files.values():
        used |= {name for axes in (*spelled(file).values(), *quaternions(file)) for name in axes}
    points = [name for marker in how.markers.values() if marker for name in _listed(marker)]
    used |= {f"{name}{end}" for name in points for end in ("", "[0]", "[1]", "[2]")}
    columns = [name for name in sheets.names() if name not in used]
    return [n for n in columns if n.lower() not in TIME_NAMES and not n.lower().startswith("frame")]


def _listed(names: str | tuple[str, ...]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else names


def _command(name: str | None, kind: WinchKind) -> str | dict[str, str] | None:
    """A command in the map: its column, with the unit that its name says, or m of a position; or None."""
    if name is None or kind == "tension":
        return name
    unit = unit_of(name, "/s" if kind == "rate" else "") or ("m" if kind == "position" else "")
    return {"from": name, "unit": unit} if unit else name


def _in_order(winches: Sequence[str], columns: Sequence[str], draft: Draft) -> dict[str, str]:
    """Winch -> column, where as many columns as winches are numbered: those named as commands are, or all."""
    found = numbered(columns, len(winches))
    if len(found) < 2:
        return {}
    draft.remarks.append(
        f"commands are in the order of the file, {found[0]!r} to {found[-1]!r}: is it the winches'?"
    )
    return dict(zip(winches, found, strict=True))


def _by_cables(
    sheets: Sheets, columns: Sequence[str], points: tuple[Floats, Floats], draft: Draft
) -> dict[str, str]:
    """Winch -> the column that changes, or whose sum changes, as its cable does."""
    time, places = points
    winches = draft.robot.winches
    lengths = seen_lengths(places, draft.robot)
    chosen = columns[:MOST]
    fits = np.zeros((len(winches), len(chosen)))
    for j, name in enumerate(chosen):
        column = sheets.columns([name])
        if column is None or not np.isfinite(column.values).all() or np.ptp(column.values) == 0:
            continue
        when, values = column.source.time, column.values[:, 0]
        for i, winch in enumerate(winches):
            made = values
            if winch.kind == "rate":
                made = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(when))])
            fits[i, j] = _best(time, lengths[:, winch.cables[0]], when, made)
    # Start-up time: as in flywheel.smoothing.
    from scipy.optimize import linear_sum_assignment

    picked = zip(*linear_sum_assignment(-np.abs(fits)), strict=True)
    sure = [(winches[i].name, fits[i, j], chosen[j]) for i, j in picked if abs(fits[i, j]) > ALIKE]
    if sure:
        told = ", ".join(f"{winch} {abs(fit):.2f}" for winch, fit, _ in sure)
        draft.remarks.append(f"commands are guessed by what the cables do (correlation: {told})")
    return {winch: ("-" if fit < 0 else "") + column for winch, fit, column in sure}


def _best(time: Floats, lengths: Floats, when: Floats, made: Floats) -> float:
    """The correlation of the changes of a cable with those of a column at the offset where it is largest."""
    if not (comparable(time[np.isfinite(lengths)]) and comparable(time) and comparable(when)):
        return 0.0
    witness = Witness(Mover(0, when, made), lengths)
    fits, _ = likeness(time, [witness], float(when[0]), float(when[-1]))
    fits = fits[np.isfinite(fits) & (fits > -1)]
    return float(fits[np.abs(fits).argmax()]) if len(fits) else 0.0
