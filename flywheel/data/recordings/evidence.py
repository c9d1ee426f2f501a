"""Cables as witnesses: their lengths between measured points are what winches and MJCF allow, or the log is
in another frame than the MJCF, or under wrong names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.pieces import distance
from flywheel.data.recordings.report import listed
from flywheel.data.recordings.tables.columns import Log
from flywheel.records import Floats
from flywheel.robots import GRAVITY, Attachment, Robot
from flywheel.rotations import cross, kabsch, rotate, unit

ROWS = 400  # rows that are looked at
FEWEST = 20  # rows that say something
# Share of a cable's length at the keyframe: its ends may be elsewhere than the MJCF says.
MISPLACED = 0.05
PULLED = 3.0  # weights of the robot, or tensions at the keyframe, that no cable usually bears
# Share of what a winch has moved since the keyframe that it may have moved less, or more.
GAIN = 0.3
FREE = 7  # numbers of a free body's pose
STRAIGHT = 1e-6  # share of a body's size: its points are on one line
FITS = 0.2  # share of the cables' motion that an explanation leaves unexplained, at most
BALANCED_ROWS = 40  # rows from which mean forces are taken
UNHELD = 0.1  # share of the weight that may be held by nothing, for all that is wrong with an MJCF
HANGING = 0.1  # height above the ground at which nothing stands on it, in L


@dataclass(frozen=True)
class Evidence:
    """Rows of a log in which all points were seen, and what the winches did in them.

    Attributes:
      robot: that it is about.
      points: (n, P, 3) [m].
      rest: (n, C) rest lengths of the cables [m]; where `relative`, off by a constant.
      relative: (C,) cables whose winch nobody measured.
      fixed: (C,) cables with one end that cannot move.
      slop: (C,) how far the places of their ends are unsure [m].
      pulled: (C,) how much longer than its rest length each may be pulled [m].
      limit: (C,) greatest lengths beyond `rest`, or `highest` where relative, whatever is built wrong [m].
      lowest, highest: (C,) least and greatest rest lengths that the winches can make [m].
    """

    robot: Robot
    points: Floats
    rest: Floats
    relative: NDArray[np.bool_]
    fixed: NDArray[np.bool_]
    slop: Floats
    pulled: Floats
    limit: Floats
    lowest: Floats
    highest: Floats

    @classmethod
    def of(cls, log: Log, points: Floats, robot: Robot) -> Evidence | None:
        """Evidence of points (N, P, 3) of a log; None where it says nothing."""
        rows = np.flatnonzero(np.isfinite(points[..., 0]).all(axis=1))
        if len(rows) < FEWEST or not robot.cables or not robot.free or robot.tension_driven:
            return None
        rows = rows[np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).astype(np.int64)]
        rest, relative = rest_lengths(log, robot, rows)
        fixed = [min(end.body for end in cable.ends) < 0 for cable in robot.cables]
        slop = [sum(_on_line(robot, end)[1] for end in cable.ends) for cable in robot.cables]
        limits = _limits(robot, rest, relative)
        return cls(robot, points[rows], rest, relative, np.array(fixed), np.array(slop), *limits)

    def lengths(self, points: Floats) -> Floats:
        """(n, C) lengths of the cables between points (n, P, 3) [m]."""
        return lengths_between(points, self.robot)

    def unexplained(self, points: Floats) -> float:
        """Root mean square of how much longer the cables are than their rest lengths and pulls explain [m].

        Of those whose rest lengths are only known but for a constant, it is how much they change otherwise.
        """
        off = self.lengths(points) - self.rest
        beyond = np.maximum(off - self.pulled - self.slop, 0.0)
        found = np.where(self.relative, off - off.mean(axis=0), beyond)
        return float(np.sqrt((found**2).mean()))

    @property
    def certain(self) -> bool:
        """The cables fit the points under their present names."""
        return self.unexplained(self.points) < FITS * self.motion()

    def motion(self) -> float:
        """Root mean square change of the rest lengths in the log [m]."""
        return float(np.sqrt(self.rest.var(axis=0).mean()))

    def too_long(self, points: Floats) -> Floats:
        """(C,) how much longer each cable usually is than can be [m]; at most 0 where it may be."""
        lengths = self.lengths(points) - self.slop
        beyond = np.where(self.relative, lengths - self.highest, lengths - self.rest)
        return np.asarray(np.median(beyond, axis=0) - self.limit)

    def taut(self, points: Floats) -> NDArray[np.bool_]:
        """(n, C) where each cable may pull."""
        longest = np.where(self.relative, self.lowest, self.rest) - self.limit - self.slop
        return np.asarray(self.lengths(points) > longest)

    def needed(self, cable: int) -> bool:
        """Without this cable the robot would fall, so that it pulls."""
        if not self.hangs(self.points) or self.unheld(self.points) > UNHELD:
            return False
        return self.unheld(self.points, without=cable) > UNHELD

    def unheld(self, points: Floats, without: int | None = None) -> float:
        """Share of each body's weight that no pull of the cables can hold on average, as forces and torques.

        What moves to and fro is held on average, however the pull of each cable changes.
        """
        rows = np.linspace(0, len(points) - 1, BALANCED_ROWS).astype(np.int64)
        taut, points, bodies = self.taut(points)[rows], points[rows], self.robot.bodies
        columns = np.zeros((len(rows), len(self.robot.cables), 6 * len(bodies)))
        wanted = np.zeros(6 * len(bodies))
        wanted[2::6] = 1.0
        for number, cable in enumerate(self.robot.cables):
            places = [_place(self.robot, points, end) for end in cable.ends]
            along = unit(places[1] - places[0])
            for end, place, pull in zip(cable.ends, places, (along, -along), strict=True):
                if end.body >= 0:
                    body = bodies[end.body]
                    middle = _place(self.robot, points, Attachment(end.body, body.com, end.point))
                    lever = 2 * cross(place - middle, pull) / self.robot.length
                    own = slice(6 * end.body, 6 * end.body + 6)
                    columns[:, number, own] += np.concatenate([pull, lever], axis=1) / body.mass
        columns[~taut] = 0.0
        if without is not None:
            columns[:, without] = 0.0
        # Start-up time: as in flywheel.smoothing.
        from scipy.optimize import nnls

        _, left = nnls(columns.reshape(-1, columns.shape[-1]).T, wanted)
        return float(left / np.sqrt(len(bodies)))

    def hangs(self, points: Floats) -> bool:
        """Nothing but cables can hold the robot."""
        radius = np.array([point.radius for point in self.robot.points])
        lowest = np.median((points[..., 2] - radius).min(axis=1))
        return bool(self.fixed.any()) and (
            not self.robot.grounded or lowest > HANGING * self.robot.length
        )

    def wrong(self, points: Floats) -> str:
        """Why the points cannot be where they are said to be; "" where they can."""
        if not self.fixed.any():
            return ""
        long = self.too_long(points)
        if (long[self.fixed] > 0).mean() >= 0.5:
            return self._told(points, long)
        if self.hangs(points) and (left := self.unheld(points)) > UNHELD:
            return self._told_held(points, left)
        return ""

    def _told(self, points: Floats, long: Floats) -> str:
        lengths = np.median(self.lengths(points), axis=0)
        return listed(
            [
                f"{self.robot.cables[i].name} would usually be {lengths[i]:.3g} m long, at most "
                f"{lengths[i] - long[i]:.3g} m are possible"
                for i in np.flatnonzero(self.fixed & (long > 0))
            ],
            3,
        )

    def _told_held(self, points: Floats, left: float) -> str:
        if not self.taut(points)[:, self.fixed].any():
            return "all of them would be slack, and nothing would hold the robot"
        return f"they could not hold the robot where it would be ({left:.0%} of its weight)"


def lengths_between(points: Floats, robot: Robot) -> Floats:
    """(n, C) lengths of the cables between points (n, P, 3) [m]; all bodies are free."""
    ends = [[_place(robot, points, end) for end in cable.ends] for cable in robot.cables]
    return np.stack([distance(a, b) for a, b in ends], axis=1)


def told_positions(log: Log, robot: Robot) -> Floats:
    """(N, W) positions of the winches by their commands alone [m]; those of rates from 0 on."""
    steps = np.diff(log.time)
    usual = float(np.median(steps))
    positions = np.zeros(log.controls.shape)
    for index, winch in enumerate(robot.winches):
        told = log.controls[:-1, index]
        if winch.kind == "rate":
            positions[1:, index] = np.cumsum(told * steps)
        else:
            positions[:, index] = _lagged(told, usual, winch.time_constant)
    return positions


def rest_lengths(
    log: Log, robot: Robot, rows: NDArray[np.int64]
) -> tuple[Floats, NDArray[np.bool_]]:
    """(n, C) rest lengths in some rows [m], and (C,) which are only known but for a constant."""
    kept = np.array([cable.rest_length for cable in robot.cables])
    rest, relative = np.tile(kept, (len(rows), 1)), np.zeros(len(kept), bool)
    told = told_positions(log, robot)[rows]
    for index, winch in enumerate(robot.winches):
        measured, cables = log.winch[rows, index], list(winch.cables)
        known = bool(np.isfinite(measured).all())
        relative[cables] = winch.kind == "rate" and not known
        moved = measured if known else told[:, index]
        counted = known or winch.kind == "position"  # from 0, not from the keyframe
        moved = moved - kept[cables[0]] if counted else moved
        rest[:, cables] += moved[:, None] * winch.ratios
    return rest, relative


def _lagged(told: Floats, step: float, constant: float) -> Floats:
    """(N + 1,) what follows commands (N,), one a step [s], with a first-order lag of a time constant [s]."""
    # Start-up time: as in flywheel.smoothing.
    from scipy.signal import lfilter

    share = float(np.exp(-step / constant)) if constant > 0 else 0.0
    after, _ = lfilter([1 - share], [1, -share], told, zi=[share * told[0]])
    return np.concatenate([told[:1], after])


def stretch(robot: Robot) -> Floats:
    """(C,) how much the robot's weight, or the tension at the keyframe, lengthens each cable [m]."""
    kept = np.array([cable.rest_length for cable in robot.cables])
    stiff = np.array([cable.stiffness for cable in robot.cables])
    weight = GRAVITY * sum(body.mass for body in robot.bodies)
    return np.maximum(weight / stiff, _at_keyframe(robot) - kept)


