"""How logs spell their columns: markers, rotations, units, and which of their names is one of ours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from flywheel.data.recordings.formats import LogFile
from flywheel.data.recordings.sources import ANGLES, LENGTHS

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


def markers(file: LogFile) -> list[str]:
    """Names of what has three coordinates."""
    there = set(file.columns)
    found = []
    for end, others in ((".x", (".y", ".z")), ("_x", ("_y", "_z")), ("[0]", ("[1]", "[2]"))):
        for name in file.columns:
            base = name.removesuffix(end)
            whole = {base + other for other in others} <= there and base + "[3]" not in there
            if name.endswith(end) and whole:
                found.append(base)
    taken = {f"{name}{end}" for name in found for end in (".x", "_x", "[0]")}
    return [
        *found,
        *(n for n, axes in spelled(file).items() if n not in found and axes[0] not in taken),
    ]


def spelled(file: LogFile) -> dict[str, list[str]]:
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
    for name in file.columns:
        parts = re.fullmatch(r"(.*[^\W_])[\W_]*([wxyz])", WITH_UNIT.sub("", name), re.I)
        if parts:
            found.setdefault(parts[1], {})[parts[2].lower()] = name
    places = {
        n: axes for n, axes in found.items() if {*axes} == {*"xyz"} and not NO_PLACE.fullmatch(n)
    }
    return {name: [axes[a] for a in "xyz"] for name, axes in places.items()}


def quaternions(file: LogFile) -> list[list[str]]:
    """Columns x, y, z, w of each rotation whose columns end so: `qx`, `Body_QW`."""
    ends = [name for name in file.columns if name.lower().endswith("w")]
    turns = [[name[:-1] + (a if name[-1] == "w" else a.upper()) for a in "xyzw"] for name in ends]
    return [turn for turn in turns if {*turn} <= {*file.columns}]


def pose(known: Sequence[str], file: LogFile) -> dict[str, object] | None:
    """The pose in columns of a position and a quaternion; None unless there is one of each.

    Where there are several positions, it is that named as ROS names a pose's, `pose.position`.

    Args:
      known: names of what has three coordinates.
      file: that has them.
    """
    turns = quaternions(file)
    places = [name for name in known if name.endswith("position")] or list(known)
    if len(turns) != 1 or len(places) != 1:
        return None
    position = spelled(file).get(places[0], [f"{places[0]}.{axis}" for axis in "xyz"])
    return {"position": position, "rotation": turns[0], "order": "xyzw"}


def threes(file: LogFile, count: int) -> list[str]:
    """Names of so many markers in the only array with three numbers for each; empty unless there is one."""
    columns = set(file.columns)
    bases = {name.removesuffix("[0]") for name in columns if name.endswith("[0]")}
    size = 3 * count
    fitting = [
        base
        for base in bases
        if {f"{base}[{i}]" for i in range(size)} <= columns and f"{base}[{size}]" not in columns
    ]
    places = range(0, size, 3) if len(fitting) == 1 else ()
    return [f"{fitting[0]}[{i}:{i + 3}]" for i in places]


def alike(names: list[str], count: int) -> list[str]:
    """So many of the names that only differ in an index at their end, `m[0]`, `m[1]`; else all."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\[\d+\]$", "", name), []).append(name)
    fitting = [group for group in groups.values() if len(group) == count]
    return fitting[0] if len(fitting) == 1 else names


def numbered(names: Sequence[str], count: int) -> list[str]:
    """So many of the names that only differ in a number; of several such groups, the only one named as
    commands are. Empty without one.
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        if parts := re.fullmatch(r"(.*?\D)\d+\D?", name):
            groups.setdefault(parts[1], []).append(name)
    whole = [group for group in groups.values() if len(group) == count]
    fitting = [group for group in whole if COMMANDS.search(group[0].lower())] or whole
    return fitting[0] if len(fitting) == 1 else []


def unit_of(name: str, per: str = "") -> str:
    """The unit of length or angle, or of speed per "/s", at the end of a column's name; "" for none."""
    found = WITH_UNIT.search(name)
    unit = (found["in"] or found["as"].replace("_", "/")) if found else ""
    return unit if unit in {f"{unit}{per}" for unit in (*LENGTHS, *ANGLES)} else ""


def by_name(names: Sequence[str], known: Sequence[str]) -> dict[str, str]:
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
