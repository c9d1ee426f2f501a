"""Results as tables: one CSV file per benchmark, one row per case, each row a frozen record.

Numbers have six digits, missing values are empty cells.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from flywheel.outputs import write_output

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

R = TypeVar("R", bound="DataclassInstance")
RESULTS = Path(__file__).with_name("results")


def write_rows(path: Path, rows: Iterable[DataclassInstance]) -> None:
    """Write records of one class, at least one, as CSV."""
    text, values = io.StringIO(), [asdict(row) for row in rows]
    writer = csv.DictWriter(text, list(values[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _cell(value) for name, value in row.items()} for row in values)
    write_output(path, text.getvalue())


def rows_there(kind: type[R], path: Path) -> list[R]:
    """The records of a file, as in `read_rows`; empty without a file."""
    return read_rows(kind, path) if path.exists() else []


def other_rows(
    kind: type[R], path: Path, of: Sequence[str], taken: Collection[tuple[Any, ...]]
) -> list[R]:
    """The records of a file that belong to other results than the imported ones.

    Args:
      kind, path: as in `rows_there`.
      of: names of the fields that identify a result.
      taken: values of these.
    """
    return [row for row in rows_there(kind, path) if values_of(row, of) not in taken]


def grouped(rows: Iterable[R], *names: str) -> dict[tuple[Any, ...], list[R]]:
    """Rows that are alike in some fields, in their order."""
    found: dict[tuple[Any, ...], list[R]] = {}
    for row in rows:
        found.setdefault(tuple(getattr(row, name) for name in names), []).append(row)
    return found


def values_of(row: DataclassInstance, names: Sequence[str]) -> tuple[Any, ...]:
    """The values of some fields of a record."""
    return tuple(getattr(row, name) for name in names)


def read_rows(kind: type[R], path: Path) -> list[R]:
    """Read records of a class whose fields are texts, whole numbers, numbers and truth values."""
    hints = get_type_hints(kind)
    with path.open(newline="", encoding="utf-8") as file:
        return [
            kind(**{each.name: _value(row[each.name], hints[each.name]) for each in fields(kind)})
            for row in csv.DictReader(file)
        ]


def _cell(value: object) -> object:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return value


def _value(text: str, kind: type) -> Any:
    if kind is bool:
        return text == "yes"
    if kind is float:
        return float(text) if text else math.nan
    return kind(text)
