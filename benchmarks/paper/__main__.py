"""Compare models on trajectories, as a table: trained, tested, resumed, on Ray, in MLflow and as a page.

    python pipelines/paper_table.py sim2sim                     fits three hours of two cores
    python pipelines/paper_table.py sim2sim --size paper        the size of the publication
    python pipelines/paper_table.py sim2sim --only 'prism3.*.tdpe' --only .arx
    python pipelines/paper_table.py loop seed=1                 the controller in the loop; a seed at a time

The definitions are in pipelines/tables/. Cells that are in the folder are kept; `table.csv` and `table.md`
in it have all of them, and so has MLflow.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

from benchmarks.paper.definition import SIZES, read_table, table_names
from benchmarks.paper.loop import LOOP, make_loop
from benchmarks.paper.table import Rows, Table, publisher
from flywheel.errors import ConfigError, FlywheelError
from flywheel.runtime.pool.interrupts import Interrupted, StopRequest
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.pool.pool import Patience, WorkerPool
from flywheel.runtime.pool.progress import console_progress
from flywheel.runtime.pool.ray_backend import Cluster, RayBackend
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.tracker import Status, Tracker, TrackingConfig

LONGEST = 3600.0  # without a sign of progress, a cell is begun again [s]


def make(table: Table, address: str | None, uri: str) -> Path:
    """Make the missing cells on Ray, and publish them; returns the page.

    Args:
      table: whose folder no other process is making.
      address: of an existing Ray cluster.
      uri: of MLflow; "" for a database in the folder.

    Raises:
      FlywheelError: see `Table.make`.
    """
    tracking = TrackingConfig(uri=uri)
    board = Board(table.folder, tracking, table.config.name)
    tracker: Tracker[Rows] = Tracker(publisher(board, table.config))
    status: Status = "FAILED"
    try:
        with Cluster(address, len(os.sched_getaffinity(0))) as ray, StopRequest() as stop:
            groups = [replace(table.workers, count=ray.cpus)]
            ray.check_fits(groups)
            pool = WorkerPool(RayBackend(), groups, ray.cpus, Patience(stall=LONGEST), stop)
            try:
                table.make(pool, console_progress(), tracker.show)
            finally:
                pool.close()
        status = "FINISHED"
    except Interrupted:
        status = "KILLED"
        raise
    finally:
        tracker.end(status)
        if not tracker.close(tracking.close_seconds):
            print(f"Not everything has reached MLflow: {tracker.problem or 'no time was left'}.")
    return table.folder / "table.md"


def main() -> None:
    """See the top."""
    parser = argparse.ArgumentParser(
        prog="python pipelines/paper_table.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("table", help=f"{', '.join(table_names())}, {LOOP}, or a YAML file")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="settings to change")
    parser.add_argument("--size", choices=SIZES, default="", help="in the place of the usual one")
    told = "part of the names ROBOT.DATASET.METHOD.sSEED, with * for anything; repeatable"
    parser.add_argument("--only", action="append", default=[], metavar="PART", help=told)
    parser.add_argument("--folder", type=Path, help="of the results; runs/tables/TABLE by default")
    parser.add_argument("--address", help="of an existing Ray cluster")
    parser.add_argument("--tracking-uri", default="", help="of an MLflow server")
    given = parser.parse_intermixed_args()
    try:
        print(_made(given))
    except Interrupted:
        parser.exit(130, "Stopped; the same command continues.\n")
    except FlywheelError as error:
        parser.error(str(error))


def _made(given: argparse.Namespace) -> Path:
    uri = given.tracking_uri
    if given.table != LOOP:
        config = read_table(given.table, given.size, given.overrides)
        table = Table(config, _folder(given, config.name), given.only)
        with hold(table.folder / "table.lock", f"The table in {table.folder}"):
            return make(table, given.address, uri)
    if given.only:
        raise ConfigError("--only chooses cells of a table; the loop is one run for each seed.")
    told = [*given.overrides, *([f"tracking.uri={uri}"] if uri else [])]
    return make_loop(given.size, told, _folder(given, LOOP), given.address, console_progress())


def _folder(given: argparse.Namespace, name: str) -> Path:
    named = f"{name}-{given.size}" if given.size else name
    return given.folder or Path("runs") / "tables" / named


if __name__ == "__main__":
    main()
