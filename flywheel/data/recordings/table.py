"""A CSV file as columns of numbers, or a sentence that says in which line it is not."""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.report import listed
from flywheel.errors import DataError
from flywheel.records import Floats


@dataclass(frozen=True)
class Table:
    """The numbers of a CSV file.

    Attributes:
      file: its name, for messages.
      digest: sha256 of its bytes.
      header: names of the columns.
      values: (N, columns); NaN where a cell is empty.
      lines: (N,) the file's line of each row, counted from 1.
    """

    file: str
    digest: str
    header: tuple[str, ...]
    values: Floats
    lines: NDArray[np.int64]

    def column(self, name: str) -> Floats:
        """The values (N,) of a column."""
        return self.values[:, self.header.index(name)]


def read_table(path: Path) -> Table:
    """Read a CSV file; its cells are separated by commas, semicolons or tabs.

    Raises:
      DataError: it cannot be read, is empty, has no header or no rows, or a cell is no number.
    """
    try:
        content = path.read_bytes()
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"There is no recording {path}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path.name} cannot be read as text: {error}.") from None
    if not text.strip():
        raise DataError(f"{path.name} is empty: it has neither a header nor rows.")
    first = text.lstrip().splitlines()[0]
    separator = max(",;\t", key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=separator)
    try:
        rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise DataError(f"{path.name}, line {reader.line_num}: {error}.") from None
    header = tuple(name.strip() for name in rows[0][1])
    _check_header(path.name, header)
    if len(rows) < 3:
        raise DataError(
            f"{path.name} has {len(rows) - 1} rows under its header; a recording needs at least 2."
        )
    values = np.array([_numbers(path.name, header, line, row) for line, row in rows[1:]])
    lines = np.array([line for line, _ in rows[1:]], np.int64)
    return Table(path.name, hashlib.sha256(content).hexdigest(), header, values, lines)


def _check_header(file: str, header: tuple[str, ...]) -> None:
    numbers = [cell for cell in header if _is_number(cell)]
    if len(numbers) > len(header) / 2:
        raise DataError(
            f"{file} has no header: its first line is {listed(header, 4)}. The first line names the "
            "columns: time, ctrl.<actuator>, <sensor>.x, ..."
        )
    twice = [repr(name) for name, n in Counter(header).items() if n > 1]
    if twice:
        raise DataError(f"{file} has columns of the same name: {listed(twice)}.")


def _numbers(file: str, header: tuple[str, ...], line: int, row: Sequence[str]) -> list[float]:
    if len(row) != len(header):
        raise DataError(
            f"{file}, line {line} has {len(row)} cells, the header has {len(header)} columns."
        )
    found = []
    for name, text in zip(header, row, strict=True):
        cell = text.strip()
        if cell and not _is_number(cell):
            hint = " Decimals are written with a point." if "," in cell else ""
            raise DataError(
                f"{file}, line {line}, column {name!r}: {cell!r} is no number. A cell that was not "
                f"measured is empty or NaN.{hint}"
            )
        found.append(float(cell) if cell else np.nan)
    return found


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
