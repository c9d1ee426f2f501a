"""A draft of the map of a recording: names of its files, and what the cables tell of the winches."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from flywheel.data.recordings.formats import QUATERNION, LogFile, Stream, open_log
from flywheel.data.recordings.geometry import pairs, usual_distances
from flywheel.data.recordings.joining.alignment import (
    Mover,
    Witness,
    comparable,
    likeness,
    seen_lengths,
)
from flywheel.data.recordings.joining.channels import points_of
from flywheel.data.recordings.joining.lookup import TIME_NAMES, Sheets
from flywheel.data.recordings.joining.series import Clock
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.sources import ANGLES, HOLD, LENGTHS, TIMES
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
COMMANDS = re.compile(
    r"cmd|command|told|set|target|tgt|ref|goal|ctrl|control|desired|soll|(^|[\W_])u([\W_\d]|$)"
)
# Columns that are no commands.
MEASURED = re.compile(r"enc|meas|actual|feedback|(^|[\W_])(fb|ist|is)([\W_]|$)")
WITH_UNIT = re.compile(
    r"\s*[\[(]\s*(?P<in>(?:[mc]?m|in|ft|rad|deg|turn|k?N|m?s)(?:/s)?)\s*[\])]\s*$"
    r"|_(?P<as>(?:[mc]?m|rad|deg)(?:_s)?)$"
)  # a column's name
NO_PLACE = re.compile(  # what else has an x, a y and a z
    r"v|vel.*|w|omega.*|gyro.*|a|acc.*|mag.*|f|force.*|torque.*|e|err.*|r|rot.*|euler.*", re.I
)
# Words that tell no winch or marker from another.
KINDS = re.compile(r"winch|motor|cable|servo|tendon|actuator|ctrl|point|marker")
Y_UP = {"x": "x", "y": "-z", "z": "y"}


@dataclass
class Draft:
    """Parts of a map, remarks about its values, and its files by their paths there."""

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
      DataError: a file cannot be read, or none has points.
    """
    files = [(path, open_log(path)) for path in paths]
    count = len(robot.points)
    files.sort(key=lambda each: -max(len(_markers(each[1])), len(_threes(each[1], count))))
    draft = Draft()
    draft.values["files"] = [_entry(path, file, folder, draft) for path, file in files]
    known = _markers(files[0][1])
    _add_points(draft, known, files[0][1], robot)
    points = _placed(draft, folder, robot, files[0][1])
    _add_commands(draft, folder, points, robot)
    return draft.text()


def _markers(file: LogFile) -> list[str]:
    """Names of what has three coordinates."""
    names = [name for stream in file.streams for name in stream.columns]
    there = set(names)
    found = []
    for end, others in ((".x", (".y", ".z")), ("_x", ("_y", "_z")), ("[0]", ("[1]", "[2]"))):
        for name in names:
            base = name.removesuffix(end)
            if (
                name.endswith(end)
                and {base + other for other in others} <= there
                and base + "[3]" not in there
            ):
                found.append(base)
    return [*found, *(name for name in _spelled(file) if name not in found)]


def _spelled(file: LogFile) -> dict[str, list[str]]:
    """Marker -> its three columns, where the map has to name all: `m1 X [mm]`, `m1y`."""
    plain = ("{}.{}", "{}_{}")
    return {
        name: axes
        for name, axes in _triples(file).items()
        if not any(axes == [each.format(name, a) for a in "xyz"] for each in plain)
    }


def _triples(file: LogFile) -> dict[str, list[str]]:
    """Marker -> its three columns, which end in x, y and z, and perhaps a unit."""
    found: dict[str, dict[str, str]] = {}
    for name in (name for stream in file.streams for name in stream.columns):
        parts = re.fullmatch(r"(.*[^\W_])[\W_]*([wxyz])", WITH_UNIT.sub("", name), re.I)
        if parts:
            found.setdefault(parts[1], {})[parts[2].lower()] = name
    places = {
        n: axes for n, axes in found.items() if {*axes} == {*"xyz"} and not NO_PLACE.fullmatch(n)
    }
    return {name: [axes[a] for a in "xyz"] for name, axes in places.items()}


