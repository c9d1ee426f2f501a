"""`flywheel data`: what is stored, and whether it is still right."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import typer

from flywheel.data import TrajectoryStore
from flywheel.errors import DataError
from flywheel.runtime.config import load_config
from flywheel.runtime.run_folder import RunFolder
from pipelines.exits import FAILED
from pipelines.show import console, table


def verify_store(run: Path, snapshot: str) -> None:
    """Print what is damaged; exit with 1 if anything is."""
    store = open_store(run)
    chosen = store.snapshot(snapshot) if snapshot else None
    damages = store.verify(chosen)
    out = console()
    for damage in damages:
        out.print(f"[red]damaged[/red] {damage}", soft_wrap=True, highlight=False)
    if damages:
        out.print(f"{len(damages)} damaged; the rest is as it was committed.", highlight=False)
        raise typer.Exit(FAILED)
    count = len(chosen.episodes) if chosen else len(store.committed())
    what = f"{count} episodes of {snapshot}" if chosen else f"{count} segments"
    out.print(f"[green]All {what} are as they were committed.[/green]", highlight=False)


def show_store(run: Path, snapshot: str) -> None:
    """Print the snapshots, or the episodes of one."""
    store = open_store(run)
    out = console()
    if snapshot:
        chosen = store.snapshot(snapshot)
        out.print(f"{chosen.name}: digest {chosen.digest}, parent {chosen.parent or 'none'}")
        out.print(
            table(
                f"Episodes of {snapshot}",
                ["episode", "split", "controller", "data set", "duration [s]", "reached"],
                [
                    (e.id, e.split, e.controller, e.dataset, e.seconds, _reached(e.success))
                    for e in chosen.episodes
                ],
            )
        )
        return
    sealed = {name: store.snapshot(name) for name in store.snapshots()}
    names = {one.digest: name for name, one in sealed.items()}
    rows = []
    for name, one in sealed.items():
        splits = Counter(e.split for e in one.episodes)
        counts = [splits[split] for split in ("train", "validation", "test")]
        rows.append((name, one.digest[:12], names.get(one.parent), len(one.episodes), *counts))
    columns = ["snapshot", "digest", "parent", "#episodes", "#train", "#validation", "#test"]
    out.print(table(f"Snapshots of {run}", columns, rows))
    out.print(f"{len(store.committed())} segments are committed.", highlight=False)


def _reached(success: bool | None) -> str | None:
    return None if success is None else ("yes" if success else "no")


def open_store(run: Path) -> TrajectoryStore:
    """The store of a run's folder, or one that lies at the path itself.

    Raises:
      DataError: there is neither.
    """
    folder = RunFolder(run)
    if folder.config_file.exists():
        return TrajectoryStore(folder.store_url(load_config(folder.config_file)))
    if not run.is_dir():
        raise DataError(f"There is no run and no store at {run}.")
    return TrajectoryStore(str(run))
