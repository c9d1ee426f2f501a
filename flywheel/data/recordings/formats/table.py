"""Tables of text: columns separated by commas, semicolons, tabs or blanks, with or without a header."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

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

HEADER_LINES = 200  # comments and titles before the rows
BLANKS = re.compile(rb"[ \t]+")


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Lines that begin with # or % are comments, the last of them may be the header."""
    content = content_of(path)
    lines = head(content, HEADER_LINES)
    first = next(
        (i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), None
    )
    if first is None:
        raise DataError("it has no rows.")
    delimiter = max(DELIMITERS, key=lines[first].count)
    if lines[first].count(delimiter) == 0:
        delimiter = " "
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
    begin = [_split(line, delimiter) for line in head(body, 2)]
    if len(begin) == 2 and _numbers(begin[0]) == 0 < _numbers(begin[1]):  # a row of units
        body, first, begin = after_line(body, 1), first + 1, begin[1:]
    point = "," if begin and delimiter != "," and _decimal_comma(begin[0]) else "."
    each = columns(body, delimiter, len(header), first + 1, point)
    found = dict(zip(distinct(header), each, strict=True))
    values = {name: each for name, each in found.items() if isinstance(each, np.ndarray)}
    texts = {name: each for name, each in found.items() if not isinstance(each, np.ndarray)}
    stamps = frozenset(name for name, each in _stamped(found, body, delimiter) if each)
    return Contents((by_marker(Stream(values, texts=texts, stamps=stamps)),))


def _split(line: str, delimiter: str) -> list[str]:
    return line.split() if delimiter == " " else cells(line, delimiter)


def _all_numbers(row: list[str]) -> bool:
    """True for a first row of data: more than half of its cells are numbers, or dates."""
    return (
        sum(
            bool(re.fullmatch(r"[-+]?[\d.,:eE+\-TZ /]*\d[\d.,:eE+\-TZ /]*|nan|NaN|", c))
            for c in row
        )
        > len(row) / 2
    )


def _numbers(row: list[str]) -> int:
    """Cells that are numbers, or times."""
    return sum(bool(re.match(r"[-+]?[.,]?\d", cell)) for cell in row)


def _decimal_comma(row: list[str]) -> bool:
    """True for a row of numbers whose decimals are behind a comma."""
    decimals = [bool(re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", cell, re.I)) for cell in row]
    return any(decimals) and not any(re.fullmatch(r"[-+]?\d*\.\d+", cell) for cell in row)


def _stamped(found: Iterable[str], body: bytes, delimiter: str) -> list[tuple[str, bool]]:
    """Names of the columns, and True for those that are dates."""
    first = head(body, 1)
    row = _split(first[0], delimiter) if first else []
    dates = [bool(re.match(r"\d{4}-\d\d-\d\d[T ]\d\d:", cell)) for cell in row]
    if delimiter == " ":
        return []
    return list(zip(found, dates, strict=False))
