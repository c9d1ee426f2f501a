"""Time stamps: which cannot be, how far apart the rows are, and where the log has gaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from flywheel.data.recordings.columns import Log
from flywheel.data.recordings.report import Finding, counted
from flywheel.errors import DataError
from flywheel.records import Floats

SLOWEST = 0.5  # no row for longer than this on average: the time is in another unit [s]
LOST_ROWS = 1.5  # periods without a row: one is missing
GAP = 2.5  # periods without a row: nobody knows what was commanded


def without_duplicates(log: Log) -> tuple[Log, list[Finding]]:
    """The log with each time once and forward, from time 0 on.

    Raises:
      DataError: time runs backward, or two rows of one time say different things.
    """
    steps = np.diff(log.time)
    backward = np.flatnonzero(steps < 0)
    if len(backward):
        row = backward[0] + 1
        raise DataError(
            f"line {log.lines[row]}: time runs backward, from {log.time[row - 1]:.6g} to "
            f"{log.time[row]:.6g} s, {counted(len(backward), 'time')} in all. Are these several "
            "recordings in one file? Give each a file of its own."
        )
    again = np.concatenate([[False], steps == 0])
    for row in np.flatnonzero(again).tolist():
        before, now = _contents(log, row - 1), _contents(log, row)
        if not np.array_equal(before, now, equal_nan=True):
            raise DataError(
                f"line {log.lines[row]}: the time {log.time[row]:.6g} s stands in two rows that say "
                f"different things; {counted(int(again.sum()), 'duplicated stamp')} in all. Is the clock too "
                "coarse, or in whole seconds?"
            )
    if not again.any():
        return log, []
    words = "rows that repeat the one before them"
    found = Finding.over("duplicate stamp", "left out", "", again, log.time, words)
    return log[~again], [found]


def _contents(log: Log, row: int) -> Floats:
    return np.concatenate([log.controls[row], log.points[row].ravel(), log.winch[row]])


def usual_period(log: Log) -> float:
    """The usual time between two rows [s].

    Raises:
      DataError: rows are so far apart that the time must be in another unit.
    """
    period = float(np.median(np.diff(log.time)))
    if period > SLOWEST:
        raise DataError(
            f"rows are {period:g} s apart, at most {SLOWEST:g} s are expected. If the time is in "
            "milliseconds, write units: {time: ms} in the map."
        )
    return period


def stretches(log: Log, period: float) -> tuple[list[Log], list[Finding]]:
    """The log cut where it has a gap.

    A single row that is missing is bridged: its command is taken to be the one before, its
    measurements are missing. Over a longer gap nobody knows what was commanded, so that what comes
    after it is an episode of its own.
    """
    steps = np.diff(log.time)
    lost = (steps > LOST_ROWS * period) & (steps <= GAP * period)
    gaps = np.flatnonzero(steps > GAP * period)
    findings = []
    if lost.any():
        where = np.append(lost, False)
        words = "single rows are missing: the command before is held, the points are masked"
        findings.append(Finding.over("gap", "masked", "", where, log.time, words))
    if len(gaps):
        spans = tuple((float(log.time[g]), float(log.time[g + 1])) for g in gaps)
        missing = round(float((steps[gaps] / period - 1).sum()))
        words = "nobody knows what was commanded there: an episode ends, another begins"
        findings.append(Finding("gap", "split", "", missing, spans[:20], len(spans[20:]), words))
    borders = [0, *(gaps + 1), len(log.time)]
    parts = [log[a:b] for a, b in pairwise(borders)]
    return parts, findings
