"""Reading a log: from files to episodes, with every doubt as an error or a line of the report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flywheel import __version__
from flywheel.data.recordings.accounts import check_accounts, moved_on_hold
from flywheel.data.recordings.cables import check_channels, check_frame
from flywheel.data.recordings.clock import stretches, usual_period, without_duplicates
from flywheel.data.recordings.evidence import Evidence
from flywheel.data.recordings.formats import TABLE, format_of
from flywheel.data.recordings.formats.table import has_decimal_commas
from flywheel.data.recordings.geometry import (
    check_commands,
    check_robot,
    check_units,
    check_up,
    check_winches,
    floating,
)
from flywheel.data.recordings.grid import check_steps, most_rows, on_grid
from flywheel.data.recordings.joining.alignment import Aligned
from flywheel.data.recordings.joining.assembly import Assembled, assemble
from flywheel.data.recordings.joining.clocks import Follow
from flywheel.data.recordings.locked import with_locked
from flywheel.data.recordings.mapping import RecordingMap, read_map
from flywheel.data.recordings.naming import named
from flywheel.data.recordings.noise import noisy_commands
from flywheel.data.recordings.repair.markers import judged, track
from flywheel.data.recordings.repair.repeats import mask_repeats
from flywheel.data.recordings.report import Finding, ImportReport, listed
from flywheel.data.recordings.sources import FileEntry
from flywheel.data.recordings.tables.columns import Log, control_names, matched, pick
from flywheel.data.recordings.tables.table import Told, open_table
from flywheel.data.recordings.tables.values import check_commanded, mask_impossible
from flywheel.data.splits import assign_split
from flywheel.errors import ConfigError, DataError
from flywheel.files import opened
from flywheel.options import ImportOptions
from flywheel.outputs import printable
from flywheel.quantities import CONTROL_STEP
from flywheel.records import (
    RECORDING,
    Episode,
    Floats,
    MeasuredChannel,
    Provenance,
    Split,
    Trajectory,
)
from flywheel.robots import Robot

BEGIN = 1 << 16  # bytes of a log that tell how its numbers are written
MAPS = (".yaml", ".yml")
SHARES: dict[Split, float] = {"train": 0.6, "validation": 0.2, "test": 0.2}
DIGITS = 16  # characters of the content's digest, in names
LEAST_KEPT = 0.1  # share of the measured points; where more are wrong, the others cannot be trusted
LEAST_SEEN = 0.02  # share of all points and times; cameras of 10 Hz in a log of 100 Hz give 10 %


@dataclass(frozen=True)
class Imported:
    """A log as episodes.

    Attributes:
      episodes: one for each part without a gap, all in one split.
      report: findings.
      name: of their segment.
      split_given: True if the user chose the split; else the hash of the content did.
      compared: cables by which clocks of files were found (`align: auto`).
    """

    episodes: tuple[Episode, ...]
    report: ImportReport
    name: str
    split_given: bool
    compared: tuple[Aligned, ...] = ()


def read_recording(
    path: str | Path,
    robot: Robot,
    options: ImportOptions = ImportOptions(),
    *,
    how: RecordingMap | None = None,
    told: Told | None = None,
    follow: Follow | None = None,
) -> Imported:
    """Read a log of a robot.

    Row t contains the measurements at its time and the commands until the next row's.

    Args:
      path: of the log, or of a map (YAML) that names its files.
      robot: of the log.
      options: split and control step.
      how: mapping of its columns; by default the YAML of the same name next to it, if there is one. Its files
        are relative to the log's folder.
      told: called during reading, with the bytes so far and those of the file.
      follow: how cables follow their winches, which makes `align: auto` exact: `cables_by_winches` of
        `flywheel.dynamics.plant`.

    Raises:
      DataError: the log cannot be used; the message says where and why.
      ConfigError: the YAML next to it is wrong.
    """
    dt, split = options.dt, options.split
    CONTROL_STEP.check(dt, "A control step, dt,", DataError)
    path = Path(path)
    how = beside(path) if how is None else how
    read = _read(path, robot, how, dt, told, follow)
    digest, log, findings = read.digest, read.log, list(read.findings)
    slow, compared = read.period, read.compared
    del read  # its log is as large as the next one
    rows = len(log.time)
    try:
        log, period, found = _checked(log, robot, dt, how)
        findings += found
        tracks, found = _trajectories(log, robot, period, dt, how.jitter)
        findings += found
        seen = _seen(tracks, max(period, slow), dt)
    except DataError as error:
        raise DataError(f"{printable(path.name)}: {error}") from None
    name = f"{RECORDING}-{_slug(path.name)}-{digest[:DIGITS]}"
    chosen = assign_split(digest, SHARES) if split == "auto" else split
    episodes = _episodes(name, tracks, robot, how, chosen)
    report = ImportReport(
        file=printable(path.name),
        digest=digest,
        rows=rows,
        seconds=float(log.time[-1] - log.time[0]),
        period=period,
        dt=dt,
        episodes=tuple(episode.id for episode in episodes),
        steps=tuple(track.steps for track in tracks),
        seen=seen,
        findings=tuple(findings),
    )
    return Imported(episodes, report, name, split != "auto", compared)


def beside(path: Path) -> RecordingMap:
    """The map in the YAML of the same name next to a log; the default one without it.

    A log that is YAML itself is a map that names the files.

    Raises:
      ConfigError: it is wrong.
    """
    if path.suffix in MAPS and format_of(path) is TABLE:  # refuses what runs code
        try:
            how = read_map(path)
        except ConfigError as error:
            raise ConfigError(
                f"{error}\nA file that ends in {path.suffix} is taken for a map that names the files of a "
                "recording. If it is a log, rename it to .csv; messages printed as text are not read: export "
                "them as CSV, or keep the bag."
            ) from None
        if not how.files:
            raise ConfigError(f"{path} is a map, and no log: it must name the logs under files.")
        return how
    found = [p for p in (path.parent / f"{path.stem}{end}" for end in MAPS) if p.is_file()]
    return read_map(found[0]) if found else RecordingMap()


def _read(
    path: Path,
    robot: Robot,
    how: RecordingMap,
    dt: float,
    told: Told | None,
    follow: Follow | None,
) -> Assembled:
    """The log's raw values."""
    plain = not how.assembles and not path.is_dir() and format_of(path) is TABLE
    if plain and not _has_decimal_commas(path):
        with open_table(path, told) as sheet:
            if sum(map(bool, sheet.header)) > 1:
                columns = matched(sheet, robot, how)
                table = sheet.read(list(columns.theirs.values()), most_rows(robot))
                log, findings = pick(table, columns, robot, how)
                return Assembled(table.digest, log, 0.0, tuple(findings))
        # Its columns are separated by blanks, or titles are above them.
    entries = how.files or (FileEntry(path=path.name),)
    try:
        return assemble(path.parent, entries, robot, how, dt, follow)
    except DataError as error:
        if len(entries) == 1 and str(error).startswith(printable(path.name)):
            raise
        raise DataError(f"{printable(path.name)}: {error}") from None


