"""Poses that flip: a tracker takes a body for itself, turned by a symmetry.

No body turns so far from one row to the next. A turn by a symmetry is taken back until the tracker flips
again. Any other is left to those who follow its points; where these cannot show it, there is no pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.repair.following import FASTEST
from flywheel.records import Floats
from flywheel.robots import GRAVITY, Robot
from flywheel.rotations import about_axis, conjugate, multiply, rotate

ANGLES = np.radians([180.0, 120.0, -120.0, 90.0, -90.0, 60.0, -60.0])  # of symmetries
JUMP = np.radians(45.0)  # a smaller turn from row to row may be one
NEAR = np.radians(12.0)  # how exactly a turn is one by a symmetry: motion of a row, and noise
ROOM = 0.02  # share of the robot's length: what noise moves a body
STAYS = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Limits:
    """Limits of a body's motion.

    Attributes:
      rate: at which no body turns [rad/s].
      speed: at which none moves [m/s].
      room: how far the tracker may be off [m].
      size: distance of its farthest point from its origin [m].
      period: time between two rows [s].
    """

    rate: float
    speed: float
    room: float
    size: float
    period: float

    @classmethod
    def of(cls, robot: Robot, points: Floats, time: Floats) -> Limits:
        """Those of a body with points (k, 3) in its frame, seen at times (N,)."""
        length, size = robot.length, float(np.linalg.norm(points, axis=1).max())
        rate, speed = FASTEST * np.sqrt([GRAVITY / length, GRAVITY * length])
        period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        return cls(float(rate), float(speed), ROOM * length, size, period)

    def reach(self, seconds: float) -> float:
        """The farthest way [m]."""
        return self.speed * seconds + self.room

    @property
    def hidden(self) -> bool:
        """True if points move less in a jump than they may, so that nothing else shows it."""
        return 2 * self.size * np.sin(JUMP / 2) < self.reach(self.period)


@dataclass(frozen=True)
class UnseenTurns:
    """Turns of a body in its own frame that a tracker may not notice.

    Attributes:
      turns: (S, 4) quaternions, the first of which is none.
      line: (3,) the direction of a body whose points tell only that; None for any other.
    """

    turns: Floats
    line: Floats | None

    @classmethod
    def of(cls, points: Floats, axes: Floats) -> UnseenTurns:
        """Those of a body with points (k, 3) and possible axes of symmetry (A, 3), about its origin."""
        size, directions = np.linalg.svd(points, full_matrices=False)[1:]
        if len(size) == 1 or size[1] < 1e-6 * size[0]:
            across = np.linalg.svd(directions[:1])[2][-1]
            return cls(np.stack([STAYS, about_axis(across, np.array(np.pi))]), directions[0])
        turns = [about_axis(axis, angle) for axis, angle in product(axes, ANGLES)]
        return cls(np.stack([STAYS, *turns]), None)

    def apart(self, one: Floats, other: Floats) -> Floats:
        """(...) angles between rotations (..., 4), as far as the points tell [rad]."""
        if self.line is None:
            cosine = np.abs((one * other).sum(axis=-1))
            return np.asarray(2 * np.arccos(np.minimum(cosine, 1.0)))
        cosine = (rotate(one, self.line) * rotate(other, self.line)).sum(axis=-1)
        return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def unflipped(
    turned: Floats, place: Floats, time: Floats, unseen: UnseenTurns, limits: Limits
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Take back flips.

    Args:
      turned: (N, 4) rotations as the tracker has them; NaN where the body was not seen.
      place: (N, 3) positions of the body [m].
      time: (N,) [s].
      unseen: of the body.
      limits: of its motion.

    Returns:
      The rotations, and masks (N,) of those that were put right and of those that are left out, as NaN.
    """
    rows = np.flatnonzero(np.isfinite(turned).all(axis=1))
    seen, when, turns = turned[rows], time[rows], unseen.turns
    soon = limits.rate * np.diff(when) < JUMP
    jumps = soon & (unseen.apart(seen[1:], seen[:-1]) > JUMP)
    events = 1 + np.flatnonzero(jumps | ~soon)
    flips = np.zeros(len(rows), np.int64)  # index of the turn to take back; -1: none is known
    good = 0  # the last row with one
    for begin, end in pairwise([*events.tolist(), len(rows)]):
        good = begin - 1 if flips[begin - 1] >= 0 else good
        pause = float(when[begin] - when[good])
        if limits.rate * pause >= JUMP:
            flips[begin:end] = -1 if flips[good] else 0  # it may have flipped back, or not
        elif np.linalg.norm(place[rows[begin]] - place[rows[good]]) <= limits.reach(pause):
            last = multiply(seen[good], turns[flips[good]])
            off = unseen.apart(multiply(seen[begin], turns), last)
            unknown = (
                -1 if limits.hidden else 0
            )  # elsewhere, as another body's pose, its markers leap
            flips[begin:end] = off.argmin() if off.min() < NEAR else unknown
    usual = int(np.bincount(flips[flips >= 0], minlength=1).argmax())  # is no flip
    other, lost = (np.zeros(len(turned), bool) for _ in range(2))
    other[rows], lost[rows] = (flips >= 0) & (flips != usual), flips < 0
    found = turned.copy()
    found[rows] = multiply(multiply(seen, turns[flips]), conjugate(turns[usual]))
    found[lost] = np.nan
    return np.where((other | lost)[:, None], found, turned), other, lost
