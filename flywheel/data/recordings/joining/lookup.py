"""Columns, markers and bodies of the files of a recording, found by the names in its map."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from types import MappingProxyType

import numpy as np

from flywheel.data.recordings.formats import (
    ANGLES,
    POSITION,
    QUATERNION,
    TIME_NAMES,
    LogFile,
    Stream,
    open_log,
)
from flywheel.data.recordings.formats.text import numbers
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.report import listed
from flywheel.data.recordings.sources import TIMES, FileEntry, factor_of
from flywheel.errors import DataError
from flywheel.files import shown
from flywheel.outputs import printable
from flywheel.records import Floats
from flywheel.registry import nearest

SLICE = re.compile(r"(.*)\[(\d+):(\d+)\]")


@dataclass(frozen=True)
class Source:
    """A stream of a file, with its times.

    Attributes:
      file: index of its file.
      name: of the file, for messages.
      time: (N,) by the file's own clock [s].
      stream: its columns, of the rows that the map takes.
      rows: (N,) numbers of the rows in the file, from 1.
    """

    file: int
    name: str
    time: Floats
    stream: Stream
    rows: np.ndarray


@dataclass(frozen=True)
class Found:
    """Columns (N, k) of a source, under the names that were asked for."""

    source: Source
    values: Floats


class Sheets:
    """All columns of a recording.

    Attributes:
      files: as read.
      sources: their streams that have times.
    """

    def __init__(
        self,
        folder: Path,
        how: RecordingMap,
        entries: Sequence[FileEntry],
        known: Mapping[str, LogFile] = MappingProxyType({}),
    ) -> None:
        """Read the files of a map, relative to a folder, but for those that are known by their paths there.

        Raises:
          DataError: one cannot be read.
        """
        self.files: list[LogFile] = []
        self.sources: list[Source] = []
        self._timeless: dict[str, str] = {}
        for index, entry in enumerate(entries):
            file = known.get(entry.path)
            if file is None or entry.columns:
                file = open_log(folder / entry.path, entry.format, entry.columns)
            same = [Path(each.path).name for each in entries].count(Path(entry.path).name) > 1
            if same:  # columns are told apart by their paths
                file = replace(file, name=printable(entry.path))
            self.files.append(file)
            _check_entry(file, entry)
            for stream in file.streams:
                self._add(index, file, stream, entry, how)
        streams = [each for file in self.files for each in file.streams]
        time = how.columns.get("time")
        if time and not any(time in each.columns or time in each.texts for each in streams):
            raise self.unknown(time, "column", self.names())

    def points(self, name: str | tuple[str, ...]) -> Found | None:
        """(N, 3) positions by a marker's name, three columns, or names of its parts; None without them."""
        if isinstance(name, tuple):
            if len(name) == 3 and (found := self.columns(name)) is not None:
                return found
            return _joined([self.needed(each) for each in name])
        for suffixes in (POSITION, ("_x", "_y", "_z"), ("_X", "_Y", "_Z"), ("[0]", "[1]", "[2]")):
            found = self.columns([f"{name}{suffix}" for suffix in suffixes])
            more = self.columns([f"{name}[3]"]) if suffixes[0] == "[0]" else None
            if found is not None and more is None:
                return found
        return self.columns(_spread(name)) if SLICE.fullmatch(name) else None

    def needed(self, name: str | tuple[str, ...]) -> Found:
        """The same.

        Raises:
          DataError: there is no such marker; the message names the nearest.
        """
        found = self.points(name)
        if found is None:
            raise self.unknown(
                name if isinstance(name, str) else listed(name), "marker", self.markers()
            )
        return found

    def rotations(self, name: str | tuple[str, ...]) -> Found:
        """(N, 4) quaternions or (N, 3) angles, by the name of a body or by columns.

        Raises:
          DataError: there are none.
        """
        if isinstance(name, tuple):
            tries = [list(name)]
        else:
            indexed = [[f"{name}[{i}]" for i in range(n)] for n in (4, 3)]
            tries = [[f"{name}{s}" for s in QUATERNION], [f"{name}{s}" for s in ANGLES], *indexed]
            if SLICE.fullmatch(name):
                tries.append(_spread(name))
        for columns in tries:
            found = self.columns(columns)
            if found is not None:
                return found
        raise self.unknown(str(name), "rotation", self.names())

    def column(self, name: str) -> Found:
        """(N, 1) one column.

        Raises:
          DataError: there is none of this name; the message names the nearest.
        """
        found = self.columns([name])
        if found is None:
            raise self.unknown(name, "column", self.names())
        return found

    def columns(self, names: Sequence[str]) -> Found | None:
        """(N, k) columns that one source has all of; `file/name` says of which file.

        Raises:
          DataError: several sources have them, or a cell is not a number.
        """
        having = [
            (each, plain) for each in self.sources if (plain := _own(each, names)) is not None
        ]
        if len(having) > 1:
            places = [f"'{each.name}/{plain[0]}'" for each, plain in having]
            if len({*places}) == 1:
                raise DataError(
                    f"{places[0]} is there {len(places)} times: is a file given twice under files?"
                )
            others = listed(places)
            raise DataError(f"{names[0]!r} is in several files or tables: write one of {others}.")
        if not having:
            self._refuse_text(names)
            return None
        source, plain = having[0]
        return Found(source, np.stack([source.stream.columns[each] for each in plain], axis=1))

    def names(self) -> list[str]:
        """Of all columns with times."""
        return [name for each in self.sources for name in each.stream.columns]

    def markers(self) -> list[str]:
        """Names of all markers and bodies with positions."""
        names = set(self.names())
        return [
            n[:-2]
            for n in self.names()
            if n.endswith(".x") and {f"{n[:-2]}.y", f"{n[:-2]}.z"} <= names
        ]

    def without_times(self, name: str) -> str:
        """The reason why a column or marker has no times; "" if it has, or is in no file."""
        begins = (f"{name}.", f"{name}_", f"{name}[")
        found = (n for n in self._timeless if n == name or n.startswith(begins))
        return self._timeless.get(next(found, ""), "")

    def unknown(self, name: str, kind: str, known: Sequence[str]) -> DataError:
        """The message about a name that no file has."""
        where = listed([file.name for file in self.files])
        if problem := self.without_times(name):
            return DataError(problem)
        there = f" There are: {listed([repr(each) for each in known], 12)}." if known else ""
        return DataError(f"{where} has no {kind} {name!r}.{nearest(name, known)}{there}")

    def _add(
        self, index: int, file: LogFile, stream: Stream, entry: FileEntry, how: RecordingMap
    ) -> None:
        if stream.rows is not None and {*entry.where} & {*stream.rows.columns, *stream.rows.texts}:
            stream = stream.rows
        sized: Iterable[Sized] = chain(stream.columns.values(), stream.texts.values())
        size = next(map(len, sized), 0)
        kept = _kept(stream, entry.where, size, file.name)
        time, problem = _time(stream, entry, how, size)
        if time is None:
            words = f"{file.name}: {problem}"
            self._timeless |= dict.fromkeys([*stream.columns, *stream.texts], words)
            return
        columns = {name: values[kept] for name, values in stream.columns.items()}
        texts = {name: [values[i] for i in kept] for name, values in stream.texts.items()}
        made = Stream(
            columns, None, texts, stream.stamps, stream.length, stream.asks_unit, stream.angle
        )
        self.sources.append(Source(index, file.name, time[kept], made, kept + 1))

    def _refuse_text(self, names: Sequence[str]) -> None:
        for each in self.sources:
            for name in names:
                if name in each.stream.texts:
                    try:
                        numbers(each.stream.texts[name], name)
                    except DataError as error:
                        raise DataError(f"{each.name}: {error}") from None


