"""A robot's symmetries: orders of its points and winches in which it is the same robot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from flywheel.robots.parts import Body, Cable
from flywheel.robots.robot import Robot
from flywheel.rotations import kabsch, rotate

ALIKE = 0.01  # distance of parts that take each other's places, at most [fraction of the length]
MOST = 1000  # orders of the points that are looked at; an icosahedron has 60 turns

Kind = tuple[object, ...]  # numbers of a cable and its winch


@dataclass(frozen=True)
class Symmetries:
    """Orders of a robot's parts in which it is the same robot; the first is the given one.

    Attributes:
      points: (S, P) the tracked point at each place, in each order.
      winches: (S, W) the winch at each place.
    """

    points: NDArray[np.int64]
    winches: NDArray[np.int64]


def symmetries_of(robot: Robot) -> Symmetries:
    """The symmetries of a robot; the given order alone if it hangs on the world, or has joints.

    Cables, winches and bodies take places of others with the same numbers. Within a body, points and ends of
    cables may then be up to `ALIKE` beside their places.
    """
    points, winches = [tuple(range(len(robot.points)))], [tuple(range(len(robot.winches)))]
    if robot.free and not robot.tethered and all(body.points for body in robot.bodies):
        for order in islice(_orders(robot, _kinds(robot), ()), MOST):
            cables = _cables(robot, order)
            found = tuple(robot.cables[cables[winch.cables[0]]].winch for winch in robot.winches)
            driven = [tuple(cables[i] for i in winch.cables) for winch in robot.winches]
            alike = driven == [robot.winches[w].cables for w in found] and order != points[0]
            if alike and all(_fits(robot, body, order, cables) for body in robot.bodies):
                points.append(order)
                winches.append(found)
    return Symmetries(np.array(points), np.array(winches).reshape(len(points), -1))


def _kind(robot: Robot, cable: Cable) -> Kind:
    kind: Kind = cable.stiffness, cable.damping, cable.rest_length
    if cable.winch >= 0:
        winch = robot.winches[cable.winch]
        kind += winch.kind, winch.control_range, winch.rest_range, winch.time_constant, winch.ratios
    return kind


def _kinds(robot: Robot) -> dict[tuple[int, int], list[Kind]]:
    """Kinds of the cables between each two points."""
    found: dict[tuple[int, int], list[Kind]] = {}
    for cable in robot.cables:
        first, second = (end.point for end in cable.ends)
        for pair in {(first, second), (second, first)}:
            found.setdefault(pair, []).append(_kind(robot, cable))
    return {pair: sorted(kinds, key=repr) for pair, kinds in found.items()}


def _orders(
    robot: Robot, kinds: dict[tuple[int, int], list[Kind]], begun: tuple[int, ...]
) -> Iterator[tuple[int, ...]]:
    """Orders of the points that begin so, with the same bodies and cables."""
    if (new := len(begun)) == len(robot.points):
        yield begun
        return
    for point in (i for i in range(len(robot.points)) if i not in begun):
        if robot.points[point].radius == robot.points[new].radius and all(
            abs(_apart(robot, new, old) - _apart(robot, point, there)) <= ALIKE * robot.length
            and kinds.get((new, old)) == kinds.get((point, there))
            for old, there in enumerate((*begun, point))
        ):
            yield from _orders(robot, kinds, (*begun, point))


def _apart(robot: Robot, first: int, second: int) -> float:
    """Distance of two points of one body; below 0 for those of different bodies."""
    one, other = robot.points[first], robot.points[second]
    return math.dist(one.offset, other.offset) if one.body == other.body else -robot.length


def _cables(robot: Robot, order: Sequence[int]) -> list[int]:
    """For each cable, the one at its place in an order of the points."""
    taken: list[int] = []
    for cable in robot.cables:
        ends, kind = sorted(order[end.point] for end in cable.ends), _kind(robot, cable)
        taken += [
            index
            for index, other in enumerate(robot.cables)
            if sorted(end.point for end in other.ends) == ends
            and _kind(robot, other) == kind
            and index not in taken
        ][:1]
    return taken


def _fits(robot: Robot, body: Body, order: Sequence[int], cables: Sequence[int]) -> bool:
    """True if the body at the place of another has its mass, and its parts where the other has them."""
    other = robot.bodies[robot.points[order[body.points[0]]].body]
    places = [(body.com, other.com)]
    places += [(robot.points[p].offset, robot.points[order[p]].offset) for p in body.points]
    for cable, index in zip(robot.cables, cables, strict=True):
        its = {end.point: end.offset for end in robot.cables[index].ends}
        own = (end for end in cable.ends if robot.bodies[end.body] is body)
        places += [(end.offset, its[order[end.point]]) for end in own]
    first, second = (np.array(each) for each in zip(*places, strict=True))
    middles = first.mean(axis=0), second.mean(axis=0)
    turn = kabsch(first - middles[0], second - middles[1])
    beside = rotate(turn, first - middles[0]) + middles[1] - second
    axes = rotate(turn, body.principal.T).T
    inertia = axes @ np.diag(body.inertia) @ axes.T
    wanted = other.principal @ np.diag(other.inertia) @ other.principal.T
    slack = ALIKE * other.inertia.max()
    return bool(
        np.isclose(body.mass, other.mass, rtol=ALIKE)
        and np.abs(beside).max() <= ALIKE * robot.length
        and np.abs(inertia - wanted).max() <= slack
    )
