"""`flywheel recordings export`: write episodes as CSV, MCAP or a LeRobot data set."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import console
from flywheel.cli.recordings.opening import StoreArgument, robot_of

if TYPE_CHECKING:
    from flywheel.data import TrajectoryStore


def export(
    store: StoreArgument,
    episode: Annotated[str, "EPISODE"],
    output: Annotated[Path, "OUT"],
    *,
    robot: str | None = None,
) -> None:
    """Write an episode, recorded or simulated, as CSV or MCAP, or several as a LeRobot data set.

    [bold]Examples[/bold]

    flywheel recordings export runs/prism3 i0001-mppi-collect-0000 episode.csv

    flywheel recordings export runs/prism3 'i0001-*' prism3-lerobot

    Args:
      episode: Its name, or a pattern: 'i0001-*'.
      output: New .csv or .mcap; a name without an ending is a LeRobot data set.
      robot: Your .xml, or a shipped robot's name; by default the run's.
    """
    from flywheel.cli.runs.data import open_store
    from flywheel.data.recordings import write_recording
    from flywheel.data.recordings.exports import write_lerobot, write_mcap
    from flywheel.data.recordings.report import listed
    from flywheel.errors import DataError

    writers = {".csv": write_recording, ".mcap": write_mcap}
    if output.suffix not in ("", *writers):
        raise DataError(
            f"The ending of {output} must be {' or '.join(writers)}, or none for a LeRobot data set; got "
            f"{output.suffix!r}."
        )
    owner, opened = robot_of(store, robot), open_store(store)
    names = _matching(opened, episode)
    if output.suffix:
        if len(names) > 1:
            raise DataError(
                f"{output} takes one episode; {episode!r} is {listed(names, 4)}. A LeRobot data set, without "
                "an ending, takes several."
            )
        write = writers[output.suffix]
        found = opened.read(names[0])
        left = write(found, output, owner)
        steps = found.trajectory.steps
        words = f"{steps + 1} rows, {steps * found.trajectory.dt:g} s."
    else:
        frames, left = write_lerobot(map(opened.read, names), output, owner)
        words = f"{len(names)} episodes, {frames} frames."
    out = console()
    out.say(f"{output}: {words}")
    if left:
        out.say(f"A log cannot contain: {', '.join(left)}; {output} does not have it.")


def _matching(store: TrajectoryStore, pattern: str) -> list[str]:
    """Names of the episodes that match a pattern, those of one split together.

    Raises:
      DataError: none does.
    """
    from flywheel.errors import DataError
    from flywheel.registry import nearest

    every = [one for segment in store.committed() for one in store.episodes(segment)]
    found = [one for one in every if fnmatchcase(one.id, pattern)]
    if not found:
        hint = nearest(pattern, [one.id for one in every])
        raise DataError(f"No episode in {store.url} is named {pattern!r}.{hint}")
    return [one.id for one in sorted(found, key=lambda one: (one.split, one.id))]
