"""Logs given to a command, read for it alone: nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flywheel.cli.console import Out
from flywheel.data.recordings import read_recording
from flywheel.dynamics.plant import cables_by_winches
from flywheel.errors import DataError
from flywheel.options import ImportOptions
from flywheel.outputs import printable
from flywheel.records import Trajectory
from flywheel.robots import Robot


@dataclass(frozen=True)
class Log:
    """One recording: a log, or a part of one with gaps.

    Attributes:
      name: for people.
      trajectory: on the control steps of the model.
    """

    name: str
    trajectory: Trajectory


def read_tracks(paths: Sequence[Path], robot: Robot, dt: float, out: Out) -> list[Trajectory]:
    """The trajectories of logs, see `read_logs`."""
    return [log.trajectory for log in read_logs(paths, robot, dt, out)]


def read_logs(paths: Sequence[Path], robot: Robot, dt: float, out: Out) -> list[Log]:
    """Read logs, and print the findings in each; raises as `read_groups`."""
    (found,) = read_groups([paths], robot, dt, out)
    return found


def read_groups(
    groups: Sequence[Sequence[Path]], robot: Robot, dt: float, out: Out
) -> list[list[Log]]:
    """Read groups of logs, such as those to explain and those held out.

    Raises:
      DataError: a log cannot be used, or is given twice: it would count double, or be its own test.
    """
    given: dict[str, Path] = {}

    def read(path: Path) -> list[Log]:
        imported = read_recording(path, robot, ImportOptions(dt=dt), follow=cables_by_winches)
        if other := given.get(imported.report.digest):
            raise DataError(f"{other} and {path} are the same log; give it once.")
        given[imported.report.digest] = path
        for f in imported.report.findings:
            done = f"{f.count} {f.action} at {f.when or 'all times'} s. " if f.count else ""
            out.say(f"{imported.report.file}: {f.kind} {f.subject}: {done}{f.words}")
        stem, several = printable(path.stem), len(imported.episodes) > 1
        return [
            Log(f"{stem} ({number})" if several else stem, episode.trajectory)
            for number, episode in enumerate(imported.episodes)
        ]

    return [[log for path in paths for log in read(path)] for paths in groups]
