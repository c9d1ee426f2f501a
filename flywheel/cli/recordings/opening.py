"""A store of episodes, its robot, and how a run learns from its recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out
from flywheel.outputs import check_folder

if TYPE_CHECKING:
    from flywheel.data import TrajectoryStore
    from flywheel.robots import Robot

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
StoreArgument = Annotated[
    Path, typer.Argument(metavar="RUN_OR_STORE", help="A run's folder, or a folder of episodes.")
]


def robot_of(place: Path, name: str | None) -> Robot:
    """The given robot, else that of the run."""
    from flywheel.errors import DataError
    from flywheel.robots import load_robot

    if name is not None:
        return load_robot(name)
    if not _is_run(place):
        raise DataError(
            f"{place} is not a run's folder: give the robot of the episodes with --robot."
        )
    from flywheel.runtime.run.folder import RunFolder

    folder = RunFolder(place)
    return folder.robot(folder.config())


def store_at(place: Path) -> TrajectoryStore:
    """The store of a run, or the one at a path; a new one if there is nothing."""
    from flywheel.data import TrajectoryStore

    check_folder(place, "store")
    if _is_run(place):
        from flywheel.cli.runs.data import open_store

        return open_store(place)
    return TrajectoryStore(str(place))


def _is_run(place: Path) -> bool:
    """True for a run's folder, without importing its classes, which takes seconds."""
    return (place / "config.yaml").exists()


def show_setting(out: Out, segments: Sequence[str]) -> None:
    """The setting that makes a run learn from segments."""
    listed = ",".join(segments)
    out.say(f"A run on this store learns from them with 'collect.recordings=[{listed}]'")
