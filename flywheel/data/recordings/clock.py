"""Time stamps: invalid ones, distances between rows, and gaps of the log."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.report import Finding, counted
from flywheel.data.recordings.sources import TIMES
from flywheel.data.recordings.tables.columns import Log
from flywheel.errors import DataError

# Rows are usually this far apart, or else the time is in another unit:
SLOWEST = 0.5  # at most [s],
SLOWEST_STEPS = 2.5  # or, if that is more, so many control steps: half their rate may be meant,
FASTEST = 1e-6  # and at least [s]
LOST_ROWS = 1.5  # periods without a row: one is missing
GAP = 2.5  # periods without a row: nobody knows what was commanded
MOST_GAPS = 1000  # an episode begins after each: a log of more is no longer one


def without_duplicates(log: Log) -> tuple[Log, list[Finding]]:
    """The log with each time once and forward, from time 0 on.

    Raises:
      DataError: time runs backward, or two different rows have one time.
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
    rows = np.flatnonzero(again)
    if len(rows) == 0:
        return log, []
    other = rows[~_alike(log, rows - 1, rows)]
    if len(other):
        raise DataError(
            f"line {log.lines[other[0]]}: the time {log.time[other[0]]:.6g} s is in two different "
            f"rows, {counted(len(rows), 'duplicated stamp')} in all. Is the clock too coarse, or "
            "in whole seconds?"
        )
    words = "rows that repeat the previous one"
    found = Finding.over("duplicate stamp", "left out", "", again, log.time, words)
    return log[~again], [found]


def _alike(log: Log, some: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(rows,) bool: True for rows equal to others, except for their times and lines."""
    same = np.ones(len(some), bool)
    for values in (log.controls, log.points, log.winch, *(c.values for c in log.channels)):
        a, b = values[some], values[others]
        equal = (a == b) | (np.isnan(a) & np.isnan(b))
        same &= equal.all(axis=tuple(range(1, equal.ndim)))
    return same


def usual_period(log: Log, dt: float) -> float:
    """The usual time between two rows [s].

    Args:
      log: at least two rows.
      dt: desired control step [s].

    Raises:
      DataError: rows are so far apart, or so close, that the time must be in another unit.
    """
    period = float(np.median(np.diff(log.time)))
    most = max(SLOWEST, SLOWEST_STEPS * dt)
    if period > most:
        unit = min(("ms", "us", "ns"), key=lambda each: abs(np.log(period * TIMES[each] / dt)))
        raise DataError(
            f"rows are {period:g} s apart, at most {most:g} s are expected for steps of {dt:g} s. If the "
            f"time is in {unit}, write units: {{time: {unit}}} in the map; if it is right, give a longer "
            "step (--dt)."
        )
    if period < FASTEST:
        raise DataError(
            f"rows are {period:g} s apart, at least {FASTEST:g} s are expected. Is units.time in the map "
            "that of the log?"
        )
    return period


def stretches(log: Log, period: float) -> tuple[list[Log], list[Finding]]:
    """The log cut where it has a gap.

    A single missing row is bridged: its command is assumed to be the previous one, its measurements
    are missing. Over a longer gap the commands are unknown, so a new episode begins after it.

    Raises:
      DataError: it has too many gaps.
    """
    steps = np.diff(log.time)
    lost = (steps > LOST_ROWS * period) & (steps <= GAP * period)
    gaps = np.flatnonzero(steps > GAP * period)
    findings = []
    if lost.any():
        where = np.append(lost, False)
        words = "single rows are missing: the previous command is held, the points are masked"
        findings.append(Finding.over("gap", "masked", "", where, log.time, words))
    if len(gaps) > MOST_GAPS:
        raise DataError(
            f"{len(gaps):,} gaps: so often, nothing was written for more than {GAP:g} times the usual "
            f"{period:.4g} s between two rows; at most {MOST_GAPS:,} are possible. Does the log miss rows?"
        )
    if len(gaps):
        spans = tuple((float(log.time[g]), float(log.time[g + 1])) for g in gaps)
        missing = round(float((steps[gaps] / period - 1).sum()))
        words = "the commands there are unknown: an episode ends, another begins"
        findings.append(Finding("gap", "split", "", missing, spans[:20], len(spans[20:]), words))
    borders = [0, *(gaps + 1), len(log.time)]
    parts = [log[a:b] for a, b in pairwise(borders)]
    return parts, findings
