"""Numbers of a table's cells: one row each, and their page."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchmarks.paper.definition import TableConfig

COLUMNS = {  # field -> title; the first four are those that publications have
    "full_mse": "whole: MSE/L [%]",
    "full_rot": "whole: turn [deg]",
    "short_mse": "short: MSE/L [%]",
    "short_rot": "short: turn [deg]",
}
_PARTS = {"whole": "full", "short": "short"}
NUMBERS = (
    *COLUMNS, "full_rmse", "short_rmse", "learned", "tested", "fit_cpu", "rollout_cpu",
)  # fmt: skip


@dataclass(frozen=True)
class CellRow:
    """Errors of one model on one data set.

    Attributes:
      robot, dataset, method, seed: of the cell.
      length: L [m].
      learned, tested: duration of the training and the test data [s].
      train, test: digests of their snapshots.
      settings: digest of everything else that determines the numbers.
      full_mse, short_mse: mean squared distance of the centres of mass, summed over x, y, z, over L, of
        whole trajectories and over a short horizon [% of a length]; NaN if a prediction diverged.
      full_rmse, short_rmse: root of the mean squared distance, over L [%].
      full_rot, short_rot: mean angle between the axes [deg].
      fit_cpu: time of the processor for training or fit [s]; since the last start, if it was resumed.
      rollout_cpu: time of the processor per second of a whole trajectory [-].
      problem: message of a diverging model; "" without one.
    """

    robot: str
    dataset: str
    method: str
    seed: int
    length: float
    learned: float
    tested: float
    train: str
    test: str
    settings: str
    full_mse: float = math.nan
    full_rmse: float = math.nan
    full_rot: float = math.nan
    short_mse: float = math.nan
    short_rmse: float = math.nan
    short_rot: float = math.nan
    fit_cpu: float = math.nan
    rollout_cpu: float = math.nan
    problem: str = ""


Column = Callable[[Sequence[CellRow]], str]  # cell of a model's rows


def page(table: TableConfig, rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: errors beside published ones, in other units, and costs, for each robot."""
    lines = [f"# {table.name}", "", *_about(table, rows)]
    for robot in dict.fromkeys(row.robot for row in rows):
        own = [row for row in rows if row.robot == robot]
        lines += ["", f"## {robot}", "", *errors_table(table, own), "", *units_table(own)]
        lines += ["", *costs_table(own)]
    return [*lines, "", *_digests(rows)]