def length_of(source: Source, how: RecordingMap) -> Floats:
    """(3,) metres per unit of x, y and z in a source: by the map, else by the file.

    Raises:
      DataError: neither says it, though such a file should.
    """
    stream = source.stream
    if "points" not in how.units.model_fields_set:
        if stream.asks_unit:
            raise DataError(
                f"{source.name} does not say the unit of its positions: write units: {{points: mm}} (or m, "
                "cm, in, ft) in the map."
            )
        if stream.length is not None:
            return np.full(3, factor_of(stream.length, "the file's unit", None))
    return how.units.metres


def _check_entry(file: LogFile, entry: FileEntry) -> None:
    """Raises DataError for columns of times, or that choose rows, which a file does not have."""
    streams = [each for own in file.streams for each in (own, own.rows) if each is not None]
    known = {name: None for each in streams for name in (*each.columns, *each.texts)}
    given = (entry.time,) if isinstance(entry.time, str) else entry.time
    for key, names in (("time", given), ("where", entry.where)):
        for name in names:
            if name not in known:
                raise DataError(
                    f"{file.name} has no column {name!r}, which the map gives as {key}."
                    f"{nearest(name, known)} There are: {listed([repr(each) for each in known], 12)}."
                )


def _own(source: Source, names: Sequence[str]) -> list[str] | None:
    """The names of columns as the source has them; None if it lacks one."""
    prefix = f"{source.name}/"
    plain = [n if n in source.stream.columns else n.removeprefix(prefix) for n in names]
    return plain if all(each in source.stream.columns for each in plain) else None


