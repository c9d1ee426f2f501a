"""Samples that repeat the previous one digit by digit: a frozen sensor, or one slower than the log.

Such a sample is not a measurement. Equal digits alone do not prove this: coarse digits repeat, and
so does a robot at rest in a simulation without noise. A sample only counts as repeated if its
digits should have changed, because of noise in the whole log, or because the marker moved just
before and just after. A winch may stop at once, so that of its positions only noise tells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.noise import last_digit, white_noise
from flywheel.data.recordings.report import Finding
from flywheel.data.recordings.tables.columns import Log, winch_names
from flywheel.records import Floats
from flywheel.robots import Robot

FINEST = 1e-7  # smallest change that is one, in L: no tracker is finer
CHANCE = 1e-6  # of a log in which a run of repeats, or their number, comes by chance
SURE_STEPS = 20.0  # least last digits per sample at which a marker moves, noise aside
BUFFER = 5  # rows in sequence that repeat earlier ones
LIKELY = 0.05  # chance of a repeat from which on single ones say nothing


def mask_repeats(log: Log, robot: Robot) -> list[Finding]:
    """Mask, in place, samples of points and winches that only repeat the previous ones.

    Args:
      log: with each time once; NaN for a missing sample.
      robot: its length defines negligible changes.
    """
    finest, sensors = FINEST * robot.length, winch_names(robot)
    points = [(each.name, log.points[:, i], SURE_STEPS) for i, each in enumerate(robot.points)]
    winches = [(name, log.winch[:, i : i + 1], np.inf) for name, i in sensors.items()]
    findings = _mask_resent(log, finest)
    for name, values, steps in points + winches:
        found = _stale(values, finest, steps)
        for axis in range(
            values.shape[1]
        ):  # one may be stuck, but of a still robot's only noise tells
            found |= _stale(values[:, axis : axis + 1], finest, np.inf)
        if found.any():
            words = _words(found, log.time)
            findings.append(Finding.over("repeat", "masked", name, found, log.time, words))
            values[found] = np.nan
    return findings


def _mask_resent(log: Log, finest: float) -> list[Finding]:
    """Mask, in place, rows in which all points repeat an earlier stretch of rows, as a resent buffer does."""
    values = log.points.reshape(len(log.points), -1)
    # Sums with irrational weights are equal where the rows are.
    sums = values @ np.sqrt(np.arange(2.0, 2.0 + values.shape[1]))
    seen = np.flatnonzero(np.isfinite(sums))
    _, first, inverse = np.unique(sums[seen], return_index=True, return_inverse=True)
    back = np.arange(len(seen)) - first[inverse]
    same = (back[1:] == back[:-1]) & (back[1:] > 1)  # as the row before
    begin = np.flatnonzero(np.diff(same.astype(np.int8), prepend=0) == 1)
    end = np.flatnonzero(np.diff(same.astype(np.int8), append=0) == -1)
    long = end - begin + 2 >= BUFFER
    if not long.any():
        return []
    values = values[seen]
    digit = last_digit(values, finest)
    if _chance(white_noise(values, digit), digit) > CHANCE:
        return []
    found = np.zeros(len(log.points), bool)
    for a, b in zip(begin[long].tolist(), end[long].tolist(), strict=True):
        found[seen[a : b + 2]] = True
    log.points[found] = np.nan
    words = "the digits of an earlier stretch of rows: was it sent twice?"
    return [Finding.over("repeat", "masked", "", found, log.time, words)]


def _stale(values: Floats, finest: float, steps: float) -> NDArray[np.bool_]:
    """(N,) bool: True for values (N, k) that repeat the previous ones without a measurement.

    Args:
      finest: smallest change that is one [m].
      steps: least last digits per sample at which the values change by motion.
    """
    found = np.zeros(len(values), bool)
    if not _equal(values[1:], values[:-1]).any():
        return found
    seen = np.flatnonzero(np.isfinite(values[:, 0]))
    new = np.ones(len(seen), bool)
    new[1:] = ~_equal(values[seen[1:]], values[seen[:-1]])
    index = np.cumsum(new) - 1  # of the sample that is repeated
    samples = values[seen[new]]
    repeats = np.bincount(index) - 1
    digit = last_digit(samples, finest)
    noisy = _chance(np.sqrt(2) * white_noise(samples, digit), digit)
    chance = np.minimum(noisy, _chance(_least_steps(samples, steps * digit), digit))
    sure = len(values) * chance**repeats < CHANCE
    # Repeats that are too few in a run may be too many in all.
    single = chance < LIKELY
    if repeats[single].sum() > 10 + 5 * chance[single].sum():
        sure |= single
    found[seen] = ~new & sure[index]
    return found


def _equal(some: Floats, others: Floats) -> NDArray[np.bool_]:
    """(n,) bool: True for equal samples (n, k)."""
    each = [some[:, axis] == others[:, axis] for axis in range(some.shape[1])]
    return np.asarray(np.logical_and.reduce(each))


def _least_steps(samples: Floats, least: Floats) -> Floats:
    """(M, k) the least of the changes before, from and after each sample to its next (M, k) [m].

    0 below `least` (k,): a marker that stops, or starts to move. The end of the log does not count
    as rest; its beginning may.
    """
    steps = np.abs(np.diff(samples, axis=0))
    before = np.concatenate([np.zeros((1, samples.shape[1])), steps])[: len(samples)]
    endless = np.full((2, samples.shape[1]), np.inf)
    at = np.concatenate([steps, endless])[: len(before)]
    after = np.concatenate([steps[1:], endless])[: len(before)]
    found = np.minimum(before, np.minimum(at, after))
    return np.where(found < least, 0.0, found)


def _chance(steps: Floats, digit: Floats) -> Floats:
    """(...) probability that no coordinate's last digit changes over normal steps (..., k) of that size."""
    with np.errstate(divide="ignore"):
        each = np.minimum(1.0, digit / (np.sqrt(2 * np.pi) * steps))
    return np.asarray(each.prod(axis=-1))


def _words(found: NDArray[np.bool_], time: Floats) -> str:
    """Pattern of a marker's repeats, for people: occasional, or of a slower tracker."""
    told = "the digits of the previous sample: not a measurement"
    new = np.flatnonzero(~found)
    apart = float(np.median(np.diff(new))) if len(new) > 1 else 1.0
    if apart < 2:
        return f"{told}; was tracking lost?"
    rate = 1 / float(np.median(np.diff(time[new])))
    return f"{told}; new ones come {apart:.0f} rows apart: a tracker of {rate:.4g} Hz?"
