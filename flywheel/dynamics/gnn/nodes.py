"""Nodes of a robot's graph: body nodes, the world's anchors of cables, and the ground."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from flywheel.effects import Scales
from flywheel.errors import ModelError
from flywheel.records import Floats
from flywheel.robots import Body, Primitive, Robot

_SAME = 1e-6  # share of the robot's length: offsets closer than this are one place
_MEANT = 1e-3  # spread of a feature column below which it is rounding
_LONG = 0.75  # share of the robot's length that a rod's cylinder has at least


@dataclass(frozen=True)
class BodyNode:
    """A node that moves with a body.

    Attributes:
      body: index into `Robot.bodies`.
      offset: (3,) in the body frame [m].
      radius: of the contact sphere there [m].
      mass: of the represented piece [kg].
      inertia: (3,) of that piece [kg m^2].
      point: index of its tracked point, -1 for none.
    """

    body: int
    offset: Floats
    radius: float
    mass: float
    inertia: Floats
    point: int


def body_nodes(robot: Robot, decomposition: str) -> tuple[BodyNode, ...]:
    """The nodes of every body, in the order of the bodies.

    Every tracked point is a node, so that the nodes of a body determine at least as much of its pose
    as its tracked points do.

    Raises:
      ModelError: a body has no tracked point, so its pose is unknown.
    """
    nodes: list[BodyNode] = []
    for index, body in enumerate(robot.bodies):
        if not body.points:
            raise ModelError(
                f"Body {body.name!r} of robot {robot.name} has no tracked point, so a network "
                "cannot know its pose; add a framepos sensor on a site of it to the MJCF."
            )
        pieces = _pieces(robot, index, body) if decomposition == "primitives" else []
        found = {node.point for node in pieces}
        bare = [p for p in body.points if p not in found]
        share = 1.0 if pieces else 1.0 / len(bare)
        nodes += pieces
        for p in bare:
            point = robot.points[p]
            mass, inertia = share * body.mass, share * np.asarray(body.inertia)
            nodes.append(BodyNode(index, np.asarray(point.offset), point.radius, mass, inertia, p))
    return tuple(nodes)


def _pieces(robot: Robot, index: int, body: Body) -> list[BodyNode]:
    """One node per geometric piece; a piece centred on a tracked point is that point's node."""
    free = list(body.points)
    nodes = []
    for primitive in body.primitives:
        for piece in _thirds(primitive, robot.length):
            near = [
                p
                for p in free
                if np.linalg.norm(robot.points[p].offset - piece.offset) < _SAME * robot.length
            ]
            if near:
                free.remove(near[0])
            touches = piece.collides and piece.shape in ("sphere", "capsule", "cylinder")
            nodes.append(
                BodyNode(
                    body=index,
                    offset=np.asarray(piece.offset),
                    radius=float(piece.size[0]) if touches else 0.0,
                    mass=piece.mass,
                    inertia=np.asarray(piece.inertia),
                    point=near[0] if near else -1,
                )
            )
    return nodes


def _thirds(piece: Primitive, length: float) -> list[Primitive]:
    """A cylinder or capsule nearly as long as the robot counts as three pieces in a row."""
    if piece.shape not in ("capsule", "cylinder") or 2.0 * piece.size[1] < _LONG * length:
        return [piece]
    step = 2.0 / 3.0 * piece.size[1] * np.asarray(piece.axis)
    mass = piece.mass / 3.0
    across = (
        np.asarray(piece.inertia) / 3.0 - mass * (step @ step) * np.array([2.0, 2.0, 0.0]) / 3.0
    )
    inertia = np.maximum(across, 0.0)
    return [
        dataclasses.replace(piece, offset=piece.offset + k * step, mass=mass, inertia=inertia)
        for k in (-1, 0, 1)
    ]


def anchors(robot: Robot) -> tuple[Floats, ...]:
    """Positions in the world [m], (3,) each, of cable ends; several cables may share one."""
    places: list[Floats] = []
    for cable in robot.cables:
        for end in cable.ends:
            if end.body < 0 and find(places, end.offset, robot.length) < 0:
                places.append(np.asarray(end.offset))
    return tuple(places)


def find(places: list[Floats] | tuple[Floats, ...], place: Floats, length: float) -> int:
    """Index of `place` among `places`, -1 if missing."""
    for index, other in enumerate(places):
        if np.linalg.norm(other - place) < _SAME * length:
            return index
    return -1


def node_constants(robot: Robot, nodes: tuple[BodyNode, ...]) -> Floats:
    """(N, 8) constants of a node: inverse mass, inverse inertia, offset, distance to CoM.

    Mass and inertia enter as logarithms relative to the robot's mean, lengths relative to its
    length. Each column is standardised over the nodes; a column with equal values is uninformative
    and 0.
    """
    mass = sum(body.mass for body in robot.bodies) / len(nodes)
    floor = 1e-6
    rows = []
    for node in nodes:
        arm = (node.offset - robot.bodies[node.body].com) / robot.length
        inertia = np.asarray(node.inertia) / (mass * robot.length**2)
        rows.append(
            np.concatenate(
                [
                    [-np.log(max(node.mass / mass, floor))],
                    -np.log(np.maximum(inertia, floor**2)),
                    arm,
                    [np.linalg.norm(arm)],
                ]
            )
        )
    return standardised(np.array(rows))


def cable_constants(robot: Robot) -> Floats:
    """(C, 3) constants of a cable: stiffness, damping, and how far it moves with its winch.

    The first two are logarithms in units of the robot's weight, length and natural time. Each column is
    standardised over the cables.
    """
    scales = Scales.of(robot)
    force = np.array([(c.stiffness, c.damping / scales.time) for c in robot.cables]).reshape(-1, 2)
    logs = np.log(np.maximum(force * robot.length / scales.weight, 1e-6))
    return standardised(np.column_stack([logs, robot.ratios]))


def standardised(table: Floats) -> Floats:
    """Columns with mean 0 and standard deviation 1 over the rows; constant columns become 0.

    Numbers of order 1, with rounding residues set to zero.
    """
    spread = table.std(axis=0)
    size = np.maximum(np.abs(table).max(axis=0, initial=0.0), _MEANT)
    varies = spread > 1e-6 * size
    return np.where(varies, (table - table.mean(axis=0)) / np.where(varies, spread, 1.0), 0.0)
