"""Commands, measured winch positions and lengths of cables: three accounts of how the winches moved.

Where one does not follow the other, but would with another sign, unit, column or clock, the report says so.
The log is not refused: the robot itself may be wired like that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.evidence import Evidence, lengths_between, stretch, told_positions
from flywheel.data.recordings.report import Finding
from flywheel.data.recordings.tables.columns import Log, control_names, winch_names
from flywheel.records import Floats
from flywheel.robots import Robot

SPAN = 0.4  # time over which changes are compared [s]
MOST = 400  # changes that are looked at
FEWEST, SHORTEST = 20, 3.0  # changes that say something, and the time that they take [s]
ALIKE = 0.8  # correlation from which two causes are not told apart
FOLLOWS = 0.8  # correlation of changes from which one account follows the other
HARDLY = 0.5  # the same of what must follow, and does not
SURELY = 0.9  # the same with another column or clock, which are many
TIMES = 1.5  # as much, or as little, that a cable may move at most to be its winch's among others like it
UNITS = 3.0  # times as much, or as little: no robot is so wrong, its unit is
MANY = 3  # winches that tell of another clock together, even if one or another does not follow
CLEARLY = 0.5  # another clock leaves at most this share of what is unexplained
MOST_SHIFT, SHIFT = 2.0, 0.02  # clocks that are tried, and the step between them [s]
EARLY = 0.05  # how much before its cause an effect is told to be [s]
LATE = 0.1  # how much after it, beside what cables take to follow [s]
OFTEN = 0.5  # share of the rows in which a winch is measured; of the winches that move untold
TINY = 1e-9  # rounding of times [s]
SIGN = "has it the wrong sign (positive pays out), or the name of another?"
TOLD = "is it what the winch was told, at these times?"
STILL = 0.02  # share of its range by which a winch moved


@dataclass(frozen=True)
class Account:
    """Positions of the winches, each up to a constant, by one of the accounts.

    Attributes:
      noun: of all of them.
      names: of each winch's column, or cable.
      time: (N,) [s].
      values: (N, W) [m].
    """

    noun: str
    names: Sequence[str]
    time: Floats
    values: Floats

    def changes(self, begin: Floats, end: Floats) -> Floats:
        """(n, W) changes between two times (n,) each [m]; NaN beyond the account's times."""
        if len(begin) == 0:
            return np.empty((0, len(self.names)))
        inside = (begin >= self.time[0]) & (end <= self.time[-1])
        return np.where(inside[:, None], self._at(end) - self._at(begin), np.nan)

    def _at(self, times: Floats) -> Floats:
        """(n, W) positions at times (n,), interpolated [m]."""
        after = np.clip(np.searchsorted(self.time, times), 1, max(1, len(self.time) - 1))
        before = after - 1
        share = (times - self.time[before]) / (self.time[after] - self.time[before])
        return self.values[before] + share[:, None] * (self.values[after] - self.values[before])

    def of(self, winches: NDArray[np.int64]) -> Account:
        """The same of some winches in the rows in which all of them are known."""
        rows = np.isfinite(self.values[:, winches]).all(axis=1)
        names = [self.names[i] for i in winches]
        return Account(self.noun, names, self.time[rows], self.values[np.ix_(rows, winches)])


def check_accounts(
    log: Log, points: Floats, robot: Robot, evidence: Evidence | None
) -> list[Finding]:
    """Notes on winches whose sensors, or cables, do not follow what moves them.

    Args:
      log: with NaN for masked samples.
      points: (N, P, 3) under their names [m]; NaN where missing.
      robot: of the log.
      evidence: of its cables.
    """
    if not robot.winches or robot.tension_driven:
        return []
    told = Account("the commands", control_names(robot), log.time, told_positions(log, robot))
    names = list(told.names)
    for name, index in winch_names(robot).items():
        names[index] = name
    measured = np.flatnonzero(np.isfinite(log.winch).mean(axis=0) > OFTEN)
    sensed = Account("the winch positions", names, log.time, log.winch).of(measured)
    wide = STILL * (robot.rest_high - robot.rest_low)
    alone = np.ones(len(measured), bool)
    findings = _Doubt(told.of(measured), sensed, LATE, wide[measured], alone).findings()
    first = [winch.cables[0] for winch in robot.winches]
    lengths = _lengths(log.time, points, robot, first)
    if lengths is not None and evidence is not None:
        unmeasured = np.setdiff1d(np.arange(len(robot.winches)), measured)
        late, little = LATE + _slow(robot, first), stretch(robot)[first]
        taut = np.array([evidence.needed(cable) for cable in first])
        for cause, some in ((told.of(unmeasured), unmeasured), (sensed, measured)):
            findings += _Doubt(cause, lengths.of(some), late, little[some], taut[some]).findings()
    return findings


