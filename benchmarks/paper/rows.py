"""Numbers of a table's cells: one row each, and their page."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmarks.paper.definition import TableConfig

COLUMNS = {  # field -> title; the first four are those that publications have
    "full_mse": "whole: MSE/L [%]",
    "full_rot": "whole: turn [deg]",
    "short_mse": "short: MSE/L [%]",
    "short_rot": "short: turn [deg]",
}
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
    lines = _head("model", list(COLUMNS.values()))
    for method, own in _by_method(rows).items():
        published = table.methods[method].published.get(own[0].robot)
        there = [f" ({text})" for text in published] if published else [""] * len(COLUMNS)
        cells = [spread(own, name) + text for name, text in zip(COLUMNS, there, strict=True)]
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return lines


def units_table(rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: the position errors in other units in use."""
    units: dict[str, Callable[[CellRow, str], float]] = {
        "RMSE/L [%]": lambda row, part: float(getattr(row, f"{part}_rmse")),
        "MSE/L, mean over xyz [%]": lambda row, part: float(getattr(row, f"{part}_mse")) / 3,
        "MSE [m^2]": lambda row, part: float(getattr(row, f"{part}_mse")) / 100 * row.length,
    }
    parts = {"whole": "full", "short": "short"}
    lines = _head("model", [f"{part}: {unit}" for part in parts for unit in units])
    for method, own in _by_method(rows).items():
        values = [
            [of(row, part) for row in own] for part in parts.values() for of in units.values()
        ]
        lines.append(f"| {method} | {' | '.join(_mean(each) for each in values)} |")
    return lines


def costs_table(rows: Sequence[CellRow]) -> list[str]:
    """Lines of Markdown: the data, and the processor's time for training and predictions."""
    heads = ["cells", "data [min]", "training [CPU min]", "prediction [CPU s per s]"]
    lines = _head("model", heads)
    for method, own in _by_method(rows).items():
        cells = [
            str(len(own)),
            _mean([row.learned / 60 for row in own]),
            _mean([row.fit_cpu / 60 for row in own]),
            _mean([row.rollout_cpu for row in own]),
        ]
        lines.append(f"| {method} | {' | '.join(cells)} |")
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


def _by_method(rows: Sequence[CellRow]) -> dict[str, list[CellRow]]:
    return {
        method: [row for row in rows if row.method == method]
        for method in dict.fromkeys(row.method for row in rows)
    }


def _head(first: str, heads: Sequence[str]) -> list[str]:
    return [f"| {first} | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]


def _mean(values: Sequence[float]) -> str:
    sound = [value for value in values if math.isfinite(value)]
    return f"{statistics.fmean(sound):.3g}" if sound else ""
