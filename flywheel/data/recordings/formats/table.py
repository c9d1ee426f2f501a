"""Tables of text: columns separated by commas, semicolons, tabs or blanks, with or without a header."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median

import numpy as np

from flywheel.data.recordings.formats.long import by_marker
from flywheel.data.recordings.formats.stream import Contents, Stream
from flywheel.data.recordings.formats.text import (
    DELIMITERS,
    after_line,
    cells,
    columns,
    content_of,
    distinct,
    head,
)
from flywheel.errors import DataError
from flywheel.records import Floats

AXES = ("x", "y", "z")
HEADER_LINES = 200  # comments and titles before the rows
NUMBER = re.compile(r"[-+]?[\d.,:eE+\-TZ /]*\d[\d.,:eE+\-TZ /]*|nan|NaN")  # or a date
WITH_COMMA = re.compile(r"[-+]?\d+,\d+(e[-+]?\d+)?", re.I)
BLANKS = re.compile(rb"[ \t]+")


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Lines that begin with # or % are comments, the last of them may be the header."""
    content = content_of(path)
    lines = head(content, HEADER_LINES)
    first = _first_row(lines)
    delimiter = _delimiter(lines[first])
    if delimiter == " ":
        body = b"\n".join(
            BLANKS.sub(b" ", line.strip()) for line in after_line(content, first).split(b"\n")
        )
    else:
        body = after_line(content, first)
    row = _split(lines[first], delimiter)
    header = list(names)
    if not names and not _all_numbers(row):
        header, body, first = row, after_line(body, 1), first + 1
    elif (
        not names
        and first
        and len(comment := _split(lines[first - 1].lstrip("#% "), delimiter)) == len(row)
    ):
        header = comment
    elif not names:
        header = [f"column {i}" for i in range(1, len(row) + 1)]
    if len(header) < len(row):
        raise DataError(f"line {first + 1} has {len(row)} columns; {len(header)} names are given.")
    header = [name or f"column {i}" for i, name in enumerate(header, 1)]
    begin = [_split(line, delimiter) for line in head(body, 3)]
    if begin and sum(cell.lower() in AXES for cell in begin[0]) > len(header) / 2:
        header = _with_axes(header, begin[0])
        body, first, begin = after_line(body, 1), first + 1, begin[1:]
    if len(begin) >= 2 and _numbers(begin[0]) == 0 < _numbers(begin[1]):  # a row of units
        body, first, begin = after_line(body, 1), first + 1, begin[1:]
    point = "," if begin and delimiter != "," and _decimal_comma(begin[0]) else "."
    each = columns(body, delimiter, len(header), first + 1, point)
    found = dict(zip(distinct(header), each, strict=True))
    values = {name: each for name, each in found.items() if isinstance(each, np.ndarray)}
    values |= _whole_times(values)
    texts = {name: each for name, each in found.items() if not isinstance(each, np.ndarray)}
    stamps = frozenset(name for name, each in _stamped(found, body, delimiter) if each)
    return Contents((by_marker(Stream(values, texts=texts, stamps=stamps)),))


def _first_row(lines: Sequence[str]) -> int:
    """Index of the header, or of the first row: of the first line that is no comment, or, after titles, of
    the first that is half as wide as lines usually are, if it has names.

    Raises:
      DataError: all lines are comments.
    """
    rows = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"]
    if not rows:
        raise DataError("it has no rows.")
    delimiter = _delimiter(lines[rows[-1]])
    wide = [_width(lines[row], delimiter) for row in rows]
    found = next(row for row, width in zip(rows, wide, strict=True) if width >= median(wide) / 2)
    unnamed = _all_numbers(_split(lines[found], delimiter))
    return rows[0] if unnamed and wide[0] else found


def _delimiter(line: str) -> str:
    """Of the cells of a line: a comma, a semicolon, a tab, or a blank."""
    for between in (";", "\t", None):
        row = line.split(between)
        commas = [cell.strip() for cell in row if "," in cell]
        if len(row) > 1 and sum(map(bool, map(WITH_COMMA.fullmatch, commas))) > len(commas) / 2:
            return between or " "
    most = max(DELIMITERS, key=line.count)
    return most if most in line else " "


def has_decimal_commas(begin: bytes) -> bool:
    """True for the beginning of a table whose second line has decimals behind commas."""
    lines = [line for line in head(begin, HEADER_LINES) if line.strip()][1:2]
    delimiter = _delimiter(lines[0]) if lines else ","
    return delimiter != "," and _decimal_comma(_split(lines[0], delimiter))


def _width(line: str, delimiter: str) -> int:
    """Delimiters of a line before its last cell that is not empty."""
    if delimiter == " ":
        return len(line.split()) - 1
    return line.rstrip(f"{delimiter} ").count(delimiter)


def _with_axes(header: Sequence[str], axes: Sequence[str]) -> list[str]:
    """Names of columns where a row of x, y and z is under the markers, each of which may be named once."""
    found, owner = list(header), ""
    for i, (name, axis) in enumerate(zip(header, axes, strict=False)):
        owner = owner if name == f"column {i + 1}" else name
        if axis.lower() in AXES:
            found[i] = f"{owner}.{axis.lower()}"
        elif name == f"column {i + 1}":
            found[i] = axis or name
    return found


def _whole_times(columns: Mapping[str, Floats]) -> dict[str, Floats]:
    """Times of ROS whose seconds and nanoseconds are columns, `stamp.sec` and `stamp.nanosec`: `stamp`."""
    found = dict[str, Floats]()
    for name in columns:
        parts = re.fullmatch(r"((.*?)[._/]?)(?:nano|n)(secs?)", name)
        if parts is not None and (seconds := parts[1] + parts[3]) in columns:
            found[parts[2] or "time"] = columns[seconds] + 1e-9 * columns[name]
    return {name: times for name, times in found.items() if name not in columns}


def _split(line: str, delimiter: str) -> list[str]:
    return line.split() if delimiter == " " else cells(line, delimiter)


def _all_numbers(row: list[str]) -> bool:
    """True for a first row of data: more than half of its cells are numbers, or dates."""
    filled = [cell for cell in row if cell]
    return sum(NUMBER.fullmatch(cell) is not None for cell in filled) > len(filled) / 2


def _numbers(row: list[str]) -> int:
    """Cells that are numbers, or times."""
    return sum(bool(re.match(r"[-+]?[.,]?\d", cell)) for cell in row)


def _decimal_comma(row: list[str]) -> bool:
    """True for a row of numbers whose decimals are behind a comma."""
    decimals = [bool(WITH_COMMA.fullmatch(cell)) for cell in row]
    return any(decimals) and not any(re.fullmatch(r"[-+]?\d*\.\d+", cell) for cell in row)


def _stamped(found: Iterable[str], body: bytes, delimiter: str) -> list[tuple[str, bool]]:
    """Names of the columns, and True for those that are dates."""
    first = head(body, 1)
    row = _split(first[0], delimiter) if first else []
    dates = [bool(re.match(r"\d{4}-\d\d-\d\d[T ]\d\d:", cell)) for cell in row]
    if delimiter == " ":
        return []
    return list(zip(found, dates, strict=False))