def moved_on_hold(evidence: Evidence | None, held: Sequence[int]) -> list[Finding]:
    """Notes on winches `held` that never moved, as the map says, though their taut cables change by more than
    they can be pulled.
    """
    if evidence is None:
        return []
    robot, lengths, found = evidence.robot, evidence.lengths(evidence.points), list[Finding]()
    for winch in held:
        cable = robot.winches[winch].cables[0]
        low, high = np.quantile(lengths[:, cable], [0.05, 0.95])
        little = STILL * (robot.rest_high - robot.rest_low)[winch]
        if high - low > evidence.pulled[cable] + little and evidence.needed(cable):
            by = f"changes by {1e3 * (high - low):.3g} mm"
            words = f"{robot.cables[cable].name} {by}, though the map says hold"
            found.append(Finding("channel", "noted", control_names(robot)[winch], 0, words=words))
    return found


def _lengths(time: Floats, points: Floats, robot: Robot, cables: Sequence[int]) -> Account | None:
    """Lengths of a cable of each winch, at the times that matter; None where the points do not tell them."""
    seen = np.flatnonzero(np.isfinite(points[..., 0]).all(axis=1))
    if len(seen) == 0 or not robot.free:
        return None
    seen = seen[np.isin(time[seen], _spans(time[seen]))]
    lengths = lengths_between(points[seen], robot)[:, cables]
    return Account("the cables", [robot.cables[i].name for i in cables], time[seen], lengths)


def _slow(robot: Robot, cables: Sequence[int]) -> float:
    """Time that some cables take to follow their winches [s]."""
    stiff = np.array([robot.cables[i].stiffness for i in cables])
    damped = np.array([robot.cables[i].damping for i in cables])
    mass = sum(body.mass for body in robot.bodies)
    return float((damped / stiff).max() + np.sqrt(mass / stiff.sum()))


