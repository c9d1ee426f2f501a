"""Resample a log from its own times to the regular control steps of an episode.

Nothing is interpolated, because there is no measurement between two noisy ones. A sample counts for
the nearest grid time, within `jitter`; grid times without one have NaN, for example in a 50 Hz log
on a 100 Hz grid. Commands hold until the next row; a step with several rows has their mean over
time, which moves a winch equally far.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.report import Finding
from flywheel.data.recordings.tables.columns import Log
from flywheel.errors import DataError
from flywheel.records import Floats, Observation, Trajectory
from flywheel.robots import Robot

CLOSE = 0.1  # relative: the log's rate is the grid's
PHASE_ROWS = 100  # first rows whose stamps decide where the grid begins
MOST_NUMBERS = 27_000_000  # numbers in one log's episodes: storing them takes 1 GB of memory
LEAST_ON_GRID = 0.75  # share of the possible samples; by chance it is 2 jitter


def on_grid(log: Log, period: float, dt: float, jitter: float) -> tuple[Trajectory, list[Finding]]:
    """A stretch of a log without gaps, on control steps of dt [s].

    Args:
      log: at least two rows.
      period: usual time between two rows [s].
      dt: control step [s].
      jitter: largest distance of a stamp from the grid, as a fraction of dt.

    Raises:
      DataError: most samples fall between the grid's times.
    """
    time = log.time - phase(log.time, period, dt)
    nearest = np.rint(time / dt).astype(np.int64)
    off = np.abs(time - nearest * dt)
    fits = off <= jitter * dt + 1e-9
    steps = int(nearest[-1]) if fits[-1] else int(time[-1] / dt)
    chosen = _closest(nearest, off, fits, steps)
    _check_regular(log, chosen, period, dt, jitter)
    there = chosen >= 0
    points, winch = _taken(log.points, chosen), _taken(log.winch, chosen)
    begins = np.where(fits, nearest * dt, time)  # of each command
    edges = dt * np.arange(steps + 1)
    edges[0] = max(edges[0], begins[0])
    controls = held(begins, log.controls, edges)
    used = np.zeros(len(time), bool)
    used[chosen[there]] = True
    findings = _findings(log, used, fits, off, period, dt)
    channels = tuple(replace(c, values=_taken(c.values, chosen)) for c in log.channels)
    return Trajectory(Observation(points, winch), controls, dt, channels=channels), findings


def most_rows(robot: Robot) -> int:
    """Largest number of rows or control steps of a robot processed at once."""
    return MOST_NUMBERS // (3 * len(robot.points) + 2 * len(robot.winches))


def check_steps(parts: Sequence[Log], robot: Robot, dt: float) -> None:
    """Raise DataError if the parts of a log have too many control steps of dt [s]."""
    seconds, most = sum(float(part.time[-1] - part.time[0]) for part in parts), most_rows(robot)
    if seconds / dt > most:
        raise DataError(
            f"{seconds:.6g} s are {seconds / dt:,.0f} control steps of {dt:g} s; for this robot, "
            f"at most {most:,} are accepted from one log. Give a longer step (--dt), or cut the "
            "log into several."
        )


def phase(time: Floats, period: float, dt: float) -> float:
    """Time at which the grid begins: the median offset of the first rows' stamps."""
    multiple = max(1.0, np.rint(period / dt)) / max(1.0, np.rint(dt / period))
    if abs(period / (multiple * dt) - 1) < CLOSE:
        period = multiple * dt  # the usual time between jittering stamps is not exact
    since = time[:PHASE_ROWS] - time[0]
    return float(time[0] + np.median(since - period * np.rint(since / period)))


def _closest(
    nearest: NDArray[np.int64], off: Floats, fits: NDArray[np.bool_], steps: int
) -> NDArray[np.int64]:
    """(steps + 1,) index of the row for each grid time, -1 without one."""
    chosen = np.full(steps + 1, -1, np.int64)
    usable = fits & (nearest >= 0)
    rows = np.flatnonzero(usable)
    # Far ones first, so that the nearest of several overwrites the others.
    rows = rows[np.argsort(-off[rows], kind="stable")]
    chosen[nearest[rows]] = rows
    return chosen


