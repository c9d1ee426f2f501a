"""The clock of one file by another's, from what both have seen.

The lengths of the cables between the points change as their winches make them. Where the changes of both
are most alike is the offset, to a step. Then offset and pace come from a robust fit: what a winch makes of
its cable is a constant and a share of its length between the points. A wrong gain of a winch, and cables
that were slack for a while, do no harm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.data.recordings.evidence import lengths_between
from flywheel.data.recordings.joining.series import Clock
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

STEP = 0.02  # [s] between the offsets that are tried first
SPAN = 20  # steps over which changes are compared
SHORTEST = 3.0  # least time that both must have seen [s]
MOST_SECONDS = 14_400.0  # that are compared
LONGEST = 120.0  # time from which the first offset is taken [s]: in more, another pace drifts away
LEAST_OVERLAP = 0.25  # share of the shorter one that both must have seen
ALIKE = 0.7  # least correlation of the changes
OTHER = 1.0  # [s] from which an offset is another one
CLEARLY = 0.7  # the best offset leaves at most this share of what another leaves
SMOOTH = 0.07  # [s] over which speeds are taken
ROUNDS = 40  # of a fit, at most
SETTLED = 1e-6  # change of the offset that ends a fit [s]
TUKEY = 4.0  # lengths off by more usual residuals do not count
MOST = 4000  # rows of a fit
INDEPENDENT = 0.1  # [s] after which residuals are taken for independent
SURE = 3.0  # standard deviations from which a pace is another than 1


@dataclass(frozen=True)
class Mover:
    """A cable by its winch: length (n,) but for a constant and a gain [m], at times (n,) by its clock [s]."""

    cable: int
    time: Floats
    made: Floats


@dataclass(frozen=True)
class Aligned:
    """A cable after the clocks of two files were aligned, to be looked at.

    Attributes:
      file: name of the winches' file.
      cable: name of it.
      clock: of that file.
      time, lengths: (N,) by the points' clock [s], and its length between them [m]; NaN where not seen.
      winch_time, made: (n,) by the points' clock [s], and its length by the winch [m].
    """

    file: str
    cable: str
    clock: Clock
    time: Floats
    lengths: Floats
    winch_time: Floats
    made: Floats


@dataclass(frozen=True)
class Witness:
    """A cable by its winch, and its length (m,) between the points [m]; NaN where these were not seen."""

    mover: Mover
    lengths: Floats


@dataclass(frozen=True)
class Alignment:
    """A clock, and how well it is known.

    Attributes:
      clock: times by the points' clock at those of the other.
      sd: standard deviation of the offset in the middle of the recording [s].
      residual: usual deviation between the cables by their winches and by the points [m].
      longer: (k,) how much longer each cable usually is by its winch than between the points [m].
    """

    clock: Clock
    sd: float
    residual: float
    longer: Floats


def align(time: Floats, points: Floats, movers: Sequence[Mover], robot: Robot) -> Alignment:
    """Offset and pace of the clock of winches, by points.

    Args:
      time: (N,) of the points [s].
      points: (N, P, 3) in the robot's frame [m]; NaN where not seen.
      movers: cables of winches.
      robot: of the recording, of free bodies.

    Raises:
      DataError: the cables do not change alike at any offset, or at several.
    """
    grid, witnesses = _witnesses(time, points, movers, robot)
    whole = witnesses[0].mover.time
    begin, end = _busiest(witnesses)
    clock = Clock(_first_offset(grid, witnesses, begin, end), 1.0)
    while True:
        found = _fitted(grid, witnesses, clock, begin, end)
        if begin <= whole[0] and end >= whole[-1]:
            return found
        clock, half = found.clock, (end - begin) / 2
        begin, end = begin - half, end + half


def _witnesses(
    time: Floats, points: Floats, movers: Sequence[Mover], robot: Robot
) -> tuple[Floats, list[Witness]]:
    """Times (m,) at which all points were seen [s], and the cables that move, with their lengths at them."""
    if not robot.free:
        raise DataError("align: auto needs a robot of free bodies: give offset.")
    seen = np.isfinite(points).all(axis=(1, 2))
    if not all(map(comparable, (time, time[seen], *(each.time for each in movers)))):
        raise DataError(
            f"align: auto needs {SHORTEST:g} to {MOST_SECONDS:g} s of winches, and as many in which all "
            "points are seen: give offset."
        )
    lengths = seen_lengths(points, robot)
    made = [Witness(each, lengths[:, each.cable]) for each in movers]
    if not any(np.ptp(each.made) for each in movers):
        raise DataError("align: auto needs a winch that moves: give offset.")
    return time, made


def comparable(time: Floats) -> bool:
    """True for times (N,) over which changes can be compared [s]."""
    return len(time) > SPAN and bool(SHORTEST <= time[-1] - time[0] <= MOST_SECONDS)


def seen_lengths(points: Floats, robot: Robot) -> Floats:
    """(N, C) lengths of the cables between points (N, P, 3) [m]; NaN in rows that lack a point."""
    seen = np.isfinite(points).all(axis=(1, 2))
    lengths = np.full((len(points), len(robot.cables)), np.nan)
    if seen.any():
        lengths[seen] = lengths_between(points[seen], robot)
    return lengths


def _busiest(witnesses: Sequence[Witness]) -> tuple[float, float]:
    """Begin and end of the time, at most `LONGEST`, in which the winches move most [s]."""
    time = witnesses[0].mover.time
    if time[-1] - time[0] <= LONGEST:
        return float(time[0]), float(time[-1])
    grid = np.arange(time[0], time[-1], STEP)
    moved = np.zeros(len(grid) - 1)
    for each in witnesses:
        at = np.interp(grid, each.mover.time, each.mover.made)
        moved += np.abs(np.diff(at)) / max(float(np.ptp(each.mover.made)), 1e-9)
    until = np.concatenate([[0.0], np.cumsum(moved)])
    size = round(LONGEST / STEP)
    first = int((until[size:] - until[:-size]).argmax())
    return float(grid[first]), float(grid[first]) + LONGEST


def _first_offset(grid: Floats, witnesses: Sequence[Witness], begin: float, end: float) -> float:
    """The offset at which the cables change most alike, by winches from begin to end [s].

    Raises:
      DataError: there is none, or not only one.
    """
    fits, offsets = likeness(grid, witnesses, begin, end)
    best = int(fits.argmax())
    if not fits[best] >= ALIKE:
        turned = (
            " Have the winches the other sign?" if fits[fits > -1].min(initial=0.0) < -ALIKE else ""
        )
        raise DataError(
            "align: auto found no offset at which the cables' lengths change as the winches do: their "
            f"correlation is {max(fits[best], 0.0):.2f} at most, {ALIKE:g} is needed.{turned} Give offset, "
            "if both files show one motion."
        )
    others = np.where(np.abs(offsets - offsets[best]) > OTHER, fits, 0.0)
    second = int(others.argmax())
    if 1 - fits[best] ** 2 > CLEARLY * (1 - max(others[second], 0.0) ** 2):
        raise DataError(
            f"align: auto cannot tell the offset {offsets[best]:.2f} s from {offsets[second]:.2f} s: the "
            "motion repeats. Give offset."
        )
    return float(offsets[best])


def likeness(
    grid: Floats, witnesses: Sequence[Witness], begin: float, end: float
) -> tuple[Floats, Floats]:
    """Correlations of changes at offsets by steps, and the offsets [s]; -1 with too little overlap."""
    # Start-up time: as in flywheel.smoothing.
    from scipy.signal import fftconvolve

    steps = np.arange(grid[0], grid[-1], STEP)
    moved = np.arange(begin, end, STEP)
    ones = np.ones(max(len(moved) - SPAN, 1))
    size = len(steps) - SPAN + len(ones) - 1
    products, positions, lengths, overlap = np.zeros((4, size))
    for each in witnesses:
        seen = np.isfinite(each.lengths)
        there = np.interp(steps, grid, seen.astype(float)) > 0.999
        there = there[SPAN:] & there[:-SPAN]
        y = np.interp(steps, grid[seen], each.lengths[seen])
        x = np.interp(moved, each.mover.time, each.mover.made)
        dy = np.where(there, y[SPAN:] - y[:-SPAN], 0.0)
        dx = (x[SPAN:] - x[:-SPAN])[::-1]
        dy, dx = dy / max(dy.std(), 1e-12), dx / max(dx.std(), 1e-12)
        products += fftconvolve(dy, dx)
        positions += fftconvolve(there.astype(float), dx**2)
        lengths += fftconvolve(dy**2, ones)
        overlap += fftconvolve(there.astype(float), ones) / len(witnesses)
    least = max(SHORTEST / STEP, LEAST_OVERLAP * min(len(ones), overlap.max()))
    both = np.sqrt(np.maximum(lengths * positions, 1e-12))
    fits = np.where(overlap >= least, products / both, -1.0)
    return fits, steps[0] - begin + STEP * (np.arange(size) - len(ones) + 1)


class _Rows:
    """Rows of a fit: a cable by its winch, at the times of the points by the present clock."""

    def __init__(self, grid: Floats, witness: Witness, middle: float) -> None:
        known = np.flatnonzero(np.isfinite(witness.lengths))
        known = known[np.linspace(0, len(known) - 1, min(MOST, len(known))).astype(np.int64)]
        self.time, self.mover, self.middle = grid[known], witness.mover, middle
        self.own = own = witness.lengths[known]
        self.causes = np.stack([np.ones(len(known)), own - own.mean()], axis=1)
        self.weights = np.ones(len(known))
        self.inside = np.ones(len(known), bool)
        self.made = own

    def at(self, clock: Floats, begin: float, end: float) -> tuple[Floats, Floats]:
        """Lengths (n,) by the winch and derivatives (n, 2) by the clock, less what the points explain."""
        when = self.middle + (self.time - clock[0]) / clock[1]
        first, last = max(begin, self.mover.time[0]), min(end, self.mover.time[-1])
        self.inside = (when >= first) & (when <= last)
        now, ahead, behind = (
            np.interp(when + side, self.mover.time, self.mover.made)
            for side in (0.0, SMOOTH / 2, -SMOOTH / 2)
        )
        self.made = now
        slope = -(ahead - behind) / SMOOTH / clock[1]
        whole = np.stack([now - now.mean(), slope, slope * (when - self.middle)], axis=1)
        weight = (self.weights * self.inside)[:, None]
        sizes = np.linalg.lstsq(self.causes * weight, whole * weight, rcond=None)[0]
        left = whole - self.causes @ sizes
        return left[:, 0], left[:, 1:]

    def longer(self) -> float:
        """How much longer the cable usually is by its winch, at the last clock [m]."""
        return float(np.median((self.made - self.own)[self.inside])) if self.inside.any() else 0.0

    def weigh(self, off: Floats) -> None:
        """Give lengths that are off by (n,) [m] less weight."""
        usual = 1.4826 * float(np.median(np.abs(off[self.inside]))) if self.inside.any() else 0.0
        self.weights = np.clip(1 - (off / (TUKEY * max(usual, 1e-9))) ** 2, 0.0, None)


def _fitted(
    grid: Floats, witnesses: Sequence[Witness], clock: Clock, begin: float, end: float
) -> Alignment:
    """Offset and pace by the winches from begin to end, from a clock that is nearly right."""
    time = witnesses[0].mover.time
    first, last = max(begin, float(time[0])), min(end, float(time[-1]))
    middle, half = (first + last) / 2, max((last - first) / 2, 1e-3)
    rows = [_Rows(grid, each, middle) for each in witnesses]
    now: Floats = np.array([clock.offset + clock.pace * middle, clock.pace])
    free = [0, 1]
    while True:
        sds: Floats = np.zeros(2)
        residual = 0.0
        for _ in range(ROUNDS):
            now, change, sds, residual = _round(rows, now, free, begin, end, half)
            if np.abs(change * [1.0, half]).max() < SETTLED:
                break
        if len(free) == 1 or abs(now[1] - 1.0) > SURE * sds[1]:
            break
        free, now = [0], np.array([now[0], 1.0])
    found = Clock(float(now[0] - now[1] * middle), float(now[1]))
    return Alignment(found, float(sds[0]), residual, np.array([each.longer() for each in rows]))


def _round(
    rows: Sequence[_Rows], now: Floats, free: list[int], begin: float, end: float, half: float
) -> tuple[Floats, Floats, Floats, float]:
    """The clock after a step of the fit, the step, standard deviations, and the usual residual [m]."""
    normal, right = np.zeros((2, 2)), np.zeros(2)
    squares = count = 0.0
    scale = np.array([1.0, half])
    parts = [each.at(now, begin, end) for each in rows]
    for (off, by), each in zip(parts, rows, strict=True):
        weight = (each.weights * each.inside) ** 2
        usual = max(float(weight @ off**2 / max(weight.sum(), 1e-9)), 1e-18)
        normal += (by / scale * weight[:, None]).T @ (by / scale) / usual
        right += (by / scale * weight[:, None]).T @ off / usual
        squares += float(weight @ off**2)
        count += float(weight.sum())
    inverse = np.zeros((2, 2))
    inverse[np.ix_(free, free)] = np.linalg.pinv(normal[np.ix_(free, free)])
    limit = np.array([STEP, STEP / half])
    change = np.clip(-(inverse @ right) / scale, -limit, limit)
    for (off, by), each in zip(parts, rows, strict=True):
        each.weigh(off + by @ change)
    independent = max(1.0, 2 * half / INDEPENDENT * len(rows))
    sds = np.sqrt(np.maximum(np.diagonal(inverse), 0.0) * max(1.0, count / independent)) / scale
    return now + change, change, sds, float(np.sqrt(squares / max(count, 1e-9)))