class _Doubt:
    """Notes on winches of which one account does not follow another, its cause.

    Args:
      cause, effect: the accounts.
      late: how much later than its cause an effect may be [s].
      little: (W,) how much each effect may change without its cause [m].
      alone: (W,) nothing but its cause moves an effect, as other winches move a slack cable.
    """

    def __init__(
        self,
        cause: Account,
        effect: Account,
        late: float,
        little: Floats,
        alone: NDArray[np.bool_],
    ) -> None:
        self.cause, self.effect, self.late = cause, effect, late
        self.little, self.alone = little, alone
        self.begin, self.end = _spans(effect.time)
        self.after = effect.changes(self.begin, self.end)

    def findings(self) -> list[Finding]:
        """About causes that stand still, clocks, signs, units and columns."""
        few = len(self.begin) < FEWEST or self.end[-1] - self.begin[0] < SHORTEST
        if few or not self.cause.names:
            return []
        found, every = self._still(), np.arange(len(self.little))
        shift, (follows, size) = 0.0, self._fit(0.0)
        if found or (follows.diagonal() < -FOLLOWS).all():
            return found or self._signs(every)
        # A few cables may be slack.
        sure = len(every) >= MANY or self.alone.all()
        if sure and (shift := self._shift(every)):
            words = _later(shift, self.effect.noun, self.cause.noun)
            found.append(Finding("clock", "noted", "", 0, words=words))
            follows, size = self._fit(shift)
        own, size = follows.diagonal(), size.diagonal()
        turned = (own < -SURELY) & (size < -1 / TIMES) & (size > -TIMES)
        turned |= (own < -FOLLOWS) & self._by_itself(shift)
        found += self._signs(np.flatnonzero(turned))
        for i in np.flatnonzero((own > FOLLOWS) & ((size > UNITS) | (size < 1 / UNITS))).tolist():
            words = (
                f"{self.effect.names[i]} changes {size[i]:.3g} times as much: is its unit right?"
            )
            found.append(self._note(i, words))
        return found + self._others(follows, np.flatnonzero(np.abs(own) < FOLLOWS))

    def _others(self, follows: Floats, some: NDArray[np.int64]) -> list[Finding]:
        """About some winches that do not follow their own column, but another's of them, or late."""
        among, found = follows[np.ix_(some, some)], list[Finding]()
        partners = np.arange(len(some))
        if (among > SURELY).any():
            # Start-up time: as in flywheel.smoothing.
            from scipy.optimize import linear_sum_assignment

            partners = linear_sum_assignment(-among)[1]
        for i, j in enumerate(partners.tolist()):
            effect, cause = self.effect.names[some[i]], self.cause.names[some[i]]
            if i != j and among[i, j] > SURELY:
                words = f"{effect} follows it, and not {cause}: are the columns exchanged?"
                found.append(self._note(some[j], words))
            elif self.alone[some[i]] and (shift := self._shift(some[[i]])):
                found.append(self._note(some[i], _later(shift, effect, cause)))
            elif self.alone[some[i]] and among[i, i] < HARDLY and self._moved()[some[i]]:
                found.append(self._note(some[i], f"{effect} does not follow it: {TOLD}"))
        return found

    def _signs(self, turned: NDArray[np.int64]) -> list[Finding]:
        return [
            self._note(i, f"{self.effect.names[i]} changes the other way: {SIGN}")
            for i in turned.tolist()
        ]

    def _by_itself(self, shift: float) -> NDArray[np.bool_]:
        """(W,) bool: True where no other cause is like its own, and may be the one that it follows."""
        before = self.cause.changes(self.begin - shift, self.end - shift)
        before = before[np.isfinite(before).all(axis=1)]
        alike, _ = _correlations(before, before)
        return np.asarray(self.alone | ((np.abs(alike) > ALIKE).sum(axis=1) < 2))

    def _still(self) -> list[Finding]:
        """About causes that never change, where most of their effects do."""
        if np.ptp(self.cause.values, axis=0).any():
            return []
        moved = self._moved()
        return [
            self._note(i, f"never changes, but {self.effect.names[i]} does: {TOLD}")
            for i in (np.flatnonzero(moved).tolist() if moved.mean() >= OFTEN else ())
        ]

    def _moved(self) -> NDArray[np.bool_]:
        """(W,) bool: True for effects that changed by more than they may without a cause."""
        low, high = np.percentile(self.effect.values, [5, 95], axis=0)
        return np.asarray(high - low > self.little)

    def _shift(self, some: NDArray[np.int64]) -> float:
        """How much later another clock has the effects of some winches, clearly, and too late [s]; else 0."""
        most = min(MOST_SHIFT, (self.end[-1] - self.begin[0]) / 3)
        shifts = SHIFT * np.arange(-round(most / SHIFT), round(most / SHIFT) + 1)
        fits = np.array([self._fit(shift, some)[0][0, 0] for shift in shifts])
        left = 1 - np.maximum(fits, 0.0) ** 2
        # What is periodic fits at other shifts, too: the nearest is meant.
        good = np.flatnonzero(left <= left.min() / CLEARLY)
        runs = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
        run = min(runs, key=lambda each: np.abs(shifts[each]).min())
        best = run[left[run].argmin()]
        zero = len(left) // 2
        between = fits[min(best, zero) : max(best, zero) + 1]
        periodic = fits[zero] > FOLLOWS > between.min()
        clearly = fits[best] > SURELY and left[best] < CLEARLY * left[zero] and not periodic
        shift = float(shifts[best])
        return 0.0 if not clearly or -EARLY <= shift <= self.late else shift

    def _fit(
        self, shift: float, together: NDArray[np.int64] | None = None
    ) -> tuple[Floats, Floats]:
        """(W, W) correlations of changes with causes some time earlier [s], and their ratios.

        Of some winches together they are (1, 1).
        """
        before = self.cause.changes(self.begin - shift, self.end - shift)
        inside = np.isfinite(before).all(axis=1)
        before, after = before[inside], self.after[inside]
        if together is not None:
            before, after = (each[:, together].reshape(-1, 1) for each in (before, after))
        return _correlations(after, before)

    def _note(self, winch: int, words: str) -> Finding:
        return Finding("channel", "noted", self.cause.names[winch], 0, words=words)


def _correlations(after: Floats, before: Floats) -> tuple[Floats, Floats]:
    """(V, W) correlations of changes (n, V) with others (n, W), and their ratios; 0 where nothing changes."""
    products, squares = after.T @ before, (before**2).sum(axis=0)
    both = np.sqrt((after**2).sum(axis=0)[:, None] * squares)
    zero = np.zeros_like(products)
    follows = np.divide(products, both, out=zero.copy(), where=both > 0)
    return follows, np.divide(products, squares, out=zero, where=squares > 0)


def _later(shift: float, effect: str, cause: str) -> str:
    """The words about an effect that comes too late, or too early [s]."""
    told = f"{effect} moved {abs(shift):.2g} s {'before' if shift < 0 else 'later than'} {cause}"
    delay = "; a delay of the robot itself is found by a diagnosis (command_delay, sensor_latency)"
    return f"{told}: have all columns one clock?{delay if shift > 0 else ''}"


def _spans(time: Floats) -> tuple[Floats, Floats]:
    """Begins and ends (n,) of spans between some of the times (N,) [s]."""
    later = np.searchsorted(time, time + SPAN - TINY)
    begin = np.flatnonzero(later < len(time))
    begin = begin[time[later[begin]] - time[begin] < 2 * SPAN]
    begin = begin[np.linspace(0, len(begin) - 1, min(MOST, len(begin))).astype(np.int64)]
    return time[begin], time[later[begin]]
