"""Text of tables: lines for headers, and columns of numbers by pyarrow."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from flywheel.errors import DataError
from flywheel.files import MB, read_bytes, shown
from flywheel.records import Floats

LARGEST_TEXT = 1_000 * MB  # [bytes]
MOST_HEADER = 1 << 20  # bytes in which the header must end
MISSING = [
    "",
    "nan",
    "NaN",
    "NAN",
    "null",
    "NULL",
    "N/A",
    "n/a",
    "NA",
    "#N/A",
    "-nan",
    "None",
    "-",
    "--",
]
DELIMITERS = ",;\t"
UTF_16 = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}

CLOCK = re.compile(r"(\d{1,2}):([0-5]\d):([0-5]\d(?:[.,]\d+)?)")
DAY = 86_400.0  # [s]
THOUSANDS = re.compile(r"[-+]?\d{1,3}([., '\u2019\u00a0\u202f])\d{3}(\1\d{3})*([.,]\d*)?")

Column = Floats | list[str]


def content_of(path: Path) -> bytes:
    """The bytes of a text in UTF-8, without a byte order mark; a text in UTF-16 is converted."""
    content = read_bytes(path, "recording", DataError, LARGEST_TEXT)
    if content[:2] in UTF_16:
        try:
            return content.decode(UTF_16[content[:2]]).encode()
        except UnicodeDecodeError:
            raise DataError("it begins as a text in UTF-16, and is none.") from None
    return content.removeprefix(b"\xef\xbb\xbf")


def head(content: bytes, lines: int) -> list[str]:
    """The first lines of a text; bytes that are no UTF-8 are taken for Latin letters."""
    begin = content[:MOST_HEADER]
    try:
        text = begin.decode()
    except UnicodeDecodeError:
        text = begin.decode("latin-1")
    return text.splitlines()[:lines]


def cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without the blanks around them."""
    try:
        row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error as error:
        raise DataError(f"a line of the header cannot be read: {error}.") from None
    return [cell.strip().strip('"').strip() for cell in row]


def after_line(content: bytes, lines: int) -> bytes:
    """The text behind its first lines."""
    position = 0
    for _ in range(lines):
        position = content.find(b"\n", position) + 1
        if position == 0:
            return b""
    return content[position:]


def columns(
    content: bytes, delimiter: str, width: int, row: int = 1, point: str = "."
) -> list[Column]:
    """Columns of a table without a header, each as numbers, or as texts where one of its cells is no number.

    Args:
      content: its text.
      delimiter: between cells.
      width: number of columns; shorter rows end with missing cells.
      row: line of the file at which it begins, for messages.
      point: before decimals.

    Raises:
      DataError: there are no rows, or a row has too many cells.
    """
    if not content.strip():
        raise DataError("there are no rows under the header.")
    first = next(line for line in content[:MOST_HEADER].splitlines() if line.strip(b"\r\n"))
    wide = first.count(delimiter.encode()) + 1
    try:  # rows may end with a delimiter
        table = _read(content, delimiter, wide if wide == width + 1 else width, point)
    except pa.ArrowInvalid:
        table = _read(_padded(content, delimiter, width, row), delimiter, width, point)
    return _without_blanks([_column(each, point) for each in table.columns[:width]])


def _without_blanks(found: list[Column]) -> list[Column]:
    """The columns without the rows in which all cells are missing, as spreadsheets write empty lines."""
    first = found[0]
    missing = np.isnan(first) if isinstance(first, np.ndarray) else np.array([not c for c in first])
    rows = np.flatnonzero(missing)
    for each in found[1:]:
        if not len(rows):
            return found
        some = each[rows] if isinstance(each, np.ndarray) else [each[i] for i in rows]
        rows = rows[np.isnan(some) if isinstance(some, np.ndarray) else [not cell for cell in some]]
    kept = np.setdiff1d(np.arange(len(first)), rows)
    if len(kept) == len(first):
        return found
    return [
        each[kept] if isinstance(each, np.ndarray) else [each[i] for i in kept] for each in found
    ]


