"""Checks by the cables: of the log's frame, of the names of its points, and of its tensions and lengths."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.evidence import (
    FITS,
    PULLED,
    ROWS,
    Evidence,
    lengths_between,
    rest_lengths,
    stretch,
)
from flywheel.data.recordings.geometry import pairs
from flywheel.data.recordings.report import Finding, listed
from flywheel.data.recordings.tables.columns import Log
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot

ALIKE = 0.01  # relative: two distances on bodies that no log tells apart
CLEARLY = 0.3  # an other explanation leaves at most this share of what is unexplained
BETTER = 0.5  # names that leave at most this share of what others leave are the right ones
POOR = 0.2  # share of the cables' motion that is left where an explanation may be doubted
MORE = 1.5  # times a winch's strongest pull that no load cell shows by its own error
UNITS = 3.0  # times as long, or short: no cable is so wrong, its unit is
AXES = "xyz"


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
    rest, relative = rest_lengths(log, robot, rows)
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