def _at_keyframe(robot: Robot) -> Floats:
    """(C,) lengths of the cables at the keyframe [m]."""
    return robot.cable_lengths(robot.keyframe.qpos.reshape(1, -1, FREE))[0]


def _limits(
    robot: Robot, rest: Floats, relative: NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats, Floats]:
    """(C,) `pulled`, `limit`, `lowest` and `highest` of each cable, as in Evidence [m]."""
    kept = np.array([cable.rest_length for cable in robot.cables])
    lowest, highest = kept.copy(), kept.copy()
    for winch in robot.winches:
        for cable, ratio in zip(winch.cables, winch.ratios, strict=True):
            ends = ratio * (np.array(winch.rest_range) - kept[winch.cables[0]])
            lowest[cable], highest[cable] = kept[cable] + ends.min(), kept[cable] + ends.max()
    at_keyframe, pull = _at_keyframe(robot), PULLED * stretch(robot)
    # A winch may pay out another length than it is told or measures.
    gain = np.where(relative, 0.0, GAIN * np.median(np.abs(rest - kept), axis=0))
    return pull, pull + MISPLACED * at_keyframe + gain, lowest, highest


def _on_line(robot: Robot, end: Attachment) -> tuple[Floats | None, float]:
    """(n,) weights of the body's points that give the end's place, and how far it may be from there [m].

    None where the body's points tell its whole pose.
    """
    if end.body < 0:
        return None, 0.0
    offsets = robot.offsets_of(robot.bodies[end.body])
    here, size = offsets - offsets.mean(axis=0), np.linalg.norm(offsets - offsets.mean(axis=0))
    if np.linalg.matrix_rank(here, tol=max(STRAIGHT * float(size), 1e-12)) > 1:
        return None, 0.0
    weights = np.linalg.pinv(here.T, rcond=STRAIGHT) @ (end.offset - offsets.mean(axis=0))
    weights = 1 / len(offsets) + weights - weights.mean()
    return weights, float(np.linalg.norm(weights @ offsets - end.offset))


def _place(robot: Robot, points: Floats, end: Attachment) -> Floats:
    """(n, 3) where a cable ends that is between points (n, P, 3) [m]."""
    if end.body < 0:
        return np.broadcast_to(end.offset, (len(points), 3))
    own = points[:, list(robot.bodies[end.body].points)]
    weights, _ = _on_line(robot, end)
    if weights is not None:
        return np.asarray(np.einsum("k,nkd->nd", weights, own))
    offsets = robot.offsets_of(robot.bodies[end.body])
    middle, center = offsets.mean(axis=0), own.mean(axis=1)
    turn = kabsch(offsets - middle, own - center[:, None])
    return np.asarray(center + rotate(turn, end.offset - middle))
