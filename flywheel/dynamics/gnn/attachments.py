"""Cable ends on the surfaces of bodies, next to the tracked points.

Tracked points on the axis of a rod do not show its roll, the rotation about that axis. Its cables
end on its surface, though, and the force of a stiff cable depends on centimetres. The roll can be
computed: a rod has little inertia about its axis, so it soon rests where the elastic energy of its
cables is least. That roll is assumed at the start of every prediction chunk.

Arrays are component-major: (3, ..., M, K) for M items of K samples.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.records import Floats

_GRID = 16  # angles tried per rod whose roll is unknown
_SWEEPS = 2  # over all rods, in that search
_SETTLING = 8  # descents after it
_LARGEST = 0.5  # turn of one descent [rad]


class Attachments:
    """The ends of all cables of a robot; ends 2c and 2c + 1 are those of cable c.

    A *rod* is a body with only a visible axis. Its roll is described by its *side*: a unit vector
    across its axis that turns with it.

    Args:
      graph: of the robot.
      frames: layout of its rigid frames.

    Attributes:
      rolls: some cable ends beside a rod's axis.
      along: (2 C, F + A) matrix from frames and anchors to the ends, but for their parts across rods.
      across: (2 C, 2 R) to these parts, from all sides and then all vectors axis x side.
      of_nodes, axes_of_nodes: (2 C, N), (R, N) rates of the ends on the axes, and of the axes.
      axes: (R,) rows of the rods' axes.
      rod: (2 C,) rod of each end, 0 where it has none.
      on_rod: the ends on each rod.
      edge: (C,) the cable edge that starts at each cable's first end.
      stiffness, bound: (C, 1) relative stiffness, and that in the bound on the curvature.
    """

    def __init__(self, graph: RobotGraph, frames: Frames) -> None:
        self._graph = graph
        ends = [end for cable in graph.robot.cables for end in cable.ends]
        bodies = [end.body for end in ends]
        on_rod = np.array([bodies]) == np.array(frames.rods, dtype=int)[:, None]  # (R, 2 C)
        along = frames.along(bodies, np.array([end.offset for end in ends]))
        anchored = np.zeros((len(ends), graph.anchors.shape[1]))
        across = np.zeros((len(ends), 2 * len(on_rod)))
        for row in np.flatnonzero(np.array(bodies) < 0):
            anchored[row, graph.anchor_at(ends[row])] = 1.0
        for rod, row in np.argwhere(on_rod):
            across[row, rod :: len(on_rod)] = frames.across(bodies[row], ends[row].offset)
        self.rolls = bool(across.any())
        stiffness = np.array([cable.stiffness for cable in graph.robot.cables])
        # Rods are turned at the same time: a cable between two of them counts double in the bound on
        # the curvature, so that together they do not turn too far.
        shared = on_rod.any(axis=0).reshape(-1, 2).all(axis=1)

        def tensor(array: Floats) -> Tensor:
            return torch.as_tensor(array, dtype=torch.float32, device=graph.device)

        self.along = tensor(np.concatenate([along, anchored], axis=1))
        self.across, self._sum = tensor(across), tensor(on_rod)
        self.stiffness = tensor(stiffness / stiffness.max())[:, None]
        self.bound = tensor(np.where(shared, 2.0, 1.0))[:, None] * self.stiffness
        self.axes = torch.as_tensor(frames.rod_rows, dtype=torch.int64, device=graph.device)
        self.of_nodes = tensor(along) @ frames.from_nodes
        self.axes_of_nodes = frames.from_nodes[self.axes]
        rod = on_rod.argmax(axis=0) if len(on_rod) else np.zeros(len(ends), dtype=int)
        self.rod = torch.as_tensor(rod, device=graph.device)
        self.on_rod = [torch.as_tensor(np.flatnonzero(r), device=graph.device) for r in on_rod]
        self.edge = graph.relations["cable"].origin.argsort()[::2]

    def positions(self, frames: Tensor, sides: Tensor, origin: Tensor) -> tuple[Tensor, Tensor]:
        """(3, 2 C, K) positions of all ends [m], and their component across a rod's axis [m].

        Gradients pass through the frames, but not through the roll.

        Args:
          frames: (3, F, K) rigid frames.
          sides: (3, R, K) of the rods.
          origin: (2, K) horizontal position of the frames' origin in the world [m].
        """
        anchors = self._graph.anchors_from(origin, frames.shape[-1])
        seen = torch.cat([frames, anchors], dim=1) if anchors.shape[1] else frames
        along = torch.matmul(self.along, seen)
        if not self.rolls:
            return along, torch.zeros_like(along)
        axes = frames[:, self.axes]
        sides = upright(sides, axes)
        both = torch.cat([sides, torch.linalg.cross(axes, sides, dim=0)], dim=1)
        across = torch.matmul(self.across, both)
        return along + across, across

    def velocities(self, frames: Tensor, across: Tensor, nodes: Tensor) -> Tensor:
        """(3, 2 C, K) velocities of the ends [m/s] if no rod spins about its axis.

        Args:
          frames: (3, F, K) rigid frames.
          across: as `positions` gives it.
          nodes: (3, N, K) velocities of the body nodes [m/s].
        """
        moved = torch.matmul(self.of_nodes, nodes)
        if not self.rolls:
            return moved
        axes = frames[:, self.axes]
        turning = torch.matmul(self.axes_of_nodes, nodes)
        return moved - (across * turning[:, self.rod]).sum(0) * axes[:, self.rod]

    @torch.no_grad()
    def find(self, frames: Tensor, origin: Tensor, winch: Tensor) -> Tensor:
        """(3, R, K) sides of least cable energy, without a previous estimate.

        Args:
          frames: (3, F, K) rigid frames.
          origin: (2, K) horizontal position of the frames' origin in the world [m].
          winch: (W, K) winch positions [m].
        """
        axes = frames[:, self.axes]
        sides = _any_across(axes)
        if not self.rolls:
            return sides
        rest = self.rest(winch)
        angles = torch.arange(_GRID, device=axes.device) * (2.0 * np.pi / _GRID)
        cos, sin = angles.cos()[:, None], angles.sin()[:, None]
        for _ in range(_SWEEPS):
            for rod, here in enumerate(self.on_rod):
                ends, across = self.positions(frames, sides, origin)
                side, axis = sides[:, rod, None], axes[:, rod, None]
                other = torch.linalg.cross(axis, side, dim=0)
                tried = torch.stack([cos * side + sin * other, cos * other - sin * side])
                arms = self.across[here][:, rod :: len(self.on_rod)]
                turned = torch.einsum("nj,jcgk->cngk", arms, tried)
                still = ends[:, here] - across[:, here] - ends[:, here ^ 1]
                length = _norm(still[:, :, None] + turned)
                stretch = (length - rest[here // 2, None]).clamp(min=0.0)
                energy = (self.stiffness[here // 2, None] * stretch**2).sum(0)
                best = energy.argmin(0, keepdim=True).expand(3, 1, -1)
                sides[:, rod] = tried[0].gather(1, best)[:, 0]
        for _ in range(_SETTLING):
            sides = self._descended(frames, sides, origin, rest)
        return sides

    @torch.no_grad()
    def follow(self, frames: Tensor, sides: Tensor, origin: Tensor, winch: Tensor) -> Tensor:
        """The sides (3, R, K) after a small motion of the rods; arguments as of `find`."""
        sides = upright(sides, frames[:, self.axes])
        return self._descended(frames, sides, origin, self.rest(winch)) if self.rolls else sides

    def rest(self, winch: Tensor) -> Tensor:
        """(C, K) rest lengths of the cables [m]."""
        return self._graph.rest_lengths(winch)[self.edge]

    def _descended(self, frames: Tensor, sides: Tensor, origin: Tensor, rest: Tensor) -> Tensor:
        """All rods turned once towards less energy, by Newton's method with a bound as curvature."""
        ends, across = self.positions(frames, sides, origin)
        way = ends[:, 1::2] - ends[:, ::2]
        length = _norm(way)
        stretch = (length - rest).clamp(min=0.0)
        pull, stiff = (_twice(x * stretch.sign()) for x in (self.stiffness * stretch, self.bound))
        unit = way / length
        towards = torch.stack([-unit, unit], dim=2).flatten(1, 2)  # each end, from the other one
        axes = frames[:, self.axes]
        turning = torch.linalg.cross(axes[:, self.rod], across, dim=0)
        lever = (towards * turning).sum(0)  # change of length with angle
        bend = ((turning * turning).sum(0) - lever**2) / _twice(length)
        curvature = stiff * lever**2 + pull * (bend - (towards * across).sum(0)).clamp(min=0.0)
        slope, steepness = torch.matmul(self._sum, torch.stack([pull * lever, curvature]))
        step = (-slope / steepness.clamp(min=1e-9)).clamp(-_LARGEST, _LARGEST)
        other = torch.linalg.cross(axes, sides, dim=0)
        return upright(step.cos() * sides + step.sin() * other, axes)


def upright(sides: Tensor, axes: Tensor) -> Tensor:
    """Vectors (3, R, K) projected to unit vectors across the axes (3, R, K)."""
    sides = sides - (sides * axes).sum(0) * axes
    return sides / (sides * sides).sum(0).clamp(min=1e-12).sqrt()


def _any_across(axes: Tensor) -> Tensor:
    """(3, R, K) arbitrary unit vectors across the axes."""
    steep = (axes[2].abs() > 0.9).to(axes)
    return upright(torch.stack([torch.zeros_like(steep), steep, 1.0 - steep]), axes)


def _norm(vectors: Tensor) -> Tensor:
    """(...) lengths of (3, ...) vectors, never 0."""
    return (vectors * vectors).sum(0).clamp(min=1e-18).sqrt()


def _twice(of_cables: Tensor) -> Tensor:
    """(2 C, K) for both ends of each cable, from (C, K)."""
    return of_cables.repeat_interleave(2, 0)
