"""Network inputs: the features of nodes and edges, from a state and controls.

Arrays are component-major: (F, M, K) for F features of M nodes or edges of K samples, so that every
feature is one contiguous plane. All features are invariant to horizontal translation. With
`yaw_frame` their axes turn with the robot's heading, so they are invariant to yaw as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flywheel.dynamics.gnn.attachments import Attachments
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.loads import CableLoads
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.dynamics.rigid_bodies.ground import Ground, flat_ground
from flywheel.robots import GRAVITY, Robot

DEPTH = 1e-3  # clearance from which its logarithm is shown, as a fraction of the robot's length


@dataclass(frozen=True)
class Field:
    """Neighbouring features of one kind.

    Attributes:
      width: number of features.
      scale: their natural size, in SI units; the divisor before any data is available.
      fitted: normalised by the data. Unit vectors are not.
    """

    width: int
    scale: float
    fitted: bool = True


def feature_fields(robot: Robot, config: NetworkConfig) -> dict[str, tuple[Field, ...]]:
    """The changing features of each kind of node and edge, in their order."""
    length = robot.length
    speed = (GRAVITY * length) ** 0.5
    clearance = Field(1, config.ground_clamp * length)
    unit = Field(3, 1.0, fitted=False)
    exact = config.cable_ends == "attachments"
    at_ends = (Field(3, length), Field(3, length), Field(2, 1.0)) if exact else ()
    place = (Field(3, length), Field(1, length), Field(3, length), unit)
    return {
        "body_node": (
            Field(3, speed),
            clearance,
            *(place if config.config_features else ()),
            *((Field(1, 1.0), Field(3, 1.0)) if config.load_features else ()),
        ),
        "anchor_node": (Field(3, length), Field(1, length)),
        "ground_node": (unit,),
        "body": (Field(3, length),),
        "cable": (
            Field(3, length),
            Field(1, length),
            unit,
            Field(1, speed),
            Field(1, length),
            Field(1, 0.1 * length),
            *at_ends,
        ),
        "contact": (clearance, unit, Field(3, speed), Field(1, speed)),
    }


@dataclass(frozen=True)
class MechanicalState:
    """Positions of the bodies, in a frame whose origin moves with the robot.

    Attributes:
      frames: (3, F, K) rigid frames [m, -].
      velocities: (3, N, K) of the body nodes [m/s].
      winch: (W, K) winch positions [m].
      sides: (3, R, K) rolls of the rods, see `Attachments`; None if cables end at nodes, and in a
        past without cables.
    """

    frames: Tensor
    velocities: Tensor
    winch: Tensor
    sides: Tensor | None = None


@dataclass(frozen=True)
class GraphFeatures:
    """All inputs of one call of the network.

    Attributes:
      nodes: changing features (F, M, K) of "body_node", "anchor_node", "ground_node".
      edges: changing features (F, E, K) of "body", "cable", "contact".
      controls: (W, K, h + n) past and future controls in units of their range.
      touching: (N k, K) 1 for a body node within contact distance of the ground, then of the nearest box, and
        so on; else 0. k is `surfaces`.
      dataset: (K,) or (1,) index of the data set.
    """

    nodes: dict[str, Tensor]
    edges: dict[str, Tensor]
    controls: Tensor
    touching: Tensor
    dataset: Tensor


def turn(vectors: Tensor, heading: Tensor) -> Tensor:
    """Express `vectors` (3, ..., K) in axes turned by the angle whose (cos, sin) is `heading` (2, K)."""
    cos, sin = heading
    x, y, z = vectors
    return torch.stack([cos * x + sin * y, cos * y - sin * x, z])


def turn_back(vectors: Tensor, heading: Tensor) -> Tensor:
    """The inverse of `turn`."""
    cos, sin = heading
    x, y, z = vectors
    return torch.stack([cos * x - sin * y, cos * y + sin * x, z])


@dataclass(frozen=True)
class _Ends:
    """Positions and velocities of the cables' ends, (3, 2 C, K) each."""

    places: Tensor
    velocities: Tensor


@dataclass(frozen=True)
class _View:
    """A state in the axes of the features; (3, N, K) each but the clearance (N k, K) from each of k surfaces,
    their normals (3, N k, K), and anchors.

    `ends` is None if cables end at nodes. `loads` are the nodes' accelerations by cables and gravity; None if
    they are not shown.
    """

    nodes: Tensor
    arms: Tensor
    axes: Tensor
    velocities: Tensor
    anchors: Tensor
    clearance: Tensor
    normal: Tensor
    ends: _Ends | None
    loads: Tensor | None


