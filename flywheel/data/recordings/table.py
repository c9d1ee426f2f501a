"""A CSV file as columns of numbers, or a message with the faulty line.

It is read line by line: its memory is that of the requested numbers, not of its text.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
import unicodedata
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from flywheel.data.recordings.report import listed
from flywheel.errors import DataError
from flywheel.files import MB, opened, shown
from flywheel.outputs import printable
from flywheel.records import Floats

LARGEST_FILE = 20_000 * MB  # [bytes]; most of it in columns that nobody wants
MOST_COLUMNS = 10_000
LONGEST_NAME = 200  # characters of a column's name
LONGEST_LINE = 1_000_000  # characters
MOST_BLANK = 1_000  # lines before the header
READ_AT_ONCE = 1 << 20  # bytes
CELLS_AT_ONCE = 5_000  # cells converted to numbers at once
# First bytes of packed files.
PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")

Told = Callable[[int, int], None]  # bytes read, of how many


@dataclass(frozen=True)
class Table:
    """Numbers of a CSV file.

    Attributes:
      digest: sha256 of the file's bytes.
      names: of the columns that were read.
      values: (N, names); NaN where a cell is empty.
      lines: (N,) the file's line of each row, counted from 1.
    """

    digest: str
    names: tuple[str, ...]
    values: Floats
    lines: NDArray[np.int64]

    def columns(self, names: Sequence[str]) -> Floats:
        """A copy of the values (N, names) of some columns."""
        return self.values[:, [self.names.index(name) for name in names]]


@contextmanager
def open_table(path: Path, told: Told | None = None) -> Iterator[OpenTable]:
    """Open a CSV file; its cells are separated by commas, semicolons or tabs.

    Args:
      path: of the file.
      told: called during reading, with the bytes so far and those of the file.

    Raises:
      DataError: it cannot be read, is not text in UTF-8, or has no header.
    """
    with opened(path, "recording", DataError, LARGEST_FILE) as file:
        yield OpenTable(printable(path.name), file, told)


class OpenTable:
    """A CSV file of which only the header has been read; see `open_table`.

    Attributes:
      file: its name, for messages.
      header: names of its columns.
    """

    def __init__(self, name: str, file: BinaryIO, told: Told | None) -> None:
        self.file = name
        self._content = _Content(name, file, told)
        text = io.TextIOWrapper(
            io.BufferedReader(self._content, READ_AT_ONCE),
            encoding="utf-8-sig",
            errors="surrogateescape",  # what is not UTF-8 is refused where it is wanted
            newline="",
        )
        lines = _lines(name, text)
        begin = _to_first(lines)
        if not begin:
            raise DataError(f"{name} is empty: it has neither a header nor rows.")
        first = begin[-1].lstrip()
        self._reader = csv.reader(chain(begin, lines), delimiter=max(",;\t", key=first.count))
        self.header = self._read_header()

    def read(self, names: Sequence[str], most: int) -> Table:
        """Read some of the columns; the content of the others is ignored.

        Args:
          names: of the columns.
          most: largest number of lines.

        Raises:
          DataError: there are no rows, one has more or fewer cells than the header, a cell is not a
            number, there are too many lines, or the file changes meanwhile.
        """
        chosen = [self.header.index(name) for name in names]
        values, lines, cells = array("d"), array("q"), list[str]()
        for row in self._rows():
            if self._reader.line_num > most:
                raise DataError(
                    f"{self.file} has more than {most:,} lines, the most that are read of a log of this "
                    "robot. Cut it into several files."
                )
            if not any(map(str.strip, row)):
                continue
            if len(row) != len(self.header):
                raise DataError(
                    f"{self.file}, line {self._reader.line_num} has {len(row)} cells, the header has "
                    f"{len(self.header)} columns."
                )
            cells += [row[index] for index in chosen]
            lines.append(self._reader.line_num)
            if len(cells) >= CELLS_AT_ONCE:
                values.frombytes(self._numbers(cells, names, lines).tobytes())
                cells.clear()
        values.frombytes(self._numbers(cells, names, lines).tobytes())
        if len(lines) < 2:
            raise DataError(
                f"{self.file} has {len(lines)} rows under its header; a recording needs at least 2."
            )
        return Table(
            self._content.digest(),
            tuple(names),
            np.frombuffer(values).reshape(-1, len(chosen)),
            np.frombuffer(lines, np.int64),
        )

    def _rows(self) -> Iterator[list[str]]:
        try:
            yield from self._reader
        except csv.Error as error:
            raise DataError(
                f"{self.file}, line {self._reader.line_num}: {error}. Is a quotation mark not closed?"
            ) from None

    def _read_header(self) -> tuple[str, ...]:
        for row in islice(self._rows(), MOST_BLANK):
            if any(map(str.strip, row)):
                header = tuple(name.strip() for name in row)
                _check_header(self.file, header)
                return header
        raise DataError(f"{self.file} is empty: it has neither a header nor rows.")

    def _numbers(self, cells: list[str], names: Sequence[str], lines: Sequence[int]) -> Floats:
        """Numbers of the cells of the last rows of a table.

        Raises:
          DataError: a cell is not a number; the message gives its line and column.
        """
        try:
            text = pa.array([cell or "nan" for cell in cells], pa.string())
            return np.asarray(text.cast(pa.float64()))
        except (pa.ArrowInvalid, UnicodeEncodeError):
            pass  # a way to write numbers that is unusual, or none
        found, first = [], len(lines) - len(cells) // len(names)
        for index, cell in enumerate(map(str.strip, cells)):
            try:
                found.append(float(cell or "nan"))
            except ValueError:
                row, column = divmod(index, len(names))
                raise DataError(
                    f"{self.file}, line {lines[first + row]}, column {names[column]!r}: "
                    f"{shown(cell)} is not a number. A cell that was not measured is empty or "
                    f"NaN.{_hint(cell)}"
                ) from None
        return np.array(found)


class _Content(io.RawIOBase):
    """A file's bytes, counted and hashed during reading."""

    def __init__(self, name: str, file: BinaryIO, told: Told | None) -> None:
        self._name, self._file, self._told = name, file, told
        self._before = os.fstat(file.fileno())
        self._sha256, self._read = hashlib.sha256(), 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        try:
            content = self._file.read(len(buffer))
        except OSError as error:
            raise DataError(f"{self._name} cannot be read: {error.strerror}.") from None
        if self._read == 0:
            _check_text(self._name, content)
        buffer[: len(content)] = content
        self._sha256.update(content)
        self._read += len(content)
        if self._told:
            self._told(self._read, self._before.st_size)
        return len(content)

    def digest(self) -> str:
        """Size and digest of the file, after its end was reached.

        Raises:
          DataError: it changed since it was opened.
        """
        now, before = os.fstat(self._file.fileno()), self._before
        if (self._read, now.st_mtime_ns) != (before.st_size, before.st_mtime_ns):
            raise DataError(
                f"{self._name} changed while it was read. Is it still being written? Import it "
                "when it is complete."
            )
        return self._sha256.hexdigest()


