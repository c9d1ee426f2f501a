"""Which of several orders of the markers is the one of their names, where the log has more than one."""

from __future__ import annotations

from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from flywheel.data.recordings.cables import better_names
from flywheel.data.recordings.evidence import Evidence
from flywheel.data.recordings.geometry import pairs, usual_distances
from flywheel.data.recordings.repair.markers import Tracked
from flywheel.errors import DataError
from flywheel.robots import Robot

LONG = 0.02  # least share of the rows of an order that may be the right one
SAME = 0.05  # relative: distances on a body in another order agree with the MJCF's
OFTEN = 10  # changes of the order from which the beginning is no more likely right than another row
SURE = 3.0  # standard deviations by which the commonest order must be so by more than chance


def named(tracked: Tracked, evidence: Evidence | None, robot: Robot) -> Tracked:
    """Points under their own names, as far as these follow from what is under which name when.

    The beginning of the log is taken to be right, unless the cables tell otherwise, or the names change
    so often that the commonest order is the right one.

    Raises:
      DataError: they change often, and nothing tells which order is right.
    """
    orders, share = _common(tracked)
    may = [_same_distances(tracked, np.argsort(order), robot) for order in orders]
    orders, share = list(compress(orders, may)), list(compress(share, may))
    if not orders:
        return tracked
    best = better_names(evidence, map(np.argsort, orders)) if evidence else None
    if best is None and (evidence is None or not evidence.certain):
        best = _commonest(tracked, orders, share, robot)
    return tracked if best is None else _renamed(tracked, best)


def _common(tracked: Tracked) -> tuple[list[NDArray[np.int64]], list[float]]:
    """The orders (P,), other than that of the names, of many rows, and their shares of the rows."""
    own = np.arange(tracked.partner.shape[1])
    if (tracked.partner == own).all():
        return [], []
    found, count = np.unique(tracked.partner, axis=0, return_counts=True)
    share = count / len(tracked.partner)
    kept = (share >= LONG) & (found != own).any(axis=1)
    return [each.astype(np.int64) for each in found[kept]], share[kept].tolist()


def _same_distances(tracked: Tracked, order: NDArray[np.int64], robot: Robot) -> bool:
    """The points in an order (P,) are as far apart as the MJCF says."""
    rods = pairs(robot)
    usual = usual_distances(tracked.points[:, order], rods) / [rod.distance for rod in rods]
    return not (np.abs(usual - 1) > SAME).any()


def _commonest(
    tracked: Tracked, orders: list[NDArray[np.int64]], share: list[float], robot: Robot
) -> NDArray[np.int64] | None:
    """The order to bring the points to so that their names are right in most rows; None if they are.

    Raises:
      DataError: two orders are about as common, and change often.
    """
    changes = int((tracked.partner[1:] != tracked.partner[:-1]).any(axis=1).sum())
    if changes < OFTEN:
        return None
    own = np.arange(len(robot.points))
    as_named = float((tracked.partner == own).all(axis=1).mean())
    ranked = sorted([(as_named, tuple(own)), *zip(share, map(tuple, orders), strict=True)])[::-1]
    (most, first), (next_, second) = ranked[:2]
    if (most - next_) * np.sqrt(changes) < SURE * np.sqrt(most + next_):
        names = [robot.points[i].name for i in own if first[i] != second[i]]
        raise DataError(
            f"{' and '.join(names)} are exchanged from row to row, {changes} times in all; neither their "
            f"distances nor the cables tell which is which, and two orders are about as common ({most:.0%} "
            f"and {next_:.0%} of the rows). Can the tracker tell these markers apart?"
        )
    return None if first == tuple(own) else np.argsort(first)


def _renamed(tracked: Tracked, order: NDArray[np.int64]) -> Tracked:
    """The same with the points in another order (P,)."""
    partner = tracked.partner[:, order]
    points, doubtful = tracked.points[:, order], tracked.doubtful[:, order]
    right = np.isfinite(points[..., 0]) & ~doubtful
    return replace(
        tracked,
        points=points,
        ordered=tracked.ordered[:, order],
        exchanged=(partner != np.arange(len(order))) & right,
        partner=partner,
        doubtful=doubtful,
        leaps=tracked.leaps[:, order],
        rods=tracked.rods[:, order],
    )