class FeatureBuilder:
    """Computes features on one robot's graph.

    Args:
      graph: the robot's graph.
      frames: layout of its rigid frames.
      attachments: of its cables; used for states with sides.

    Attributes:
      loads: accelerations by the cables.
    """

    def __init__(self, graph: RobotGraph, frames: Frames, attachments: Attachments) -> None:
        self._graph, self._config = graph, graph.config
        self._length, self._count = graph.robot.length, graph.body_count
        self._first, self._second = graph.designated
        self._maps = torch.cat([frames.to_nodes, frames.to_arms, frames.to_axes])
        eye = torch.eye(graph.count, device=graph.device)[:, : self._count + graph.anchors.shape[1]]
        self._apart = {
            name: eye[relation.senders] - eye[relation.receivers]
            for name, relation in graph.relations.items()
        }
        self._attachments, self.loads = attachments, CableLoads(graph, frames, attachments)
        sender = graph.relations["cable"].origin  # edges are numbered as the ends they start at
        self._ends = sender, sender ^ 1
        if "contact" in graph.relations:
            relation = graph.relations["contact"]
            self._contact = relation.origin % graph.contact_count, relation.constants

    def heading(self, state: MechanicalState) -> Tensor | None:
        """(2, K) cos and sin of the robot's heading; None if features are in world axes."""
        if not self._graph.turning:
            return None
        first, second = torch.matmul(
            self._maps[[self._first, self._second]], state.frames[:2]
        ).unbind(1)
        way = second - first
        size = (way * way).sum(0).clamp(min=1e-18).sqrt()
        east = torch.stack([torch.ones_like(size), torch.zeros_like(size)])
        return torch.where(
            size > 1e-3 * self._length, way / size, east
        )  # a vertical robot has none

    def memory_features(
        self, state: MechanicalState, origin: Tensor, ground: Ground = flat_ground
    ) -> Tensor:
        """Features of the body nodes alone, (F, N, K): the LSTM's input in a measured past."""
        return self._node_features(self._view(state, origin, self.heading(state), ground))

    def __call__(
        self,
        state: MechanicalState,
        origin: Tensor,
        heading: Tensor | None,
        controls: Tensor,
        dataset: Tensor,
        ground: Ground = flat_ground,
    ) -> GraphFeatures:
        """All features of one call.

        Args:
          state: positions of the bodies.
          origin: (2, K) horizontal position of the state's origin in the world [m].
          heading: of the state.
          controls: (W, K, h + n) in units of their range.
          dataset: (K,) or (1,) index of the data set.
          ground: below the robot.
        """
        view = self._view(state, origin, heading, ground)
        nodes = {"body_node": self._node_features(view)}
        if view.anchors.shape[1]:
            place = view.anchors - view.nodes[:, self._first, None]
            nodes["anchor_node"] = torch.cat([place, _norm(place)])
        edges = {}
        if "body" in self._apart:
            edges["body"] = torch.matmul(self._apart["body"], self._places(view))
        edges["cable"] = self._cable_features(view, state.winch)
        if self._graph.ground >= 0:
            row = self._first % view.normal.shape[1]
            nodes["ground_node"] = view.normal[:, row : row + 1]
            edges["contact"] = self._contact_features(view)
        touching = (view.clearance < self._config.contact_threshold * self._length).to(
            view.clearance.dtype
        )
        return GraphFeatures(nodes, edges, controls, touching, dataset)

    def _view(
        self, state: MechanicalState, origin: Tensor, heading: Tensor | None, ground: Ground
    ) -> _View:
        vectors = torch.matmul(self._maps, state.frames)
        nodes = vectors[:, : self._count]
        clearance, normal = self._clearance(nodes, origin, ground)
        anchors = self._graph.anchors_from(origin, nodes.shape[-1])
        velocities, ends, loads = state.velocities, None, None
        if state.sides is not None:
            ends = self._ends_of(state, origin)
        if self._config.load_features:
            loads = (
                torch.zeros_like(nodes)
                if ends is None
                else self.loaded(state, origin, ends).asinh()
            )
        if heading is not None:
            vectors, velocities, anchors = (
                turn(v, heading) for v in (vectors, velocities, anchors)
            )
            normal = turn(normal, heading)
            if ends is not None:
                ends = _Ends(turn(ends.places, heading), turn(ends.velocities, heading))
            if loads is not None:
                loads = turn(loads, heading)
        nodes, arms, axes = vectors.split(self._count, dim=1)
        return _View(nodes, arms, axes, velocities, anchors, clearance, normal, ends, loads)

    def loaded(self, state: MechanicalState, origin: Tensor, ends: _Ends | None = None) -> Tensor:
        """(3, N, K) accelerations of the body nodes by cables and gravity alone [g], in world axes.

        Args:
          state: with the sides of its rods.
          origin: (2, K) horizontal position of the state's origin in the world [m].
          ends: of the cables, if they are known.
        """
        ends = ends or self._ends_of(state, origin)
        arms = torch.matmul(self._maps[self._count : 2 * self._count], state.frames)
        rest = self._attachments.rest(state.winch)
        return self.loads.accelerations(state.frames, arms, ends.places, ends.velocities, rest)

    def _ends_of(self, state: MechanicalState, origin: Tensor) -> _Ends:
        """The cables' ends, in world axes."""
        assert state.sides is not None
        places, across = self._attachments.positions(state.frames, state.sides, origin)
        return _Ends(places, self._attachments.velocities(state.frames, across, state.velocities))

    def _clearance(self, nodes: Tensor, origin: Tensor, ground: Ground) -> tuple[Tensor, Tensor]:
        """Distances (N k, K) of the nodes from the ground and the nearest boxes, and normals (3, N k, K)."""
        if not self._graph.robot.grounded:
            none = torch.zeros_like(nodes[2])
            return none, none.expand(3, -1, -1)
        height, normal = ground(nodes[:2] + origin[:, None])
        clearance = (nodes[2] - height) * normal[2] - self._graph.radius
        if self._config.surfaces == 1:
            return clearance, normal.expand(3, -1, nodes.shape[-1])
        places = torch.cat([nodes[:2] + origin[:, None], nodes[2:]])
        away, beside = ground.nearest(places.detach(), self._config.surfaces - 1)
        moved = ((places - places.detach())[:, None] * beside).sum(
            0
        )  # zero; the distance's gradient
        more = (away + moved - self._graph.radius).flatten(0, 1)
        return torch.cat([clearance, more]), torch.cat(
            [normal.expand_as(nodes), beside.flatten(1, 2)], dim=1
        )

    def _node_features(self, view: _View) -> Tensor:
        clearance = view.clearance[: self._count]
        parts = [view.velocities, self._seen(clearance)]
        if self._config.config_features:
            place = view.nodes - view.nodes[:, self._first, None]
            parts += [place, _norm(place), view.arms, view.axes]
        if view.loads is not None:
            # What the ground bears lies within millimetres: too little to be seen beside the clearance.
            parts += [torch.asinh(clearance / (DEPTH * self._length))[None], view.loads]
        return torch.cat(parts)

    def _seen(self, clearance: Tensor) -> Tensor:
        return clearance.clamp(max=self._config.ground_clamp * self._length)[None]

    def _places(self, view: _View) -> Tensor:
        return torch.cat([view.nodes, view.anchors], dim=1) if view.anchors.shape[1] else view.nodes

    def _cable_features(self, view: _View, winch: Tensor) -> Tensor:
        graph, apart = self._graph, self._apart["cable"]
        at_ends: tuple[Tensor, ...] = ()
        if view.ends is not None:
            relation, places = graph.relations["cable"], self._places(view)
            senders, receivers = (view.ends.places[:, e] for e in self._ends)
            way = senders - receivers
            speed = view.ends.velocities[:, self._ends[0]] - view.ends.velocities[:, self._ends[1]]
            at_ends = (
                receivers - places[:, relation.receivers],
                senders - places[:, relation.senders],
            )
        else:
            way = torch.matmul(apart, self._places(view))
            speed = torch.matmul(apart[:, : self._count], view.velocities)
        length = _norm(way)
        direction = way / length
        rate = (direction * speed).sum(0, keepdim=True)
        rest = graph.rest_lengths(winch)[None]
        strain = length - rest
        if at_ends:
            # The loads of a stiff cable, from slack to taut, lie within millimetres: too little to be
            # seen beside its length.
            loads = torch.cat([graph.stiffness * strain, graph.damping * rate])
            at_ends = (*at_ends, torch.asinh(loads))
        return torch.cat([way, length, direction, rate, rest, strain, *at_ends])

    def _contact_features(self, view: _View) -> Tensor:
        """Features of contact edges, both ways, in the relation's order; vectors point to the receiver."""
        body, sign = self._contact
        velocities = view.velocities.repeat(1, self._config.surfaces, 1)
        speed = (velocities * view.normal).sum(0, keepdim=True)
        slide = velocities - speed * view.normal
        normal = view.normal.expand_as(slide)
        clearance = self._seen(view.clearance)
        vectors = torch.cat([normal, slide])[:, body] * sign
        scalars = torch.cat([clearance, speed])[:, body]
        return torch.cat([scalars[:1], vectors, scalars[1:]])


def _norm(vectors: Tensor) -> Tensor:
    """(1, ...) lengths of (3, ...) vectors; its gradient is finite at 0."""
    return (vectors * vectors).sum(0, keepdim=True).clamp(min=1e-18).sqrt()