def _has_decimal_commas(path: Path) -> bool:
    with opened(path, "recording", DataError, None) as file:
        return has_decimal_commas(file.read(BEGIN))


def _episodes(
    name: str, tracks: Sequence[Trajectory], robot: Robot, how: RecordingMap, split: Split
) -> tuple[Episode, ...]:
    origin = Provenance(
        robot=robot.digest,
        source=RECORDING,
        dataset=RECORDING,
        controller="recorded",
        code=__version__,
        conditions=how.conditions,
    )
    ids = [name] if len(tracks) == 1 else [f"{name}-p{i:02d}" for i in range(len(tracks))]
    return tuple(Episode(i, track, origin, split) for i, track in zip(ids, tracks, strict=True))


def _checked(
    log: Log, robot: Robot, dt: float, how: RecordingMap
) -> tuple[Log, float, list[Finding]]:
    """The log with doubtful samples masked, and its usual period [s]."""
    check_commanded(log, robot)
    findings = mask_impossible(log, robot)
    log, found = without_duplicates(log)
    findings += found
    if len(log.time) < 2:
        raise DataError("all rows have one time; a recording needs at least 2.")
    period = usual_period(log, dt)
    findings += mask_repeats(log, robot)
    check_units(log.points, robot, how.axes)
    check_commands(log, robot)
    findings += noisy_commands(log, robot)
    check_winches(log, robot)
    tracked = track(log.points, log.time, robot)
    tracked = named(tracked, Evidence.of(log, tracked.points, robot), robot)
    log, found = with_locked(log, tracked.points, robot, how)
    findings += found
    check_robot(tracked.ordered, robot)
    check_up(tracked.ordered, robot)
    findings += floating(tracked.ordered, robot)
    evidence = Evidence.of(log, tracked.points, robot)
    findings += check_frame(evidence)
    held = {f"ctrl.{name}" for name, channel in how.commands.items() if channel.hold}
    accounts = check_accounts(log, tracked.points, robot, evidence)
    findings += [finding for finding in accounts if finding.subject not in held]
    still = [i for i, name in enumerate(control_names(robot)) if name in held]
    findings += moved_on_hold(evidence, still)
    points, found = judged(tracked, robot, log.time, "swaps" in how.repair)
    _check_kept(log.points, points, findings + found)
    controls = np.clip(log.controls, robot.control_low, robot.control_high)  # rounding only
    findings += check_channels(log, points, robot)
    noisy = {name: channel.noise for name, channel in how.winches.items() if channel.noise}
    channels = log.channels + tuple(
        MeasuredChannel("winch", winch.name, log.winch[:, i], noisy[winch.name])
        for i, winch in enumerate(robot.winches)
        if winch.name in noisy
    )
    kept = replace(log, controls=controls, points=points, channels=channels)
    return kept, period, findings + found


