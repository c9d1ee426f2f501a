"""Reading a log: CSV to episodes, with every doubt either an error or a line of the report."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flywheel import __version__
from flywheel.data.recordings.clock import stretches, usual_period, without_duplicates
from flywheel.data.recordings.columns import Log, pick, without_infinities
from flywheel.data.recordings.geometry import (
    check_commands,
    check_robot,
    check_units,
    check_up,
    check_winches,
    floating,
)
from flywheel.data.recordings.grid import on_grid
from flywheel.data.recordings.mapping import RecordingMap, read_map
from flywheel.data.recordings.markers import judged, track
from flywheel.data.recordings.report import Finding, ImportReport
from flywheel.data.recordings.table import Table, read_table
from flywheel.data.splits import assign_split
from flywheel.errors import DataError
from flywheel.records import Episode, Floats, Provenance, Split, Trajectory
from flywheel.robots import Robot

DATASET = "recording"  # the data set in the network's one-hot
SHARES: dict[Split, float] = {"train": 0.6, "validation": 0.2, "test": 0.2}
DIGITS = 16  # of the content's digest, in names


@dataclass(frozen=True)
class Imported:
    """A log as episodes.

    Attributes:
      episodes: one for each stretch without a gap, all in one split.
      report: what was done to it.
      name: of the segment that they become.
      split_given: somebody chose the split; else the hash of the content did.
    """

    episodes: tuple[Episode, ...]
    report: ImportReport
    name: str
    split_given: bool


def read_recording(
    path: str | Path,
    robot: Robot,
    *,
    how: RecordingMap | None = None,
    dt: float = 0.01,
    split: Split | None = None,
) -> Imported:
    """Read a log of a robot.

    Row t holds what was measured at its time and the commands that act until the next row's.

    Args:
      path: of the CSV.
      robot: that it is about.
      how: what its columns are; by default the YAML of the same name beside it, if there is one.
      dt: control step of the episodes [s].
      split: of the episodes; by default by the hash of the content.

    Raises:
      DataError: the log cannot be used as it is; the message says where and why.
      ConfigError: the YAML beside it is wrong.
    """
    if not dt > 0:
        raise DataError(f"dt must be positive seconds, got {dt!r}.")
    path = Path(path)
    how = beside(path) if how is None else how
    table = read_table(path)
    log, findings = pick(table, robot, how)
    try:
        return _imported(table, log, findings, robot, how, dt, split)
    except DataError as error:
        raise DataError(f"{path.name}: {error}") from None


def beside(path: Path) -> RecordingMap:
    """The map in the YAML of the same name beside a log; the default one without it.

    Raises:
      ConfigError: it is wrong.
    """
    found = [p for p in (path.with_suffix(".yaml"), path.with_suffix(".yml")) if p.exists()]
    return read_map(found[0]) if found else RecordingMap()


def _imported(
    table: Table,
    log: Log,
    findings: list[Finding],
    robot: Robot,
    how: RecordingMap,
    dt: float,
    split: Split | None,
) -> Imported:
    log, period, found = _checked(log, robot, repair="swaps" in how.repair)
    findings = findings + found
    tracks, found = _trajectories(log, period, dt, how.jitter)
    findings += found
    name = f"{DATASET}-{_slug(table.file)}-{table.digest[:DIGITS]}"
    chosen = split or assign_split(table.digest, SHARES)
    origin = Provenance(
        robot=robot.digest,
        source="recording",
        dataset=DATASET,
        controller="recorded",
        code=__version__,
        conditions=how.conditions,
    )
    ids = [name] if len(tracks) == 1 else [f"{name}-p{i:02d}" for i in range(len(tracks))]
    episodes = [Episode(i, t, origin, chosen) for i, t in zip(ids, tracks, strict=True)]
    report = ImportReport(
        file=table.file,
        digest=table.digest,
        rows=len(table.values),
        seconds=float(log.time[-1] - log.time[0]),
        period=period,
        dt=dt,
        episodes=tuple(ids),
        steps=tuple(t.steps for t in tracks),
        seen=_seen(tracks, period, dt),
        findings=tuple(findings),
    )
    return Imported(tuple(episodes), report, name, split is not None)


def _checked(log: Log, robot: Robot, repair: bool) -> tuple[Log, float, list[Finding]]:
    """The log with doubtful samples masked, and its usual period [s]."""
    log, findings = without_infinities(log, robot)
    log, found = without_duplicates(log)
    findings += found
    if len(log.time) < 2:
        raise DataError("all rows have one time; a recording needs at least 2.")
    period = usual_period(log)
    check_units(log.points, robot)
    check_commands(log, robot)
    check_winches(log, robot)
    tracked = track(log.points, log.time, robot)
    check_robot(tracked.ordered, robot)
    check_up(tracked.ordered, robot)
    findings += floating(tracked.ordered, robot)
    points, found = judged(tracked, robot, log.time, repair)
    if not np.isfinite(points).any():
        raise DataError("no marker was ever measured in a way that can be used.")
    controls = np.clip(log.controls, robot.control_low, robot.control_high)  # rounding only
    return Log(log.time, controls, points, log.winch, log.lines), period, findings + found


def _trajectories(
    log: Log, period: float, dt: float, jitter: float
) -> tuple[list[Trajectory], list[Finding]]:
    """The stretches of a log that are long enough, on a regular grid."""
    parts, findings = stretches(log, period)
    tracks, short = [], []
    for part in parts:
        if len(part.time) < 2 or part.time[-1] - part.time[0] < dt - period / 2:
            short.append((float(part.time[0]), float(part.time[-1])))
            continue
        made, found = on_grid(part, period, dt, jitter)
        tracks.append(made)
        findings += found
    if short:
        words = "stretches between gaps that are shorter than a control step"
        findings.append(
            Finding("gap", "left out", "", len(short), tuple(short[:20]), len(short[20:]), words)
        )
    if not tracks:
        raise DataError(f"no stretch without a gap is as long as a control step of {dt:g} s.")
    return tracks, findings


def _seen(tracks: list[Trajectory], period: float, dt: float) -> float:
    """Share of the samples, at the log's own rate or the grid's, that are there."""
    valid: Floats = np.concatenate([t.observations.valid for t in tracks])
    return float(min(1.0, valid.mean() * max(1.0, period / dt)))


def _slug(file: str) -> str:
    """What a segment's name may hold of a file's."""
    return re.sub(r"[^a-z0-9]+", "-", Path(file).stem.lower()).strip("-")[:40] or "log"
