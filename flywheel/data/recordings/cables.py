"""Cables as witnesses: their lengths between measured points are what winches and MJCF allow, or the log is
in another frame than the MJCF, or under wrong names.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.geometry import pairs
from flywheel.data.recordings.pieces import distance
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.tables.columns import Log
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import GRAVITY, Attachment, Robot
from flywheel.rotations import cross, kabsch, rotate, unit

ROWS = 400  # rows that are looked at
FEWEST = 20  # rows that say something
MISPLACED = (
    0.05  # share of a cable's length at the keyframe: its ends may be elsewhere than the MJCF says
)
PULLED = 3.0  # weights of the robot, or tensions at the keyframe, that no cable usually bears
GAIN = (
    0.3  # share of what a winch has moved since the keyframe that it may have moved less, or more
)
ALIKE = 0.01  # relative: two distances on bodies that no log tells apart
FREE = 7  # numbers of a free body's pose
STRAIGHT = 1e-6  # share of a body's size: its points are on one line
CLEARLY = 0.3  # an other explanation leaves at most this share of what is unexplained
FITS = 0.2  # and at most this share of the cables' motion
BETTER = 0.5  # names that leave at most this share of what others leave are the right ones
POOR = 0.2  # share of the cables' motion that is left where an explanation may be doubted
BALANCED_ROWS = 40  # rows from which mean forces are taken
UNHELD = 0.1  # share of the weight that may be held by nothing, for all that is wrong with an MJCF
HANGING = 0.1  # height above the ground at which nothing stands on it, in L
MORE = 1.5  # times a winch's strongest pull that no load cell shows by its own error
UNITS = 3.0  # times as long, or short: no cable is so wrong, its unit is
AXES = "xyz"


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
        rest, relative = _rest_lengths(log, robot, rows)
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


def check_frame(evidence: Evidence | None) -> list[Finding]:
    """Findings about single cables that the points contradict.

    Raises:
      DataError: the cables from fixed points say that the log has other axes, or another origin.
    """
    if evidence is None:
        return []
    points, why = evidence.points, evidence.wrong(evidence.points)
    axes = _exchanged(evidence) or _better_axes(evidence, bool(why))
    if why or axes:
        why = why or "the cables' lengths do not change as the winches made them"
        hint = f" {axes}" if axes else ""
        raise DataError(
            f"the points do not fit the cables from fixed points: {why}. Which of the log's axes points "
            f"up, and where is its origin?{hint} See axes and origin of the map."
        )
    long = evidence.too_long(points)
    words = "usually {:.3g} m longer than it can be: is it cut or hung elsewhere, or {}?"
    other = np.where(evidence.fixed, "the frame wrong", "a marker or its axes wrong")
    return [
        Finding(
            "cable",
            "noted",
            evidence.robot.cables[i].name,
            0,
            words=words.format(long[i], other[i]),
        )
        for i in np.flatnonzero(long > 0)
    ]


def better_names(
    evidence: Evidence, others: Iterable[NDArray[np.int64]]
) -> NDArray[np.int64] | None:
    """The other order (P,) of the points with which the cables fit clearly better; None if there is none.

    Args:
      evidence: of the points in their present order.
      others: the orders that are possible.
    """
    here = evidence.unexplained(evidence.points)
    tried = [(evidence.unexplained(evidence.points[:, order]), tuple(order)) for order in others]
    best, order = min(tried, default=(np.inf, ()))
    return np.array(order) if best < BETTER * here else None


def alike(robot: Robot) -> list[NDArray[np.int64]]:
    """Orders (P,) in which two points of a body, or two bodies, are exchanged that are alike."""
    found, own = [], np.arange(len(robot.points))
    for first, one in enumerate(robot.bodies):
        for a, b in combinations(one.points, 2):
            found.append(own.copy())
            found[-1][[a, b]] = [b, a]
        for other in robot.bodies[first + 1 :]:
            if len(one.points) == len(other.points) > 0:
                found.append(own.copy())
                found[-1][[*one.points, *other.points]] = [*other.points, *one.points]
    rods = pairs(robot)
    apart = {(rod.a, rod.b): rod.distance for rod in rods}

    def same(order: NDArray[np.int64]) -> bool:
        there = [apart.get((min(a, b), max(a, b))) for a, b in order[[[r.a, r.b] for r in rods]]]
        return all(
            d is not None and abs(d / rod.distance - 1) < ALIKE
            for d, rod in zip(there, rods, strict=True)
        )

    return [order for order in found if not rods or same(order)]


def _clearly(here: float, there: float, motion: float) -> bool:
    """One explanation leaves much, another one hardly anything."""
    return here > POOR * motion and there < CLEARLY * here and there < FITS * motion


def _exchanged(evidence: Evidence) -> str:
    """The points whose exchange would make the cables fit, as a sentence; "" if there are none."""
    here, motion = evidence.unexplained(evidence.points), evidence.motion()
    order = better_names(evidence, alike(evidence.robot)) if here > POOR * motion else None
    if order is None or not _clearly(here, evidence.unexplained(evidence.points[:, order]), motion):
        return ""
    names = [point.name for point in evidence.robot.points]
    told = [f"{names[i]} with {names[j]}" for i, j in enumerate(order) if i < j]
    columns = f"the columns of {listed(told)} were exchanged in the map"
    return f"They would fit if {columns}, or the commands of their winches."


def _better_axes(evidence: Evidence, impossible: bool) -> str:
    """The names of the log's axes with which the cables would fit, as a sentence; "" if no others do."""
    here, motion = evidence.unexplained(evidence.points), evidence.motion()
    if not evidence.fixed.any() or not (impossible or here > POOR * motion):
        return ""
    found = []
    for axes, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turned = evidence.points[..., axes] * signs
        if not evidence.wrong(turned):
            told = [
                f"{a}: {'-' if s < 0 else ''}{AXES[b]}"
                for a, b, s in zip(AXES, axes, signs, strict=True)
            ]
            mirrored = np.linalg.det(np.eye(3)[list(axes)] * signs) < 0
            found.append((evidence.unexplained(turned), mirrored, ", ".join(told)))
    if not found:
        return ""
    best, _, axes_told = min(found)
    if not _clearly(here, best, motion):
        return ""
    # A flat motion fits a mirrored frame, too: the one that a map may have is meant.
    near = [each for each in sorted(found) if each[0] < 2 * best and not each[1]]
    if near:
        return f"With axes: {{{near[0][2]}}} they would fit."
    return f"They would fit if the log were mirrored: {{{axes_told}}}."


