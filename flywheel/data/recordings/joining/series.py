"""One log out of series with their own times.

The rows are those of the file with the points, because nothing is measured between two samples. Between
the rows of a slow tracker there is one for each control step. Commands hold, and are averaged over each
row, so that a winch moves as far; winch positions of another file are interpolated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.clock import GAP
from flywheel.data.recordings.grid import held, most_rows, phase
from flywheel.data.recordings.joining.lookup import Source
from flywheel.data.recordings.report import Finding, counted, listed
from flywheel.data.recordings.tables.columns import Log, finite
from flywheel.errors import DataError
from flywheel.records import ChannelKind, Floats, MeasuredChannel
from flywheel.robots import Robot

EPOCH = 1e6  # [s]: later times are dates, and are told from the beginning


@dataclass(frozen=True)
class Clock:
    """Times of the first file's clock at another file's: offset + pace * time [s]."""

    offset: float
    pace: float

    def of(self, time: Floats) -> Floats:
        """(N,) times [s]."""
        return time if (self.offset, self.pace) == (0.0, 1.0) else self.offset + self.pace * time


@dataclass(frozen=True)
class Series:
    """Numbers at their own times.

    Attributes:
      time: (N,) increasing, by the first file's clock [s].
      values: (N,) or (N, 3) [m or m/s].
      source: they are from.
      held: only changes were written.
    """

    time: Floats
    values: Floats
    source: Source
    held: bool = False


def one_log(
    points: Sequence[Series | None],
    commands: Sequence[Series | float],
    winches: Sequence[Series | None],
    robot: Robot,
    dt: float,
    cables: Mapping[tuple[ChannelKind, str], tuple[Series, float | None]] = {},
) -> tuple[Log, float, list[Finding]]:
    """The rows of the log, the usual time between those with points, and findings."""
    seen = [each for each in points if each is not None]
    sources = [id(each.source) for each in seen]
    base = max(seen, key=lambda each: sources.count(id(each.source)))
    if len(base.time) < 2:
        raise DataError(
            f"{base.source.name} has {len(base.time)} rows; a recording needs at least 2."
        )
    period = float(np.median(np.diff(base.time)))
    apart = any(isinstance(each, Series) and each.source is not base.source for each in commands)
    time, lines, places = (
        _rows(base, period, dt, robot) if apart else (base.time, base.source.rows, None)
    )
    known = _known(time, commands, dt)
    left = len(time) - int(known.sum())
    if known.sum() < 2:
        raise DataError(_no_overlap(base, commands))
    findings = _findings(time, known, left, period, dt, apart, base)
    own = np.arange(len(base.time)) if places is None else places
    values = np.full((len(time), len(points), 3), np.nan)
    for i, each in enumerate(points):
        if each is not None:
            values[own, i] = (
                each.values if each.source is base.source else _nearest(each, base.time, dt)
            )
    controls = np.empty((len(time), len(commands)))
    for i, told in enumerate(commands):
        controls[:, i] = _told(told, time)
    winch = np.full((len(time), len(winches)), np.nan)
    for i, each in enumerate(winches):
        if each is not None:
            winch[:, i] = _at(each, time, base, own)
    channels = tuple(
        MeasuredChannel(*key, finite(_sampled(each, time, base, own, dt)), noise)
        for key, (each, noise) in cables.items()
    )
    if time[0] > EPOCH:
        time = time - time[known][0]
    log = Log(time, controls, values, winch, np.asarray(lines, np.int64), channels)
    return log[known], period, findings


def _rows(
    base: Series, period: float, dt: float, robot: Robot
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Times of rows with points and of steps without, their lines, and the places of those with points."""
    span = base.time[-1] - base.time[0]
    if span < 0 or not np.isfinite(span) or span / dt > most_rows(robot):
        raise DataError(
            f"{base.source.name} takes {span:.6g} s, too many control steps of {dt:g} s: is the unit of its "
            "times right?"
        )
    steps = phase(base.time, min(period, dt), dt) + dt * np.arange(np.floor(span / dt) + 1)
    after = np.searchsorted(base.time, steps).clip(1, len(base.time) - 1)
    near = np.minimum(np.abs(steps - base.time[after - 1]), np.abs(base.time[after] - steps))
    more = steps[near > 0.5 * max(dt, min(period, 1.25 * dt)) * (1 + 1e-6)]
    time = np.concatenate([base.time, more])
    lines = np.concatenate([base.source.rows, np.zeros(len(more), np.int64)])
    order = np.argsort(time, kind="stable")
    places = np.empty(len(time), np.int64)
    places[order] = np.arange(len(time))
    return time[order], lines[order], places[: len(base.time)]


