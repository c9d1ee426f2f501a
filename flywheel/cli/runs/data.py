"""`flywheel data`: stored episodes, and their verification."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from flywheel.cli.app import App
from flywheel.cli.console import console, table
from flywheel.cli.exits import FAILED
from flywheel.cli.options import RunArgument

if TYPE_CHECKING:
    from flywheel.data import Snapshot, TrajectoryStore
    from flywheel.runtime.run.inventory import Fault

app = App(no_args_is_help=True, help="List and check the episodes of a run.")


@app.command()
def verify(run: RunArgument, *, snapshot: str = "") -> None:
    """Read every byte again and compare; lists altered, missing and foreign files.

    A run's folder is checked with its results, models, configuration and robot; a store with its
    whole content. Faults are printed with their remedies, and the exit code is 1.

    [bold]Example[/bold]

    flywheel data verify runs/prism3

    Args:
      snapshot: Only this one; everything by default.
    """
    from flywheel.runtime.run.folder import RunFolder
    from flywheel.runtime.run.inventory import Inventory

    folder, store = RunFolder(run), _store_to_verify(run)
    chosen = store.snapshot(snapshot) if snapshot else None
    look = Inventory(folder, store) if folder.there and chosen is None else None
    faults = look.faults() if look else _in_store(store, chosen)
    out = console()
    for name in look.strangers() if look else ():
        out.say(f"note: {name} is not the run's.")
    for fault in faults:
        out.say(f"{fault.kind} {fault}", style="red")
    if faults:
        many = "1 fault" if len(faults) == 1 else f"{len(faults)} faults"
        out.say(f"{many}; the rest is as it was committed.")
        out.say(f"{_idle(faults)} {look.remedy(faults) if look else ''}".strip())
        raise typer.Exit(FAILED)
    count = len(chosen.episodes) if chosen else len(store.committed())
    what = f"{count} episodes of {snapshot}" if chosen else f"{count} segments"
    if look:
        what += " and all files of the run"
    out.say(f"All {what} are as they were committed.", style="green")


@app.command()
def show(run: RunArgument, *, snapshot: str = "") -> None:
    """Show the snapshots of a run, or the episodes of one.

    [bold]Example[/bold]

    flywheel data show runs/prism3 --snapshot i0001-mppi

    Args:
      snapshot: Show the episodes of this one; the snapshots by default.
    """
    store = open_store(run)
    if snapshot:
        _show_episodes(store.snapshot(snapshot))
    else:
        _show_snapshots(run, store)


@app.command()
def rewind(run: RunArgument, iteration: int) -> None:
    """Set aside a run's work from an iteration on, so that --resume repeats it.

    Nothing is deleted: results and models go to RUN/aside, episodes to the store's quarantine.

    [bold]Example[/bold]

    flywheel data rewind runs/prism3 1

    Args:
      iteration: The first iteration to repeat.
    """
    from flywheel.runtime.run import rewinding
    from flywheel.runtime.run.folder import RunFolder

    moved = rewinding.rewind(RunFolder(run.absolute()), open_store(run), iteration)
    out = console()
    for name in moved:
        out.say(f"set aside: {name}")
    out.say(
        f"{len(moved)} set aside, in {run / 'aside'} and the store's quarantine/. `flywheel run "
        f"CONFIG --folder {run} --resume` continues from iteration {iteration}."
    )


def _show_episodes(chosen: Snapshot) -> None:
    out = console()
    out.say(f"{chosen.name}: digest {chosen.digest}, parent {chosen.parent or 'none'}")
    out.print(
        table(
            f"Episodes of {chosen.name}",
            ["episode", "split", "controller", "data set", "duration [s]", "reached"],
            [
                (e.id, e.split, e.controller, e.dataset, e.seconds, _reached(e.success))
                for e in chosen.episodes
            ],
        )
    )


def _show_snapshots(run: Path, store: TrajectoryStore) -> None:
    """Print a row per snapshot; exit with 1 if one is damaged."""
    from flywheel.errors import DataError

    sealed, damaged = {}, []
    for name in store.snapshots():
        try:
            sealed[name] = store.snapshot(name)
        except DataError as error:
            damaged.append(str(error))
    names = {one.digest: name for name, one in sealed.items()}
    rows = []
    for name, one in sealed.items():
        splits = Counter(e.split for e in one.episodes)
        counts = [splits[split] for split in ("train", "validation", "test")]
        rows.append((name, one.digest[:12], names.get(one.parent), len(one.episodes), *counts))
    columns = ["snapshot", "digest", "parent", "#episodes", "#train", "#validation", "#test"]
    out = console()
    out.print(table(f"Snapshots of {run}", columns, rows))
    out.say(f"{len(store.committed())} segments are committed.")
    for words in damaged:
        out.say(words, style="red")
    if damaged:
        raise typer.Exit(FAILED)


def _reached(success: bool | None) -> str | None:
    return None if success is None else ("yes" if success else "no")


def _in_store(store: TrajectoryStore, chosen: Snapshot | None) -> list[Fault]:
    """Faults in a store without a run."""
    from flywheel.runtime.run.inventory import Fault

    found = [(each, str(each).removeprefix(f"{each.segment}: ")) for each in store.verify(chosen)]
    return [Fault(each.kind, each.segment, words, idle=True) for each, words in found]


def _idle(faults: list[Fault]) -> str:
    if not any(fault.idle for fault in faults):
        return ""
    return (
        "Nothing that a run does next rests on what is foreign, or in no snapshot: move it away, or leave "
        "a segment to --resume, which sets it aside and records it again."
    )


def open_store(run: Path) -> TrajectoryStore:
    """The store of a run's folder, or one at the path itself.

    Raises:
      DataError: there is neither.
    """
    from flywheel.data import TrajectoryStore
    from flywheel.errors import DataError
    from flywheel.runtime.run.folder import RunFolder

    folder = RunFolder(run)
    if folder.there:
        return TrajectoryStore(folder.store_url(folder.config()))
    names = {path.name for path in run.iterdir()} if run.is_dir() else {""}
    if names and not names & {"segments", "snapshots", "store.json"}:
        raise DataError(f"There is no run and no store at {run}.")
    return TrajectoryStore(str(run))


def _store_to_verify(run: Path) -> TrajectoryStore:
    """The store of a run whose configuration may be damaged, too."""
    from flywheel.data import TrajectoryStore
    from flywheel.errors import FlywheelError
    from flywheel.runtime.run.folder import RunFolder

    try:
        return open_store(run)
    except FlywheelError:
        if not RunFolder(run).there:
            raise
        return TrajectoryStore(str(run / "store"))