def check_channels(log: Log, points: Floats, robot: Robot) -> list[Finding]:
    """Compare measured lengths of cables with those between points (N, P, 3) [m], and tensions with zero.

    Returns:
      Notes on tensions that are much more than their cables' stiffness or winches give.

    Raises:
      DataError: a length is in another unit, or a tension pushes.
    """
    found = []
    rows = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)) & robot.free)[:ROWS]
    names = [cable.name for cable in robot.cables]
    for channel in log.channels:
        known = channel.values[np.isfinite(channel.values)]
        got = float(np.median(known)) if len(known) else np.nan
        if channel.kind == "tension" and got < 0:
            raise DataError(
                f"the tension of {channel.name!r} is usually {got:.4g} N, but cables pull: if the log has "
                "tensions below 0, write units: {tension: -N}."
            )
        if channel.kind == "tension" and len(known) and len(rows):
            index = names.index(channel.name)
            if words := _beyond(got, log, points, robot, rows, index):
                found.append(
                    Finding("channel", "noted", f"tension.{channel.name}", len(known), words=words)
                )
        if channel.kind == "length" and len(known) and len(rows):
            between = lengths_between(points[rows], robot)[:, names.index(channel.name)]
            wanted = float(np.median(between))
            if not wanted / UNITS < got < wanted * UNITS:
                raise DataError(
                    f"the length of {channel.name!r} is usually {got:.4g} m, between its points it is "
                    f"{wanted:.4g} m: is its unit right (units: {{length: mm}})?"
                )
    return found


def _beyond(
    tension: float, log: Log, points: Floats, robot: Robot, rows: NDArray[np.int64], index: int
) -> str:
    """A sentence on a usual tension [N] that a cable can hardly have; "" for any other."""
    cable, words = robot.cables[index], f"is usually {tension:.4g} N, but "
    rest, relative = _rest_lengths(log, robot, rows)
    if tension > MORE * cable.strongest:
        return f"{words}its winch pulls {cable.strongest:.4g} N at most: is its unit right?"
    if not cable.stiffness or relative[index]:
        return ""
    longer = float(np.median((lengths_between(points[rows], robot) - rest)[:, index]))
    if tension / cable.stiffness <= max(longer, 0.0) + PULLED * stretch(robot)[index]:
        return ""
    return (
        f"{words}the cable is {1000 * longer:.3g} mm longer than its rest length, which is "
        f"{max(longer, 0.0) * cable.stiffness:.3g} N by its stiffness: is its unit right?"
    )


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


def _rest_lengths(
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