def _lines(file: str, text: io.TextIOBase) -> Iterator[str]:
    number = 0
    while line := text.readline(LONGEST_LINE + 1):
        number += 1
        if len(line) > LONGEST_LINE:
            raise DataError(
                f"{file}, line {number} has more than {LONGEST_LINE:,} characters. Is it a CSV file?"
            )
        yield line


def _to_first(lines: Iterable[str]) -> list[str]:
    """The lines up to the first that is not blank; none if there is none."""
    found = []
    for line in islice(lines, MOST_BLANK):
        found.append(line)
        if line.strip():
            return found
    return []


def _check_text(file: str, begin: bytes) -> None:
    if begin.startswith(PACKED):
        raise DataError(f"{file} is compressed, or a spreadsheet. Unpack it, or save it as CSV.")
    if begin.startswith(UTF_16) or b"\0" in begin:
        raise DataError(
            f"{file} is not text in UTF-8 (it may be in UTF-16). Save it as CSV in UTF-8."
        )


def _check_header(file: str, header: tuple[str, ...]) -> None:
    if len(header) > MOST_COLUMNS:
        raise DataError(f"{file} has {len(header):,} columns; at most {MOST_COLUMNS:,} are read.")
    for number, name in enumerate(header, 1):
        if len(name) > LONGEST_NAME or not is_plain(name):
            raise DataError(
                f"{file}: the name of column {number} is {shown(name)}; a name has at most {LONGEST_NAME} "
                f"characters, and no control characters.{_hint(name)}"
            )
    numbers = [cell for cell in header if _is_number(cell)]
    if len(numbers) > len(header) / 2:
        raise DataError(
            f"{file} has no header: its first line is {listed(header, 4)}. The first line names the "
            "columns: time, ctrl.<actuator>, <sensor>.x, ..."
        )
    twice = [repr(name) for name, n in Counter(header).items() if n > 1]
    if twice:
        raise DataError(f"{file} has columns of the same name: {listed(twice)}.")


def is_plain(text: str) -> bool:
    """True if a text can be shown to people: no control characters, and all of it was UTF-8."""
    return all(unicodedata.category(c) not in ("Cc", "Cs") or c in "\t\r\n" for c in text)


def _hint(text: str) -> str:
    """Possible cause of an invalid number or name."""
    if any("\udc80" <= character <= "\udcff" for character in text):
        return " The file is not in UTF-8: save it so."
    if "," in text:
        return " Decimals are written with a point."
    return ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
