"""A CSV file as columns of numbers, or a message with the faulty line.

It is read piece by piece: its memory is that of the requested numbers, not of its text.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from math import inf
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from flywheel.data.recordings.formats.text import how_written, is_number
from flywheel.data.recordings.report import listed
from flywheel.data.recordings.sources import LONGEST_NAME
from flywheel.errors import DataError
from flywheel.files import MB, is_plain, opened, shown
from flywheel.outputs import printable
from flywheel.records import Floats

LARGEST_FILE = 20_000 * MB  # [bytes]; most of it in columns that nobody wants
MOST_COLUMNS = 10_000
LONGEST_LINE = 1_000_000  # characters
MOST_BLANK = 1_000  # lines before the header
READ_AT_ONCE = 1 << 20  # bytes
CHARACTERS_AT_ONCE = 1 << 22  # characters made numbers at once
# First bytes of packed files.
PACKED = (b"\x1f\x8b", b"PK\x03\x04", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
UTF_16 = (b"\xff\xfe", b"\xfe\xff")

Told = Callable[[int, int], None]  # bytes read, of how many
_Rows = tuple[Floats, NDArray[np.int64]]  # (N, columns), and the line of each


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
        self._text = io.TextIOWrapper(
            io.BufferedReader(self._content, READ_AT_ONCE),
            encoding="utf-8-sig",
            errors="surrogateescape",  # what is not UTF-8 is refused where it is wanted
            newline="",
        )
        begin = _to_first(self._pieces())
        if not begin:
            raise DataError(f"{name} is empty: it has neither a header nor rows.")
        first = begin[-1].lstrip()
        self._delimiter = max(",;\t", key=first.count)
        self._line = 0  # lines that were read
        self.header = self._read_header(begin)

    def read(self, names: Sequence[str], most: int) -> Table:
        """Read some of the columns; the content of the others is ignored.

        Args:
          names: of the columns.
          most: largest number of lines.

        Raises:
          DataError: there are no rows, one has more or fewer cells than the header, a cell is not a
            number, there are too many lines, or the file changes meanwhile.
        """
        values, lines = array("d"), array("q")
        while block := self._text.read(CHARACTERS_AT_ONCE):
            block += self._text.readline(LONGEST_LINE + 1)
            plain = self._plain(block, names)
            found, rows = self._unusual(block, names) if plain is None else plain
            values.frombytes(found.data.cast("B"))
            lines.frombytes(rows.data.cast("B"))
            if self._line > most:
                raise DataError(
                    f"{self.file} has more than {most:,} lines, the most that are read of a log of this "
                    "robot. Cut it into several files."
                )
        if len(lines) < 2:
            raise DataError(
                f"{self.file} has {len(lines)} rows under its header; a recording needs at least 2."
            )
        return Table(
            self._content.digest(),
            tuple(names),
            np.frombuffer(values).reshape(-1, len(names)),
            np.frombuffer(lines, np.int64),
        )

    def _plain(self, block: str, names: Sequence[str]) -> _Rows | None:
        """Columns of lines of which each is a row; None if there are others, or unusual cells."""
        if not block.endswith("\n") or ("\r" in block and block.count("\r") != block.count("\r\n")):
            return None
        quotes = '"' in block and block.count('"')
        if quotes % 2:
            return None
        content = block.encode("utf-8", "surrogateescape")
        try:
            table = arrow_csv.read_csv(
                pa.BufferReader(content),
                arrow_csv.ReadOptions(
                    column_names=self.header, use_threads=False, block_size=len(content) + 1
                ),
                arrow_csv.ParseOptions(delimiter=self._delimiter, ignore_empty_lines=False),
                arrow_csv.ConvertOptions(
                    column_types=dict.fromkeys(names, pa.float64()),
                    include_columns=names,
                    null_values=[""],
                ),
            )
        except pa.ArrowInvalid:
            return None
        count = table.num_rows
        if quotes and count != block.count("\n"):  # a cell with several lines
            return None
        (batch,) = table.to_batches()  # of one block; a column's `to_numpy` would import pandas
        found = batch.to_tensor(null_to_nan=True).to_numpy()
        if np.isnan(found[np.isnan(found[:, 0])]).all(axis=1).any():
            return None
        self._line += count
        return found, np.arange(self._line - count + 1, self._line + 1)

    def _unusual(self, block: str, names: Sequence[str]) -> _Rows:
        """Columns of any lines, cell by cell, to the end of the row that the last one is in."""
        chosen = [self.header.index(name) for name in names]
        values, lines = array("d"), array("q")
        begin = io.StringIO(block, newline="").readlines()
        end = self._line + len(begin)
        for line, row in self._rows(chain(begin, self._pieces()), end):
            if not any(map(str.strip, row)):
                continue
            if len(row) != len(self.header):
                raise DataError(
                    f"{self.file}, line {line} has {len(row)} cells, the header has "
                    f"{len(self.header)} columns."
                )
            values.extend(self._number(row[i], line, self.header[i]) for i in chosen)
            lines.append(line)
        return np.array(values), np.array(lines)

    def _pieces(self) -> Iterator[str]:
        """The next lines, long ones in pieces."""
        return iter(lambda: self._text.readline(LONGEST_LINE + 1), "")

    def _rows(self, lines: Iterable[str], end: float) -> Iterator[tuple[int, list[str]]]:
        """Line and cells of each row, to the one that the line `end` is in."""
        before = self._line
        reader = csv.reader(_checked(self.file, lines, before), delimiter=self._delimiter)
        try:
            for row in reader:
                self._line = before + reader.line_num
                yield self._line, row
                if self._line >= end:
                    return
        except csv.Error as error:
            raise DataError(
                f"{self.file}, line {before + reader.line_num}: {error}. Is a quotation mark not closed?"
            ) from None

    def _read_header(self, begin: list[str]) -> tuple[str, ...]:
        for _, row in islice(self._rows(chain(begin, self._pieces()), inf), MOST_BLANK):
            if any(map(str.strip, row)):
                header = tuple(name.strip() for name in row)
                _check_header(self.file, header)
                return header
        raise DataError(f"{self.file} is empty: it has neither a header nor rows.")

    def _number(self, cell: str, line: int, name: str) -> float:
        """Number of a cell; NaN if it is empty.

        Raises:
          DataError: it is not a number.
        """
        try:
            return float(cell.strip() or "nan")
        except ValueError:
            raise DataError(
                f"{self.file}, line {line}, column {name!r}: {shown(cell.strip())} is not a number. A cell "
                f"that was not measured is empty or NaN.{_hint(cell)}"
            ) from None


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


def _checked(file: str, lines: Iterable[str], before: int) -> Iterator[str]:
    for number, line in enumerate(lines, before + 1):
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
    numbers = [cell for cell in header if is_number(cell)]
    if len(numbers) > len(header) / 2:
        raise DataError(
            f"{file} has no header: its first line is {listed(header, 4)}. The first line names the "
            "columns: time, ctrl.<actuator>, <sensor>.x, ..."
        )
    twice = [repr(name) for name, n in Counter(header).items() if name and n > 1]
    if twice:
        raise DataError(f"{file} has columns of the same name: {listed(twice)}.")


def _hint(text: str) -> str:
    """Possible cause of an invalid number or name."""
    if any("\udc80" <= character <= "\udcff" for character in text):
        return " The file is not in UTF-8: save it so."
    return how_written(text)