def errors_table(table: TableConfig, rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: mean and deviation over data sets and seeds, and published numbers in brackets."""
    return _lines("model", _errors(table), rows)


def units_table(rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: the position errors in other units in use."""
    columns: dict[str, Column] = {}
    for title, part in _PARTS.items():
        columns |= {
            f"{title}: RMSE/L [%]": _means(f"{part}_rmse"),
            f"{title}: MSE/L, mean over xyz [%]": _means(f"{part}_mse", 1 / 3),
            f"{title}: MSE [m^2]": _means(f"{part}_mse", rows[0].length / 100),
        }
    return _lines("model", columns, rows)


def costs_table(rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: the data, and the processor's time for training and predictions."""
    return _lines("model", _COSTS, rows)


def result_table(table: TableConfig, rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: errors beside published ones, and costs, in one table for each robot."""
    roots = {f"{name}: RMSE/L [%]": _means(f"{part}_rmse") for name, part in _PARTS.items()}
    costs = {name: column for name, column in _COSTS.items() if name != "data [min]"}
    lines: list[str] = []
    for robot in dict.fromkeys(row.robot for row in rows):
        own = [row for row in rows if row.robot == robot]
        lines += ["", *_lines(f"{robot}: model", {**_errors(table), **roots, **costs}, own)]
    return lines[1:]


def plants_table(rows: Sequence[CellRow], beside: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: errors on each data set, and their mean; those of other rows there in brackets."""

    def mean(own: Sequence[CellRow]) -> CellRow:
        means: dict[str, Any] = {
            name: statistics.fmean(getattr(row, name) for row in own) for name in COLUMNS
        }
        return replace(own[0], dataset="mean", **means)

    def with_mean(rows: Sequence[CellRow]) -> list[CellRow]:
        return [*rows, *(mean(own) for own in _groups(rows, "dataset"))]

    there = {row.dataset for row in rows}
    known = with_mean([row for row in beside if row.dataset in there])
    others = {own[0].dataset: own for own in _groups(known, "dataset")}

    def column(name: str) -> Column:
        return lambda own: f"{spread(own, name)} ({spread(others[own[0].dataset], name)})"

    columns = {title: column(name) for name, title in COLUMNS.items()}
    return _lines("plant", columns, with_mean(rows), "dataset")


def left_out_table(tables: Iterable[tuple[TableConfig, Sequence[CellRow]]]) -> list[str]:
    """Lines of Markdown: a row for each table, with the number of its cells, and all that have no cell.

    Rows of other seeds than the table's count as well, by themselves.
    """
    parts = {"robots": "robot", "data sets": "dataset", "models": "method", "seeds": "seed"}
    lines = _head("table", ["cells", *(f"{name} without any" for name in parts)])
    for table, rows in tables:
        own = [row for row in rows if row.seed in table.seeds]
        more = f", and {len(rows) - len(own)} of other seeds" if len(own) < len(rows) else ""
        cells = [f"{len(own)} of {len(table.cells())}{more}"]
        for part in parts.values():
            made = {getattr(row, part) for row in rows}
            names = dict.fromkeys(getattr(cell, part) for cell in table.cells())
            left = ", ".join(str(name) for name in names if name not in made)
            cells.append(left if rows else "all")
        lines.append(f"| {table.name} | {' | '.join(cells)} |")
    return lines


def spread(rows: Sequence[CellRow], name: str) -> str:
    """Mean and standard deviation of a number; diverged cells are counted."""
    values = [float(getattr(row, name)) for row in rows]
    sound = [value for value in values if math.isfinite(value)]
    if not sound:
        return "diverged"
    text = f"{statistics.fmean(sound):.3g}"
    if len(sound) > 1:
        text += f" ± {statistics.stdev(sound):.2g}"
    lost = len(values) - len(sound)
    return f"{text}, {lost} of {len(values)} diverged" if lost else text


def _about(table: TableConfig, rows: Sequence[CellRow]) -> list[str]:
    least, longest = table.seconds
    return [
        f"{len(rows)} of {len(table.cells())} cells. Each data set has {table.repetitions} trajectories of "
        f"each controller, {table.tested} of them tested, of {least:g} to {longest:g} s. Mean ± standard "
        "deviation over data sets and seeds, published numbers in brackets. MSE is summed over x, y, z, and "
        "divided by L."
    ]


def _digests(rows: Sequence[CellRow]) -> list[str]:
    heads = ["training [min]", "its digest", "test [min]", "its digest"]
    lines = ["## Data", "", *_head("robot, data set", heads)]
    for row in {(row.train, row.test): row for row in rows}.values():
        parts = [f"{row.learned / 60:.1f}", row.train[:12], f"{row.tested / 60:.1f}", row.test[:12]]
        lines.append(f"| {row.robot}, {row.dataset} | {' | '.join(parts)} |")
    return [*lines, "", "No trajectory is in both, by the digests of measurements and commands."]


def _errors(table: TableConfig) -> dict[str, Column]:
    def column(index: int, name: str) -> Column:
        def cell(own: Sequence[CellRow]) -> str:
            published = table.methods[own[0].method].published.get(own[0].robot)
            return spread(own, name) + (f" ({published[index]})" if published else "")

        return cell

    return {title: column(index, name) for index, (name, title) in enumerate(COLUMNS.items())}


def _means(name: str, factor: float = 1.0) -> Column:
    def cell(own: Sequence[CellRow]) -> str:
        sound = [factor * getattr(row, name) for row in own]
        sound = [value for value in sound if math.isfinite(value)]
        return f"{statistics.fmean(sound):.3g}" if sound else ""

    return cell


_COSTS: dict[str, Column] = {
    "cells": lambda own: str(len(own)),
    "data [min]": _means("learned", 1 / 60),
    "training [CPU min]": _means("fit_cpu", 1 / 60),
    "prediction [CPU s per s]": _means("rollout_cpu"),
}


def _lines(
    first: str, columns: Mapping[str, Column], rows: Sequence[CellRow], by: str = "method"
) -> list[str]:
    """Lines of Markdown: a row for each model, or for each value of another field."""
    lines = _head(first, list(columns))
    for own in _groups(rows, by):
        cells = (of(own) for of in columns.values())
        lines.append(f"| {getattr(own[0], by)} | {' | '.join(cells)} |")
    return lines


def _groups(rows: Sequence[CellRow], by: str) -> list[list[CellRow]]:
    """Rows with the same value of a field, in the order of the first of each."""
    groups: dict[str, list[CellRow]] = {}
    for row in rows:
        groups.setdefault(getattr(row, by), []).append(row)
    return list(groups.values())


def _head(first: str, heads: Sequence[str]) -> list[str]:
    return [f"| {first} | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