def _read(content: bytes, delimiter: str, width: int, point: str) -> pa.Table:
    names = [str(i) for i in range(width)]
    return arrow_csv.read_csv(
        pa.BufferReader(content),
        arrow_csv.ReadOptions(column_names=names, use_threads=False),
        arrow_csv.ParseOptions(delimiter=delimiter),
        arrow_csv.ConvertOptions(
            null_values=MISSING, strings_can_be_null=True,  true_values=[], false_values=[],
            decimal_point=point,
        ),
    )  # fmt: skip


def _padded(content: bytes, delimiter: str, width: int, row: int) -> bytes:
    """The same table with a cell in each column of each row."""
    text = io.StringIO(content.decode("utf-8", "replace"), newline="")
    made = io.StringIO(newline="")
    writer = csv.writer(made, delimiter=delimiter, lineterminator="\n")
    try:
        for number, cut in enumerate(csv.reader(text, delimiter=delimiter), row):
            if not any(map(str.strip, cut)):
                continue
            if any(map(str.strip, cut[width:])):
                raise DataError(f"line {number} has {len(cut)} cells, the header has {width}.")
            writer.writerow(cut[:width] + [""] * (width - len(cut)))
    except csv.Error as error:
        raise DataError(f"its rows cannot be read: {error}.") from None
    if not made.tell():
        raise DataError("there are no rows under the header.")
    return made.getvalue().encode()


def _column(values: pa.ChunkedArray, point: str) -> Column:
    kind = values.type
    if pa.types.is_timestamp(kind):
        return (
            np.asarray(values.cast(pa.timestamp("ns", kind.tz)).cast(pa.int64()).to_numpy()) / 1e9
        )
    if not pa.types.is_string(kind) and not pa.types.is_binary(kind):
        try:
            return np.asarray(values.cast(pa.float64()).to_numpy(), np.float64)
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            pass  # a time of day, or the like
    texts = ["" if each is None else _text(each) for each in values.to_pylist()]
    try:
        if point == "." or not any("." in each for each in texts):  # else those of thousands
            return np.array([float(each.strip() or "nan") for each in texts])
    except ValueError:
        pass
    return texts if (seconds := _times_of_day(texts)) is None else seconds


def _times_of_day(texts: Sequence[str]) -> Floats | None:
    """Seconds from the first midnight on, of times such as 23:59:58.25; None if there are others."""
    found = [CLOCK.fullmatch(each.strip()) for each in texts]
    hours = np.array([[g.replace(",", ".") for g in m.groups()] for m in found if m], float)
    if len(hours) < len(found) or not len(found):
        return None
    seconds = hours @ [3600.0, 60.0, 1.0]
    nights = np.cumsum(np.diff(seconds, prepend=seconds[:1]) < -DAY / 2)
    return np.asarray(seconds + DAY * nights)


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def numbers(column: Column, name: str) -> Floats:
    """A column as numbers.

    Raises:
      DataError: one of its cells is no number.
    """
    if isinstance(column, np.ndarray):
        return column
    wrong = (each for each in enumerate(column, 1) if not is_number(each[1].strip() or "nan"))
    points = (each for each in enumerate(column, 1) if "." in each[1])  # where decimals have commas
    row, cell = next(chain(wrong, points))
    raise DataError(
        f"row {row} of {name!r} is {shown(cell)}, which is not a number. A cell that was not measured is "
        f"empty or NaN.{how_written(cell)}"
    )


def is_number(text: str) -> bool:
    """True for a text that is a number with a decimal point, or NaN."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def how_written(cell: str) -> str:
    """A sentence about how a number is written that cannot be read; "" if nothing is known."""
    if THOUSANDS.fullmatch(cell.strip()):
        return " Thousands are written without separators."
    return " Decimals are written with a point." if "," in cell else ""


def distinct(names: Sequence[str]) -> list[str]:
    """The names, the second of the same ones as `name (2)`."""
    seen, found = Counter[str](), []
    for name in names:
        seen[name] += 1
        found.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return found
