"""`flywheel recordings show`: list the recordings in a store."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from flywheel.cli.console import console, table
from flywheel.cli.recordings.opening import AsJson, StoreArgument, show_setting

if TYPE_CHECKING:
    from flywheel.data import TrajectoryStore


def show(store: StoreArgument, *, as_json: AsJson = False) -> None:
    """Show the recordings in a store, and the setting that makes a run learn from them.

    [bold]Example[/bold]

    flywheel recordings show runs/prism3/store
    """
    from flywheel.cli.runs.data import open_store

    opened = open_store(store)
    rows = _stored_rows(opened)
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
    else:
        _show_stored(opened, rows)


def _stored_rows(store: TrajectoryStore) -> list[dict[str, Any]]:
    """The recordings of a store, as plain values."""
    from flywheel.data.recordings import stored_recordings

    rows: list[dict[str, Any]] = []
    for segment, summaries in stored_recordings(store).items():
        for summary, episode in zip(summaries, store.read_segment(segment), strict=True):
            about = {name: getattr(summary, name) for name in ("split", "seconds", "dt", "robot")}
            seen = float(episode.trajectory.observations.valid.mean())
            rows.append(
                {"episode": summary.id, "segment": segment, **about, "points_seen": seen}
                | {"conditions": episode.provenance.conditions}
            )
    return rows


def _show_stored(store: TrajectoryStore, rows: Sequence[dict[str, Any]]) -> None:
    out = console()
    if not rows:
        out.say(f"There is no recording in {store.url}.")
        return
    heads = (
        "episode",
        "split",
        "duration [s]",
        "dt [s]",
        "points there [%]",
        "robot",
        "conditions",
    )
    keys = ("episode", "split", "seconds", "dt", "points_seen", "robot", "conditions")
    short = ({"points_seen": 100 * r["points_seen"], "robot": r["robot"][:12]} for r in rows)
    cells = [[(row | less)[key] for key in keys] for row, less in zip(rows, short, strict=True)]
    out.print(table(f"Recordings in {store.url}", heads, cells))
    show_setting(out, list(dict.fromkeys(row["segment"] for row in rows)))