def _check_kept(before: Floats, after: Floats, findings: list[Finding]) -> None:
    """Raises DataError if hardly any of the measured points (N, P, 3) is left."""
    measured, kept = (np.count_nonzero(np.isfinite(points[..., 0])) for points in (before, after))
    if measured == 0:
        raise DataError("no marker was ever measured: all its cells are empty, or no position.")
    if kept < LEAST_KEPT * measured:
        masked = [f for f in findings if f.action == "masked" and f.subject]
        masked.sort(key=lambda finding: -finding.count)
        reasons = listed([f"{f.subject} {f.kind} ({f.count} times)" for f in masked], 4)
        raise DataError(
            f"only {kept} of {measured} measured points can be used, at least {LEAST_KEPT:.0%} are needed. "
            f"Found: {reasons}. Is it this robot, in these units and axes?"
        )


def _trajectories(
    log: Log, robot: Robot, period: float, dt: float, jitter: float
) -> tuple[list[Trajectory], list[Finding]]:
    """The sufficiently long parts of a log, on a regular grid."""
    parts, findings = stretches(log, period)
    check_steps(parts, robot, dt)
    tracks, short = [], []
    for part in parts:
        if len(part.time) < 2 or part.time[-1] - part.time[0] < dt - period / 2:
            short.append((float(part.time[0]), float(part.time[-1])))
            continue
        made, found = on_grid(part, period, dt, jitter)
        tracks.append(made)
        findings += found
    if short:
        words = "parts between gaps that are shorter than a control step"
        findings.append(
            Finding("gap", "left out", "", len(short), tuple(short[:20]), len(short[20:]), words)
        )
    if not tracks:
        raise DataError(f"no part without a gap is as long as a control step of {dt:g} s.")
    return tracks, findings


def _seen(tracks: list[Trajectory], period: float, dt: float) -> float:
    """Fraction of present samples, at the log's own rate or the grid's.

    Raises:
      DataError: it is almost zero.
    """
    valid: NDArray[np.bool_] = np.concatenate([t.observations.valid for t in tracks])
    seen = float(min(1.0, valid.mean() * max(1.0, period / dt)))
    if seen < LEAST_SEEN:
        raise DataError(
            f"only {seen:.2%} of the points' samples are present; at least {LEAST_SEEN:.0%} are "
            "needed."
        )
    return seen


def _slug(file: str) -> str:
    """A file's name reduced to the characters of a segment's name."""
    return re.sub(r"[^a-z0-9]+", "-", Path(file).stem.lower()).strip("-")[:40] or "log"