def _quaternions(file: LogFile) -> list[list[str]]:
    """Columns x, y, z, w of each rotation whose columns end so: `qx`, `Body_QW`."""
    names = [name for stream in file.streams for name in stream.columns]
    ends = [name for name in names if name.lower().endswith("w")]
    turns = [[name[:-1] + (a if name[-1] == "w" else a.upper()) for a in "xyzw"] for name in ends]
    return [turn for turn in turns if {*turn} <= {*names}]


def _unit_of(name: str, per: str = "") -> str:
    """The unit of length or angle, or of speed per "/s", at the end of a column's name; "" for none."""
    found = WITH_UNIT.search(name)
    unit = (found["in"] or found["as"].replace("_", "/")) if found else ""
    return unit if unit in {f"{unit}{per}" for unit in (*LENGTHS, *ANGLES)} else ""


def _entry(path: Path, file: LogFile, folder: Path, draft: Draft) -> dict[str, object]:
    """The entry of a file, with its times."""
    entry: dict[str, object] = {"path": os.path.relpath(path, folder)}
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
    names = [name for stream in timeless if (name := _time_of(stream)) is not None]
    if not names:
        entry["rate"] = 100
        draft.remarks.append(f"{file.name} has no column of times: its rate [Hz] is to fill in")
        for name in (n for stream in timeless for n in stream.columns if _named_time(n)):
            draft.remarks.append(
                f"{file.name}: {name!r} has times more than once; rows of several things at a time need "
                "where: {COLUMN: VALUE}, which chooses those of one, or columns of their own"
            )
        return entry
    values = next(stream.columns[names[0]] for stream in timeless if names[0] in stream.columns)
    step = float(np.nanmedian(np.diff(values)))
    fitting = [
        u for u, factor in TIMES.items() if PERIODS[0] <= step * factor <= PERIODS[1] and u != "h"
    ]
    renamed = [f"c{columns.index(n) + 1}" if "columns" in entry else n for n in names]
    entry["time"] = renamed[0] if len(renamed) == 1 else renamed
    if fitting and fitting[0] != "s":
        entry["unit"] = fitting[0]
    if len(fitting) != 1 or fitting[0] != "s":
        draft.remarks.append(
            f"{file.name}: steps of {names[0]!r} are {step:g}; its unit is guessed"
        )
    return entry


def _time_of(stream: Stream) -> str | None:
    """The column that is most likely the time."""

    def rises(name: str) -> bool:
        steps = np.diff(stream.columns[name])
        return bool(len(steps) and (steps >= 0).all() and (steps > 0).mean() > FEW_TWICE)

    named = [name for name in stream.columns if _named_time(name)]
    others = [n for n in stream.columns if not COUNTS.match(n.lower())]
    for name in [*named, *others]:
        if rises(name):
            steps = np.diff(stream.columns[name])
            if name in named or np.ptp(np.percentile(steps, [25, 75])) <= EVEN * np.median(steps):
                return name
    return None


def _named_time(name: str) -> bool:
    return name.lower() in TIME_NAMES or re.search(r"time|stamp", name.lower()) is not None


def _add_points(draft: Draft, known: Sequence[str], file: LogFile, robot: Robot) -> None:
    """Markers by their names, or in their order, and poses of bodies where there are no markers."""
    names = [point.name for point in robot.points]
    found = _by_name(names, known)
    columns = [name for stream in file.streams for name in stream.columns]
    turned = [name for name in known if f"{name}{QUATERNION[0]}" in columns]
    bodies = _by_name([body.name for body in robot.bodies], turned)
    if len(turned) == len(robot.bodies) == 1 and not bodies:
        bodies = {robot.bodies[0].name: turned[0]}
    if len(found) < len(names) and len(bodies) == len(robot.bodies):
        draft.values["poses"] = bodies
        draft.remarks.append("poses are those of the MJCF's bodies if at and turned are right")
        return
    if len(found) < len(names) and (pose := _pose(known, file)) and len(robot.bodies) == 1:
        draft.values["poses"] = {robot.bodies[0].name: pose}
        draft.remarks.append("the pose is that of the MJCF's body if at and turned are right")
        return
    plain = [name for name in known if name not in turned and not name.endswith("(solved)")]
    if len(found) < len(names):
        plain = _alike(plain, len(names))
    if len(found) < len(names) == len(plain):
        found = dict(zip(names, plain, strict=True))
        draft.remarks.append("markers are in the order of the file: their names tell nothing")
    if not plain and len(rows := _threes(file, len(names))) == len(names):
        found = dict(zip(names, rows, strict=True))
        draft.remarks.append("markers are in the order of the file, three numbers for each")
    spelled = _spelled(file)
    their = [found.get(name) for name in names]
    draft.values["markers"] = {
        name: spelled.get(str(marker), marker) for name, marker in zip(names, their, strict=True)
    }
    units = {_unit_of(spelled[each][0]) for each in their if each in spelled}
    if len(units) == 1 and (unit := units.pop()) in LENGTHS:
        draft.values["units"] = {"points": unit}
    missing = [name for name in names if name not in found]
    if missing:
        draft.remarks.append(
            f"markers of {', '.join(missing)} are to fill in, or poses of bodies; there are: "
            f"{', '.join((plain or list(columns))[:40])}"
        )