def _spread(name: str) -> list[str]:
    """`a[3:6]` as a[3], a[4], a[5]."""
    found = SLICE.fullmatch(name)
    assert found is not None
    return [
        f"{found[1]}[{i}]" for i in range(int(found[2]), min(int(found[3]), int(found[2]) + 100))
    ]


def _joined(parts: Sequence[Found]) -> Found:
    """Parts of a marker's path as one: the first that was seen."""
    first = parts[0]
    if any(each.source is not first.source for each in parts):
        raise DataError("the parts of one marker must be in one file.")
    values = first.values.copy()
    for each in parts[1:]:
        values = np.where(np.isfinite(values).all(axis=1, keepdims=True), values, each.values)
    return Found(first.source, values)


def _kept(stream: Stream, where: Mapping[str, float | str], size: int, file: str) -> np.ndarray:
    """Indices of the rows with the values that the map asks for."""
    kept = np.ones(size, bool)
    for name, value in where.items():
        if name in stream.columns and not isinstance(value, str):
            kept &= stream.columns[name] == value
        elif name in stream.texts:
            kept &= np.array([text.strip() == str(value) for text in stream.texts[name]])
        elif name in stream.columns:
            raise DataError(f"{file}: {name!r} has numbers; where asks for the text {value!r}.")
    if where and kept.sum() < 2:
        told = ", ".join(f"{name}: {value}" for name, value in where.items())
        raise DataError(f"{file}: {int(kept.sum())} of {size} rows have {told}.")
    return np.flatnonzero(kept)


def _time(
    stream: Stream, entry: FileEntry, how: RecordingMap, size: int
) -> tuple[Floats | None, str]:
    """(N,) times of a stream [s], or the reason why there are none."""
    given = (entry.time,) if isinstance(entry.time, str) else entry.time
    renamed = how.columns.get("time")
    for name in [*given, *((renamed,) if renamed else ())]:
        if name in stream.columns:
            return _seconds(stream, name, entry, how), ""
        if name in stream.texts:
            return None, no_times(stream, name)
    if entry.rate is not None:
        return np.arange(size) / entry.rate, ""
    there = [name for name in stream.columns if name.lower() in TIME_NAMES] or sorted(stream.stamps)
    own = stream.time is not None or len(there) == 1
    if own and how.dt is not None:
        return None, "it has times, and the map gives dt too; keep one (dt, or rate under files)."
    if stream.time is not None:
        return stream.time, ""
    if own:
        return _seconds(stream, there[0], entry, how), ""
    if how.dt is not None:
        return np.arange(size) * how.dt, ""
    texts = [name for name in stream.texts if name.lower() in TIME_NAMES]
    if texts and not there:
        return None, no_times(stream, texts[0])
    names = listed([repr(name) for name in [*stream.columns, *stream.texts]], 12)
    asked = f" (the map names {listed([repr(n) for n in given])})" if given else ""
    return None, (
        f"no column is known to be the time{asked}. Name it under files (time: NAME, unit: ms), or give the "
        f"rate (rate: 100). There are: {names}."
    )


def no_times(stream: Stream, name: str) -> str:
    """The reason why a column of texts is none of times."""
    text = next((each for each in stream.texts[name] if each.strip()), "")
    return (
        f"the times {name!r} begin with {shown(text)}. Times are numbers, times of day (10:00:00.5), or "
        "dates (2026-12-01T10:00:00.5); or give the rate (rate: 100)."
    )


def _seconds(stream: Stream, name: str, entry: FileEntry, how: RecordingMap) -> Floats:
    factor = 1.0 if name in stream.stamps else TIMES[entry.unit or how.units.time]
    return stream.columns[name] * factor
