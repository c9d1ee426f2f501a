"""Logs given to a command, read for it alone: nothing is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flywheel.cli.console import Out
from flywheel.data.recordings import read_recording
from flywheel.dynamics.plant import cables_by_winches
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
    """Read logs, and print the findings in each.

    Raises:
      DataError: a log cannot be used.
    """
    recordings = []
    for path in paths:
        imported = read_recording(path, robot, dt=dt, follow=cables_by_winches)
        for f in imported.report.findings:
            done = f"{f.count} {f.action} at {f.when or 'all times'} s. " if f.count else ""
            out.say(f"{imported.report.file}: {f.kind} {f.subject}: {done}{f.words}")
        stem = printable(path.stem)
        several = len(imported.episodes) > 1
        for number, episode in enumerate(imported.episodes):
            name = f"{stem} ({number})" if several else stem
            recordings.append(Log(name, episode.trajectory))
    return recordings