def _pose(known: Sequence[str], file: LogFile) -> dict[str, object] | None:
    """The pose in columns of a position and a quaternion; None unless there is one of each.

    Where there are several positions, it is that named as ROS names a pose's, `pose.position`.
    """
    turns, spelled = _quaternions(file), _spelled(file)
    places = [name for name in known if name.endswith("position")] or list(known)
    if len(turns) != 1 or len(places) != 1:
        return None
    position = spelled.get(places[0], [f"{places[0]}.{axis}" for axis in "xyz"])
    return {"position": position, "rotation": turns[0], "order": "xyzw"}


def _alike(names: list[str], count: int) -> list[str]:
    """So many of the names that only differ in an index at their end, `m[0]`, `m[1]`; else all."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(name)
    fitting = [group for group in groups.values() if len(group) == count]
    return fitting[0] if len(fitting) == 1 else names


def _threes(file: LogFile, count: int) -> list[str]:
    """Names of so many markers in the only array with three numbers for each; empty unless there is one."""
    columns = {name for stream in file.streams for name in stream.columns}
    bases = {name.removesuffix("[0]") for name in columns if name.endswith("[0]")}
    size = 3 * count
    fitting = [
        base
        for base in bases
        if {f"{base}[{i}]" for i in range(size)} <= columns and f"{base}[{size}]" not in columns
    ]
    places = range(0, size, 3) if len(fitting) == 1 else ()
    return [f"{fitting[0]}[{i}:{i + 3}]" for i in places]


def _by_name(names: Sequence[str], known: Sequence[str]) -> dict[str, str]:
    """Ours -> theirs, where a name is the same but for case, signs and what stands before it."""
    bare = {name: WITH_UNIT.sub("", name) for name in reversed(known)}
    plain = {_plain(each): name for name, each in bare.items()}
    last = {_plain(re.split(r"[:./ ]", each)[-1]): name for name, each in bare.items()}
    found: dict[str, str] = {}
    for name in names:
        their = plain.get(_plain(name)) or last.get(_plain(name))
        if their is not None and their not in found.values():
            found[name] = their
    for name in names:
        left = [
            each
            for each in last
            if _digits(each) == _digits(name) and last[each] not in found.values()
        ]
        near = get_close_matches(_plain(name), left, n=1, cutoff=0.8)
        if near and name not in found:
            found[name] = last[near[0]]
    for name in names:
        left = [
            each for each in known if each not in found.values() and _words(name) <= _words(each)
        ]
        if name not in found and _words(name):
            told = [n for n in left if COMMANDS.search(n.lower())]
            told = told or [n for n in left if not MEASURED.search(n.lower())]
            if len(told) == 1:
                found[name] = told[0]
    return {name: found[name] for name in names if name in found}


def _words(name: str) -> set[str]:
    """Words and numbers in a name, but for those that tell no marker or winch from another."""
    found = re.findall(r"[a-z]+|\d+", name.lower())
    return {word for word in found if not KINDS.fullmatch(word)}


def _digits(name: str) -> str:
    return re.sub(r"\D", "", name)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower().removeprefix("ctrl."))


def _placed(
    draft: Draft, folder: Path, robot: Robot, file: LogFile
) -> tuple[Floats, Floats] | None:
    """Times (N,) and positions (N, P, 3) by the draft, which gets unit and axes; None without all points."""
    try:
        points = _positions(draft, folder, robot)
    except DataError as error:
        if "unit of its positions" not in str(error):
            return None
        draft.values["units"] = {"points": "m"}
        points = _positions(draft, folder, robot)
    if points is None:
        return None
    rods = pairs(robot)
    ratios = (
        usual_distances(points[1], rods) / [rod.distance for rod in rods]
        if rods
        else np.array([1.0])
    )
    ratio = float(np.nanmedian(ratios)) if np.isfinite(ratios).any() else 1.0
    told = LENGTHS[str(_units(draft).get("points", "m"))]
    for unit, factor in LENGTHS.items():
        if abs(ratio - 1) > UNIT > abs(ratio * factor / told - 1):
            draft.values["units"] = {"points": unit}
            draft.remarks.append(f"the unit of the points, {unit}, is that of the MJCF's distances")
    now = LENGTHS[str(_units(draft).get("points", "m"))]
    if rods and abs(ratio * now / told - 1) > UNIT:
        draft.remarks.append(
            f"distances on bodies are {ratio:.3g} times the MJCF's: are these its markers?"
        )
    _add_axes(draft, (_positions(draft, folder, robot) or points)[1], robot, file)
    return _positions(draft, folder, robot)


def _units(draft: Draft) -> dict[str, object]:
    found = draft.values.get("units", {})
    return found if isinstance(found, dict) else {}


def _positions(draft: Draft, folder: Path, robot: Robot) -> tuple[Floats, Floats] | None:
    how = draft.how()
    sheets = Sheets(folder, how, how.files[:1], draft.files)
    series, _ = points_of(sheets, [Clock(0.0, 1.0)], robot, how)
    known = [each for each in series if each is not None]
    if len(known) < len(series):
        return None
    return known[0].time, np.stack([each.values for each in known], axis=1)


def _add_axes(draft: Draft, points: Floats, robot: Robot, file: LogFile) -> None:
    """Axes with y up, where heights of the points fit the keyframe's better than with z up."""
    if not robot.free:
        return
    wanted = robot.points_of(robot.keyframe)[:, 2]
    usual = np.nanmedian(points, axis=0)

    def off(axis: int) -> float:
        beyond = usual[:, axis] - wanted
        return float(
            np.std(beyond) + (abs(beyond.mean()) if robot.grounded or robot.tethered else 0.0)
        )

    if off(1) < off(2):
        draft.values["axes"] = Y_UP
        draft.remarks.append("axes are guessed: heights fit with y up; compare with your tracker's")


