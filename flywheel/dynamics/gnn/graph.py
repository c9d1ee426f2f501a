"""The static part of a robot's graph: nodes, edges, and all constants on them.

Nodes are numbered body nodes first, then anchors, then the ground. Every edge has a sender and a
receiver; each cable and each pair of nodes of one body is an edge in both directions, and so is
each possible contact of a body node with a surface: the ground's node stands for all of them. Contact
edges are candidates: a mask selects the active ones at every prediction, so that all shapes are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.nodes import anchors, body_nodes, cable_constants, find, node_constants
from flywheel.dynamics.rigid_bodies.guessed_attachments import with_attachments
from flywheel.effects import Scales
from flywheel.records import Floats
from flywheel.robots import Attachment, Robot

T = TypeVar("T")


@dataclass(frozen=True)
class Group:
    """Receivers with the same number of edges; their edges are consecutive.

    Attributes:
      first: number of its first edge.
      degree: edges per receiver.
      receivers: node numbers, one per receiver.
    """

    first: int
    degree: int
    receivers: tuple[int, ...]

    @property
    def edges(self) -> slice:
        """Slice of its edges."""
        return slice(self.first, self.first + self.size)

    @property
    def size(self) -> int:
        """Number of its edges."""
        return self.degree * len(self.receivers)


@dataclass(frozen=True)
class Relation:
    """All edges of one type, ordered by group, then by receiver.

    Attributes:
      name: "body", "cable" or "contact".
      senders, receivers: (E,) node numbers.
      groups: receivers by number of edges.
      origin: (E,) original number of each edge (cable number, pair number ...).
      constants: (E, ...) constant features.
    """

    name: str
    senders: Tensor
    receivers: Tensor
    groups: tuple[Group, ...]
    origin: Tensor
    constants: Tensor


class RobotGraph:
    """The static part of a robot's graph.

    Args:
      robot: the robot.
      config: decomposition, types of edges.
      device: of its tensors.

    Attributes:
      nodes: the body nodes, N of them.
      anchors: (3, A) positions of the anchors [m].
      ground: number of the ground node, -1 without ground or without contact edges.
      count: of all nodes.
      relations: by name; a type without edges is missing.
      node_constants: (N, ...) constant features of the body nodes.
      radius: (N, 1) of the contact sphere at each body node [m].
      designated: two body nodes; positions are relative to the first, and the horizontal direction
        to the second is the robot's heading.
      cable_winch: (E,) winch of each cable edge; W (one past the last) for a passive cable.
      ratio: (E, 1) change of each cable edge's rest length per change of its winch's position.
      stiffness, damping: (E, 1) of each cable edge in weights of the robot per metre, and per m/s.
      winch_average: (W, E) averages over the cable edges of each winch.
      rest_offset: (E, 1) rest length of each cable edge at winch position 0 [m]; for a passive
        cable the rest length itself.
    """

    def __init__(
        self, robot: Robot, config: NetworkConfig, device: torch.device | str = "cpu"
    ) -> None:
        robot.require_rest_lengths("predicted by a network")
        own = robot
        if config.mechanics != "learned":
            robot = with_attachments(robot, config.mechanics)
        self.robot, self.config, self.device = robot, config, torch.device(device)
        self._cache: dict[str, Any] = {}
        self.nodes = body_nodes(robot, config.decomposition)
        places = anchors(robot)
        self._places = places
        self.anchors = self._tensor(np.array(places).reshape(-1, 3).T)
        grounded = robot.grounded and config.contact_edges
        self.ground = len(self.nodes) + len(places) if grounded else -1
        self.count = len(self.nodes) + len(places) + int(grounded)
        self.node_constants = self._tensor(node_constants(robot, self.nodes))
        self.radius = self._tensor(np.array([[node.radius] for node in self.nodes]))
        self._node_of_point = {n.point: i for i, n in enumerate(self.nodes) if n.point >= 0}
        self.designated = self._designate()
        relations = (self._body_relation(), self._cable_relation(), self._contact_relation())
        self.relations = {r.name: r for r in relations if len(r.senders)}
        self._place_winches(own)

    @property
    def body_count(self) -> int:
        """N, the number of body nodes."""
        return len(self.nodes)

    @property
    def turning(self) -> bool:
        """True if inputs and outputs are in axes that turn with the robot."""
        return self.config.yaw_frame and not self.robot.tethered

    @property
    def contact_count(self) -> int:
        """Possible contacts: of all body nodes with the ground, then with the nearest box, and so on."""
        return self.body_count * self.config.surfaces

    @property
    def families(self) -> list[tuple[int, int]]:
        """Numbers [start, stop) of the body nodes, and of anchors and ground if there are any."""
        still = [(self.body_count, self.count)] if self.count > self.body_count else []
        return [(0, self.body_count), *still]

    @property
    def family_sizes(self) -> list[int]:
        """Number of nodes in each family."""
        return [stop - start for start, stop in self.families]

    def cached(self, name: str, make: Callable[[RobotGraph], T]) -> T:
        """Cached result of `make` for this graph."""
        if name not in self._cache:
            self._cache[name] = make(self)
        return self._cache[name]

    def anchors_from(self, origin: Tensor, samples: int) -> Tensor:
        """(3, A, K) positions of the anchors relative to horizontal positions `origin` (2, K) [m]."""
        anchors = self.anchors[:, :, None].expand(-1, -1, samples)
        if not anchors.shape[1]:
            return anchors
        return anchors - torch.cat([origin, torch.zeros_like(origin[:1])])[:, None]

    def rest_lengths(self, winch: Tensor) -> Tensor:
        """(E, K) rest lengths of the cable edges [m], from winch positions (W, K) [m]."""
        driven = torch.cat([winch, torch.zeros_like(winch[:1])])
        return self.ratio * driven[self.cable_winch] + self.rest_offset

    def _tensor(self, array: Floats) -> Tensor:
        return torch.as_tensor(array, dtype=torch.float32, device=self.device)

    def _index(self, array: NDArray[np.int64]) -> Tensor:
        return torch.as_tensor(np.asarray(array, dtype=np.int64), device=self.device)

    def _designate(self) -> tuple[int, int]:
        """The two tracked points of one body that are farthest apart; else the first two points."""
        best, pair = 0.0, (0, min(1, len(self.nodes) - 1))
        for body in self.robot.bodies:
            for a, b in combinations(body.points, 2):
                offsets = self.robot.points[a].offset, self.robot.points[b].offset
                distance = float(np.linalg.norm(offsets[1] - offsets[0]))
                if distance > best * (1.0 + 1e-6):
                    best, pair = distance, (self._node_of_point[a], self._node_of_point[b])
        return pair

    def _relation(
        self, name: str, senders: list[int], receivers: list[int], constants: Floats
    ) -> Relation:
        """Sort edges so that receivers of equal degree, and the edges of a receiver, are together."""
        to = np.array(receivers, dtype=np.int64)
        degree = np.bincount(to, minlength=self.count)
        groups: list[Group] = []
        ordered: list[int] = []
        for family in (range(*numbers) for numbers in self.families):
            for d in sorted({int(degree[n]) for n in family} - {0}):
                members = tuple(n for n in family if degree[n] == d)
                groups.append(Group(len(ordered), d, members))
                ordered += [int(e) for n in members for e in np.flatnonzero(to == n)]
        index = np.array(ordered, dtype=np.int64)
        return Relation(
            name=name,
            senders=self._index(np.array(senders, dtype=np.int64)[index]),
            receivers=self._index(to[index]),
            groups=tuple(groups),
            origin=self._index(index),
            constants=self._tensor(constants[index]),
        )

    def _body_relation(self) -> Relation:
        """All ordered pairs of nodes of one body."""
        pairs = [
            (i, j)
            for i, j in permutations(range(self.body_count), 2)
            if self.nodes[i].body == self.nodes[j].body
        ]
        apart = [self.nodes[i].offset - self.nodes[j].offset for i, j in pairs]
        table = np.array(apart).reshape(-1, 3) / self.robot.length
        table = np.concatenate([table, np.linalg.norm(table, axis=1, keepdims=True)], axis=1)
        return self._relation("body", [p[0] for p in pairs], [p[1] for p in pairs], table)

    def _cable_relation(self) -> Relation:
        """Both directions of every cable; edges 2c and 2c + 1 are those of cable c."""
        ends = [[self._node_at(end) for end in cable.ends] for cable in self.robot.cables]
        senders = [node for pair in ends for node in pair]
        receivers = [node for a, b in ends for node in (b, a)]
        constants = np.repeat(cable_constants(self.robot), 2, axis=0)
        return self._relation("cable", senders, receivers, constants)

    def _contact_relation(self) -> Relation:
        """Surface to node and node to surface; the constant is +1 where the body node receives."""
        if self.ground < 0:
            return self._relation("contact", [], [], np.zeros((0, 1)))
        count, nodes = self.contact_count, range(self.body_count)
        bodies, ground = [*nodes] * self.config.surfaces, [self.ground] * count
        sign = np.repeat([[1.0], [-1.0]], count, axis=0)
        return self._relation("contact", ground + bodies, bodies + ground, sign)

    def anchor_at(self, end: Attachment) -> int:
        """Index of the anchor at a cable's end in the world."""
        return find(self._places, end.offset, self.robot.length)

    def _node_at(self, end: Attachment) -> int:
        if end.body < 0:
            return self.body_count + self.anchor_at(end)
        return self._node_of_point[end.point]

    def _place_winches(self, own: Robot) -> None:
        """Winch of each cable edge, and the relation of its rest length to the winch position.

        Winch positions are those of the robot with its own attachments.
        """
        robot = self.robot
        cable = self.relations["cable"].origin.cpu().numpy() // 2
        drives = np.array([c.winch for c in robot.cables])[cable]
        force = (
            np.array([(c.stiffness, c.damping) for c in robot.cables])[cable]
            / Scales.of(robot).weight
        )
        self.stiffness, self.damping = self._tensor(force).split(1, dim=1)
        start = np.array([own.cables[w.cables[0]].rest_length for w in own.winches] + [0.0])
        rest = np.array([c.rest_length for c in robot.cables])[cable]
        self.cable_winch = self._index(np.where(drives < 0, len(robot.winches), drives))
        ratio = robot.ratios[cable]
        self.ratio = self._tensor(ratio[:, None])
        self.rest_offset = self._tensor((rest - ratio * start[drives])[:, None])
        member = (drives[None] == np.arange(len(robot.winches))[:, None]).astype(float)
        self.winch_average = self._tensor(member / member.sum(axis=1, keepdims=True))