def _taken(values: Floats, chosen: NDArray[np.int64]) -> Floats:
    """(steps + 1, ...) rows of the values (N, ...), NaN if none was chosen."""
    found = values.take(np.maximum(chosen, 0), axis=0)
    found[chosen < 0] = np.nan
    return found


def held(begins: Floats, controls: Floats, edges: Floats) -> Floats:
    """(steps, W) commands that hold from row to row, as means over the steps between edges (steps + 1,) [s].

    Args:
      begins: (N,) time from which each row's commands hold [s].
      controls: (N, W) commands; the last row's act on nothing.
      edges: increasing times [s].
    """
    tiny = 1e-6 * np.diff(edges)  # edges and rows of the same time differ by rounding
    first = np.searchsorted(begins, edges[:-1] + tiny, side="right") - 1
    last = np.searchsorted(begins, edges[1:] - tiny, side="right") - 1
    first = np.maximum(first, 0)
    single = controls[first]
    if np.array_equal(first, last):
        return single
    known = controls[:-1]
    until = np.concatenate(
        [np.zeros((1, known.shape[1])), np.cumsum(known * np.diff(begins)[:, None], axis=0)]
    )
    sums = np.empty((len(edges), known.shape[1]))
    for column in range(known.shape[1]):
        sums[:, column] = np.interp(edges, begins, until[:, column])
    mean = np.diff(sums, axis=0) / np.diff(edges)[:, None]
    return np.where((first == last)[:, None], single, mean)


def _check_regular(
    log: Log, chosen: NDArray[np.int64], period: float, dt: float, jitter: float
) -> None:
    got = int((chosen >= 0).sum())
    hoped = min(len(chosen), len(log.time))
    if len(chosen) < 2 or got < LEAST_ON_GRID * hoped:
        between = np.diff(log.time)
        spread = np.percentile(between, [5, 95])
        exact = between[np.abs(between - period) < CLOSE * period].mean()  # stamps are rounded
        raise DataError(
            f"irregular time stamps: only {got} of {hoped} samples lie within {jitter:g} of a step of "
            f"the grid of {dt:g} s. Rows are {spread[0]:.4g} to {spread[1]:.4g} s apart (5 to 95 %), "
            f"usually {period:.4g} s. Give a step that fits (--dt {exact:.9g}), or a larger "
            "jitter in the map (below 0.5)."
        )


def _findings(
    log: Log,
    used: NDArray[np.bool_],
    fits: NDArray[np.bool_],
    off: Floats,
    period: float,
    dt: float,
) -> list[Finding]:
    findings = []
    fast = period < 0.8 * dt  # rows between the steps are nothing special then
    if (~fits).any() and not fast:
        words = f"further from the grid of {dt:g} s than the map's jitter; up to {off.max():.2g} s"
        findings.append(Finding.over("irregular stamp", "masked", "", ~fits, log.time, words))
    uneven = fits & (off > 0.01 * dt)
    if uneven.any():
        words = f"assigned to the nearest step; at most {off[fits].max():.2g} s away"
        findings.append(Finding.over("irregular stamp", "resampled", "", uneven, log.time, words))
    if period > 1.25 * dt:
        words = (
            f"a log of {1 / period:.4g} Hz on steps of {dt:g} s: commands are held, the points between "
            "are missing"
        )
        findings.append(Finding("rate", "resampled", "", int(used.sum()), words=words))
    elif fast:
        words = (
            f"a log of {1 / period:.4g} Hz on steps of {dt:g} s: the nearest sample of each step is "
            "taken, commands are averaged over it"
        )
        findings.append(Finding("rate", "left out", "", int((~used).sum()), words=words))
    return findings