def _add_commands(
    draft: Draft, folder: Path, points: tuple[Floats, Floats] | None, robot: Robot
) -> None:
    """Columns of the winches by their names, else by what the cables do."""
    how = draft.how()
    sheets = Sheets(folder, how, how.files, draft.files)
    used = {f"{n}{end}" for n in sheets.markers() for end in (".x", ".y", ".z", *QUATERNION)}
    used |= {
        name for file in draft.files.values() for axes in _spelled(file).values() for name in axes
    }
    used |= {name for file in draft.files.values() for turn in _quaternions(file) for name in turn}
    used |= {f"{n}{end}" for n in _sources(draft) for end in ("", "[0]", "[1]", "[2]")}
    columns = [n for n in sheets.names() if n not in used and n.lower() not in TIME_NAMES]
    columns = [n for n in columns if n not in _times(how) and not n.lower().startswith("frame")]
    winches = [winch.name for winch in robot.winches]
    found: dict[str, object] = dict(_by_name(winches, columns))
    by_cables = points is not None and robot.free and not robot.tension_driven
    if len(found) < len(winches):
        found = _in_order(winches, columns, draft) or found
    if len(found) < len(winches) and by_cables and points is not None:
        found = _by_cables(sheets, columns, points, robot, draft)
    for name in winches:
        found.setdefault(name, HOLD)
    missing = [name for name in winches if found[name] == HOLD]
    if missing:
        draft.remarks.append(
            f"commands of {', '.join(missing)} are to fill in ({HOLD}: never moved); there are: "
            f"{', '.join(columns[:40])}"
        )
    told = {winch.name: _command(str(found[winch.name]), winch.kind) for winch in robot.winches}
    draft.values["commands"] = told
    draft.remarks.append(
        "commands are taken for m/s, those of positions for m, tensions for N: compare with the log's units"
    )
    if any(
        isinstance(each, dict) and each["unit"].removesuffix("/s") in ANGLES
        for each in told.values()
    ):
        draft.remarks.append(
            "commands that are angles of a drum need its radius, as drum: 0.02 (m)"
        )
    sensors = {winch.sensor: winch.name for winch in robot.winches if winch.sensor}
    if measured := _by_name(list(sensors), columns):
        draft.values["winches"] = {sensors[name]: their for name, their in measured.items()}
        draft.remarks.append("positions of winches are taken for m")
    if len({each.file for each in sheets.sources}) > 1:
        draft.remarks.append(
            "a file with a clock of its own needs align: auto, or offset (seconds)"
        )