def _known(time: Floats, commands: Sequence[Series | float], dt: float) -> NDArray[np.bool_]:
    """(N,) bool: True for times at which all commands are known."""
    known = np.ones(len(time), bool)
    for each in commands:
        if isinstance(each, Series):
            known &= time >= each.time[0] - 1e-9
            if not each.held:
                usual = max(float(np.median(np.diff(each.time))), 1e-9)
                after = np.searchsorted(each.time, time + 1e-9, side="right")
                since = time - each.time[np.maximum(after - 1, 0)]
                until = (
                    np.append(each.time, each.time[-1] + usual)[after]
                    - each.time[np.maximum(after - 1, 0)]
                )
                gap = until > GAP * max(usual, dt)
                last = after == len(each.time)
                known &= ~((gap | last) & (since > usual * (1 + 1e-6)))
    return known


def _told(each: Series | float, time: Floats) -> Floats:
    """(N,) commands of a winch, each as the mean until the next row."""
    if not isinstance(each, Series):
        return np.full(len(time), each)
    if len(time) == len(each.time) and np.array_equal(time, each.time):
        return each.values
    end = max(time[-1], each.time[-1]) + 1.0
    edges = np.append(time, time[-1] + 1e-6)
    distinct = np.append(np.diff(edges) > 0, True)
    means = held(np.append(each.time, end), np.append(each.values, 0.0)[:, None], edges[distinct])[
        :, 0
    ]
    from_here = np.cumsum(distinct) - distinct  # of two rows at one time both have what follows
    return means[np.minimum(from_here[:-1], len(means) - 1)]


def _nearest(each: Series, time: Floats, dt: float) -> Floats:
    """(N, ...) the samples within half a control step of some times; NaN elsewhere."""
    after = np.searchsorted(each.time, time).clip(1, len(each.time) - 1)
    nearest = np.where(time - each.time[after - 1] < each.time[after] - time, after - 1, after)
    values = each.values[nearest].copy()
    values[np.abs(each.time[nearest] - time) > dt / 2] = np.nan
    return values


def _sampled(each: Series, time: Floats, base: Series, own: NDArray[np.int64], dt: float) -> Floats:
    """(N,) values at some times: as written, or the nearest of another file."""
    if each.source is not base.source:
        return _nearest(each, time, dt)
    found = np.full(len(time), np.nan)
    found[own] = each.values
    return found


def _at(each: Series, time: Floats, base: Series, own: NDArray[np.int64]) -> Floats:
    """(N,) positions of a winch at some times: as written, or between two samples of another file."""
    if each.source is base.source:
        return _sampled(each, time, base, own, 0.0)
    found = np.full(len(time), np.nan)
    known = np.isfinite(each.values)
    if known.sum() < 2:
        return found
    when, values = each.time[known], each.values[known]
    after = np.searchsorted(when, time).clip(1, len(when) - 1)
    near = when[after] - when[after - 1] <= GAP * np.median(np.diff(when))
    inside = (time >= when[0]) & (time <= when[-1]) & near
    found[inside] = np.interp(time[inside], when, values)
    return found


def _no_overlap(base: Series, commands: Sequence[Series | float]) -> str:
    spans = [each for each in commands if isinstance(each, Series)]
    others = listed(
        list(
            dict.fromkeys(
                f"{s.source.name} from {s.time[0]:.6g} to {s.time[-1]:.6g} s" for s in spans
            )
        ),
        4,
    )
    return (
        f"points and commands are not of the same time: {base.source.name} from {base.time[0]:.6g} to "
        f"{base.time[-1]:.6g} s, {others}. Do the files have different clocks? Give align: auto, or offset, "
        "under files."
    )


def _findings(
    time: Floats,
    known: NDArray[np.bool_],
    left: int,
    period: float,
    dt: float,
    apart: bool,
    base: Series,
) -> list[Finding]:
    findings = []
    if left:
        words = "the commands there are unknown"
        findings.append(Finding.over("gap", "left out", "", ~known, time, words))
    if apart and period > 1.25 * dt:
        words = (
            f"points every {period:.4g} s on steps of {dt:g} s: those between are missing; "
            f"{counted(len(base.time), 'row')}"
        )
        findings.append(Finding("rate", "resampled", "", len(base.time), words=words))
    return findings
