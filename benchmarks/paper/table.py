"""The results of a table in a folder: what is missing is made by a pool of workers."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.paper.datasets import DataSets
from benchmarks.paper.definition import NETWORK, Cell, TableConfig
from benchmarks.paper.rows import NUMBERS, CellRow, page
from benchmarks.paper.worker import TableWorker, settings_digest
from benchmarks.rows import read_rows, write_rows
from flywheel.errors import ConfigError
from flywheel.files import read_json
from flywheel.outputs import check_folder, write_output
from flywheel.registry import nearest
from flywheel.runtime.pool.jobs import Group, Job
from flywheel.runtime.pool.pool import WorkerPool
from flywheel.runtime.pool.progress import Progress, Quiet
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.tracker import Status
from flywheel.validation import differences, lines

TRAINING = 5.0  # expected work of a cell with a training, beside one without
WORKERS = "table"
Rows = Sequence[CellRow]


class Table:
    """The results of a table.

    Args:
      config: the definition.
      folder: with one file per cell, the trajectories, and the weights.
      parts: of the names of the cells that are asked for; all without any.

    Raises:
      ConfigError: a part is of no cell, or a result in the folder is damaged, or of another definition.
    """

    def __init__(self, config: TableConfig, folder: Path, parts: Sequence[str] = ()) -> None:
        self.config, self.folder, self.cells = config, folder.absolute(), config.cells(parts)
        for part in parts:
            if not config.cells([part]):
                name = config.cells()[0].name
                known = {word for cell in config.cells() for word in cell.name.split(".")}
                raise ConfigError(
                    f"No cell of the table {config.name} has {part} in its name; one is {name}."
                    f"{nearest(part.strip('.*').rpartition('.')[2], sorted(known))}"
                )
        check_folder(self.folder, "folder of the table", ConfigError)
        for row in self.rows():
            cell = _cell(row)
            if row.settings != settings_digest(config, cell):
                raise ConfigError(
                    f"{folder} has a result of {cell.name} with other settings. Give another folder."
                )

    @property
    def workers(self) -> Group:
        """The workers of this table, one of them."""
        return Group(WORKERS, TableWorker, (self.config, self.folder))

    def rows(self) -> list[CellRow]:
        """The results so far, of all cells of the definition.

        Raises:
          ConfigError: one is damaged.
        """
        files = {self._file(cell): cell for cell in self.config.cells()}
        return [_read(file, cell) for file, cell in files.items() if file.exists()]

    def make(
        self,
        pool: WorkerPool,
        progress: Progress = Quiet(),
        show: Callable[[Rows], None] = lambda rows: None,
    ) -> None:
        """Make the missing trajectories and cells; what is done survives an interruption.

        Args:
          pool: with the workers of this table.
          progress: display for people.
          show: receives all results after each cell.

        Raises:
          ConfigError: the folder has trajectories of another definition.
          RunError, DataError, Interrupted: see `WorkerPool.run`.
        """
        for robot in {cell.robot for cell in self.cells}:
            self._check_trajectories(robot)

        def keep(job: Job, row: CellRow) -> None:
            write_rows(self._file(job.arguments[0]), [row])
            self.write()
            show(self.rows())

        if missing := [cell for cell in self.cells if not self._file(cell).exists()]:
            for title, jobs in self._trajectories(missing).items():
                pool.run(jobs, progress=progress, title=title)
            pool.run([self._job(cell) for cell in missing], keep, progress, "cells")
        self.write()
        show(self.rows())

    def write(self) -> None:
        """Write the results as CSV and as a page."""
        rows = self.rows()
        write_rows(self.folder / "table.csv", rows)
        text = "\n".join(page(self.config, rows)) + "\n"
        write_output(self.folder / "table.md", text)

    def _check_trajectories(self, robot: str) -> None:
        """Reject trajectories of other settings; those of the run are in each trajectory."""
        path = self.folder / robot / "trajectories.json"
        now = json.loads(json.dumps(self.config.trajectories(robot)))
        if path.exists():
            before = read_json(path, "settings of the trajectories", ConfigError)
            if changed := list(differences(before, now)):
                raise ConfigError(
                    f"{path.parent} has trajectories of other settings:\n{lines(changed)}\nGive another "
                    "folder."
                )
        write_output(path, json.dumps(now, indent=1) + "\n")

    def _file(self, cell: Cell) -> Path:
        return self.folder / "cells" / f"{cell.name}.csv"

    def _job(self, cell: Cell) -> Job:
        trains = self.config.methods[cell.method].model == NETWORK
        return Job(cell.name, WORKERS, "measure", (cell,), TRAINING if trains else 1.0)

    def _trajectories(self, cells: Sequence[Cell]) -> dict[str, list[Job]]:
        """Jobs for the trajectories of cells; later ones need the earlier ones."""
        found: dict[str, list[Job]] = {"trajectories": [], "simulations": []}
        for robot in dict.fromkeys(cell.robot for cell in cells):
            data, names = DataSets(self.config, robot, self.folder), self.config.datasets(robot)
            used = {names.index(cell.dataset) for cell in cells if cell.robot == robot}
            found["trajectories"] += [
                Job(f"{robot}.{plan.id}", WORKERS, "record", (robot, plan), plan.seconds)
                for plan in data.plans
                if plan.dataset in used
            ]
            found["simulations"] += [
                Job(f"{robot}.{index}.{plan.id}", WORKERS, "simulate", (robot, plan, index))
                for plan, index in data.simulations
            ]
        return {title: jobs for title, jobs in found.items() if jobs}


def _cell(row: CellRow) -> Cell:
    return Cell(row.robot, row.dataset, row.method, row.seed)


def _read(file: Path, cell: Cell) -> CellRow:
    """The result of a cell.

    Raises:
      ConfigError: the file is damaged, or of another cell.
    """
    with suppress(KeyError, TypeError, ValueError, csv.Error):
        rows = read_rows(CellRow, file)
        if [_cell(row) for row in rows] == [cell] and file.read_bytes().endswith(b"\n"):
            return rows[0]
    raise ConfigError(
        f"{file} is damaged, or not the result of {cell.name}. Without it the cell is made anew."
    )


def publisher(board: Board, config: TableConfig) -> Callable[[Rows, Status], None]:
    """Publication at MLflow: a run for the table, and one inside it for each cell."""
    sent: set[str] = set()

    def publish(rows: Rows, status: Status) -> None:
        whole = board.run(f"table-{config.name}", config.name, {"flywheel.kind": "table"})
        for row in rows:
            cell = _cell(row)
            if cell.name in sent:
                continue
            tags = {"flywheel.kind": "cell"} | ({"problem": row.problem} if row.problem else {})
            run = board.run(f"table-{config.name}/{cell.name}", cell.name, tags, whole)
            words: dict[str, Any] = {**vars(cell), "train": row.train, "test": row.test}
            board.describe(run, {name: str(value) for name, value in words.items()})
            board.log(run, [(0, {name: getattr(row, name) for name in NUMBERS})])
            board.status(run, "FINISHED")
            sent.add(cell.name)
        board.log(whole, [(len(rows), {"cells": float(len(rows))})])
        if status != "RUNNING":
            for name in ("table.csv", "table.md"):
                board.artifact(whole, name)
        board.status(whole, status)

    return publish