def _command(name: str, kind: WinchKind) -> object:
    """A command in the map: its column, with the unit that its name says, or m of a position."""
    if name == HOLD or kind == "tension":
        return name
    unit = _unit_of(name, "/s" if kind == "rate" else "") or ("m" if kind == "position" else "")
    return {"from": name, "unit": unit} if unit else name


def _sources(draft: Draft) -> list[str]:
    """Names of the markers in the draft, or of their columns."""
    markers = draft.values.get("markers", {})
    found = markers.values() if isinstance(markers, dict) else ()
    return [name for each in found if each for name in ([each] if isinstance(each, str) else each)]


def _in_order(winches: Sequence[str], columns: Sequence[str], draft: Draft) -> dict[str, object]:
    """Winch -> column, where as many columns as winches are numbered: those named as commands are, or all."""
    groups: dict[str, list[str]] = {}
    for name in columns:
        if numbered := re.fullmatch(r"(.*?\D)\d+\D?", name):
            groups.setdefault(numbered[1], []).append(name)
    whole = [group for group in groups.values() if len(group) == len(winches)]
    fitting = [group for group in whole if COMMANDS.search(group[0].lower())] or whole
    if len(fitting) != 1 or len(winches) < 2:
        return {}
    draft.remarks.append(
        f"commands are in the order of the file, {fitting[0][0]!r} to {fitting[0][-1]!r}: is it the winches'?"
    )
    return dict(zip(winches, fitting[0], strict=True))


def _times(how: RecordingMap) -> set[str]:
    named = [entry.time if isinstance(entry.time, tuple) else (entry.time,) for entry in how.files]
    return {name for each in named for name in each}


def _by_cables(
    sheets: Sheets,
    columns: Sequence[str],
    points: tuple[Floats, Floats],
    robot: Robot,
    draft: Draft,
) -> dict[str, object]:
    """Winch -> the column that changes, or whose sum changes, as its cable does."""
    time, places = points
    lengths = seen_lengths(places, robot)
    chosen = list(columns)[:MOST]
    fits = np.zeros((len(robot.winches), len(chosen)))
    for j, name in enumerate(chosen):
        found = sheets.columns([name])
        if found is None or not np.isfinite(found.values).all() or np.ptp(found.values) == 0:
            continue
        when, values = found.source.time, found.values[:, 0]
        for i, winch in enumerate(robot.winches):
            made = values
            if winch.kind == "rate":
                made = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(when))])
            fits[i, j] = _best(time, lengths[:, winch.cables[0]], when, made)
    # Start-up time: as in flywheel.smoothing.
    from scipy.optimize import linear_sum_assignment

    rows, picked = linear_sum_assignment(-np.abs(fits))
    found_, told = dict[str, object](), list[str]()
    for i, j in zip(rows.tolist(), picked.tolist(), strict=True):
        if abs(fits[i, j]) > ALIKE:
            name = robot.winches[i].name
            found_[name] = ("-" if fits[i, j] < 0 else "") + chosen[j]
            told.append(f"{name} {abs(fits[i, j]):.2f}")
    if found_:
        draft.remarks.append(
            f"commands are guessed by what the cables do (correlation: {', '.join(told)})"
        )
    return found_


def _best(time: Floats, lengths: Floats, when: Floats, made: Floats) -> float:
    """The correlation of the changes of a cable with those of a column at the offset where it is largest."""
    if not (comparable(time[np.isfinite(lengths)]) and comparable(time) and comparable(when)):
        return 0.0
    witness = Witness(Mover(0, when, made), lengths)
    fits, _ = likeness(time, [witness], float(when[0]), float(when[-1]))
    fits = fits[np.isfinite(fits) & (fits > -1)]
    return float(fits[np.abs(fits).argmax()]) if len(fits) else 0.0
