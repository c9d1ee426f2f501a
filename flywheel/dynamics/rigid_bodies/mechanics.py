"""Mechanics of rigid bodies, cables and contacts of end caps, differentiable in torch.

Arrays are component-major and double precision: (3, M, K) for M bodies or places of K samples. World
axes, SI units. Semi-implicit Euler steps; gyroscopic torques are left out, as a rod hardly spins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.plant.roll import line_of
from flywheel.dynamics.rigid_bodies.ground import Ground
from flywheel.records import Floats, State
from flywheel.robots import GRAVITY, Robot
from flywheel.rotations import rotate

_TINY = 1e-12


@dataclass(frozen=True)
class RigidState:
    """Motion of n bodies.

    Attributes:
      centre: (3, n, K) centres of mass [m].
      axes: (3, 3, n, K) principal axes; components first, then which axis.
      velocity: (3, n, K) of the centres of mass [m/s].
      rate: (3, n, K) of turning [rad/s].
    """

    centre: Tensor
    axes: Tensor
    velocity: Tensor
    rate: Tensor

    @classmethod
    def of(cls, robot: Robot, state: State) -> RigidState:
        """The motion of a plant's state (K,); of a robot of free bodies."""
        count, bodies = len(state.qpos), robot.bodies
        qpos = state.qpos.reshape(count, len(bodies), 7)
        qvel = state.qvel.reshape(count, len(bodies), 6)
        turn = qpos[..., 3:]
        arm = rotate(turn, np.array([body.com for body in bodies]))
        principal = np.array([body.principal.T for body in bodies])  # (n, which, 3)
        axes = np.stack([rotate(turn, principal[:, j]) for j in range(3)], axis=1)
        rate = rotate(turn, qvel[..., 3:])
        parts = (qpos[..., :3] + arm, axes, qvel[..., :3] + np.cross(rate, arm), rate)
        return cls(*(_tensor(np.moveaxis(p, (-1, 0), (0, -1))) for p in parts))

    def expanded(self, samples: int) -> RigidState:
        """The motion of all samples, from one for all or one for each."""
        return RigidState(*(p.expand(*p.shape[:-1], samples) for p in vars(self).values()))


class Places:
    """Places fixed to bodies or to the world.

    Args:
      robot: the robot.
      bodies: (m,) index of each place's body; -1 for the world.
      offsets: (m, 3) in the frame of the body [m].

    Attributes:
      on: (m, n) 1 where a place is on a body.
    """

    def __init__(self, robot: Robot, bodies: Sequence[int], offsets: Floats) -> None:
        count, n = len(bodies), len(robot.bodies)
        on, arm, still = np.zeros((count, n)), np.zeros((count, 3, n)), np.zeros((3, count, 1))
        for row, index in enumerate(bodies):
            if index < 0:
                still[:, row, 0] = offsets[row]
                continue
            body = robot.bodies[index]
            on[row, index] = 1.0
            arm[row, :, index] = (offsets[row] - body.com) @ body.principal
        self.on, self._still = _tensor(on), _tensor(still)
        self._arm = _tensor(arm.reshape(count, 3 * n))

    def arms(self, state: RigidState) -> Tensor:
        """(3, m, K) from the centres of mass to the places; 0 in the world [m]."""
        return torch.matmul(self._arm, state.axes.flatten(1, 2))

    def positions(self, state: RigidState, arms: Tensor) -> Tensor:
        """(3, m, K) of the places [m]."""
        return torch.matmul(self.on, state.centre) + arms + self._still

    def velocities(self, state: RigidState, arms: Tensor) -> Tensor:
        """(3, m, K) of the places [m/s]."""
        rates = torch.matmul(self.on, state.rate)
        return torch.matmul(self.on, state.velocity) + torch.linalg.cross(rates, arms, dim=0)

    def wrench(self, arms: Tensor, pushes: Tensor) -> tuple[Tensor, Tensor]:
        """(3, n, K) sums of pushes (3, m, K) at the places, and of their moments."""
        moments = torch.linalg.cross(arms, pushes, dim=0)
        back = self.on.t()
        return torch.matmul(back, pushes), torch.matmul(back, moments)


def tension(spring: Tensor, damper: Tensor, winched: Tensor) -> Tensor:
    """(C, K) tensions of cables with these forces of spring and damper; `winched` (C, 1): it has a winch.

    The damper of a passive cable acts at any length, that of a winched one only where the cable pulls
    in all.
    """
    return torch.where(winched, (spring + damper).clamp(min=0.0), spring.clamp(min=0.0) + damper)


class Cables:
    """The cables of a robot: springs that pull, and dampers along them; see `tension`.

    Args:
      robot: the robot.
    """

    def __init__(self, robot: Robot) -> None:
        ends = [end for cable in robot.cables for end in cable.ends]
        offsets = np.array([end.offset for end in ends])
        self.ends = Places(robot, [end.body for end in ends], offsets)

        def column(values: list[float]) -> Tensor:
            return _tensor(np.array(values)[:, None])

        self.stiffness = column([cable.stiffness for cable in robot.cables])
        self.damping = column([cable.damping for cable in robot.cables])
        self._winched = column([cable.winch >= 0 for cable in robot.cables]) > 0

    def wrench(self, state: RigidState, rest: Tensor) -> tuple[Tensor, Tensor]:
        """(3, n, K) forces [N] and torques [N m] on the bodies, at rest lengths (C, K) [m]."""
        arms, way, away = self.stretched(state)
        length = _norm(way)
        spring, damper = self.stiffness * (length - rest), self.damping * away
        pull = tension(spring, damper, self._winched)
        return self.ends.wrench(arms, _on_ends(pull / length * way))

    def stretched(self, state: RigidState) -> tuple[Tensor, Tensor, Tensor]:
        """Arms of the ends, ways (3, C, K) from first to second ends [m], and speeds of stretching (C, K)."""
        arms = self.ends.arms(state)
        places, speeds = self.ends.positions(state, arms), self.ends.velocities(state, arms)
        way = places[:, 1::2] - places[:, ::2]
        return arms, way, (way / _norm(way) * (speeds[:, 1::2] - speeds[:, ::2])).sum(0)


@dataclass(frozen=True)
class ContactNumbers:
    """Numbers of the contact of an end cap, each a tensor that broadcasts to (M, K).

    Attributes:
      restitution: speed after over before, along the normal.
      depth_share: of a penetration that one step removes.
      friction: coefficient of sliding.
      sticking: share of the sliding speed that one step removes at most.
      rolling: share of a touching rod's spin about its axis that one step removes.
    """

    restitution: Tensor
    depth_share: Tensor
    friction: Tensor
    sticking: Tensor
    rolling: Tensor


class Mechanics:
    """One step of a robot of free bodies.

    Args:
      robot: the robot.
    """

    def __init__(self, robot: Robot) -> None:
        self.cables, points = Cables(robot), robot.points
        bodies, offsets = [p.body for p in points], np.array([p.offset for p in points])
        self.points = Places(robot, bodies, offsets)
        caps = [i for i, point in enumerate(points) if point.radius > 0]
        self._caps = Places(robot, [bodies[i] for i in caps], offsets[caps])
        self._radius = _tensor(np.array([[points[i].radius] for i in caps]))
        self._mass = _tensor(np.array([[body.mass] for body in robot.bodies]))
        moments = np.array([body.inertia for body in robot.bodies]).T[..., None]
        self._softness = _tensor(1.0 / moments)  # (3, n, 1)
        self._rods = _tensor(np.array([_axis(robot, i) for i in range(len(robot.bodies))]))

    def step(
        self,
        state: RigidState,
        rest: Tensor,
        h: float,
        contact: ContactNumbers,
        ground: Ground | None,
    ) -> RigidState:
        """The state a time h [s] later.

        Args:
          state: before.
          rest: (C, K) rest lengths of the cables [m].
          h: the time [s].
          contact: numbers of the contacts.
          ground: below the robot; None for none.
        """
        state = self._pushed(state, *self._impulse(state, rest, h))
        none = torch.zeros_like(state.velocity)
        late, late_turn = none, none
        if ground is not None and len(self._radius):
            state, late, late_turn = self._touched(state, h, contact, ground)
        centre = state.centre + h * state.velocity - late
        axes = _rotated(state.axes, h * state.rate - late_turn)
        return RigidState(centre, axes, state.velocity, state.rate)

    def seen(self, state: RigidState) -> Tensor:
        """(3, P, K) tracked points [m]."""
        return self.points.positions(state, self.points.arms(state))

    def _impulse(self, state: RigidState, rest: Tensor, h: float) -> tuple[Tensor, Tensor]:
        force, torque = self.cables.wrench(state, rest)
        weight = GRAVITY * self._mass * force.new_tensor([0.0, 0.0, 1.0])[:, None, None]
        return h * (force - weight), h * torque

    def _pushed(self, state: RigidState, impulse: Tensor, moment: Tensor) -> RigidState:
        velocity = state.velocity + impulse / self._mass
        rate = state.rate + _scaled(state.axes, moment, self._softness)
        return RigidState(state.centre, state.axes, velocity, rate)

    def _touched(
        self, state: RigidState, h: float, numbers: ContactNumbers, ground: Ground
    ) -> tuple[RigidState, Tensor, Tensor]:
        """The state after one impulse on each cap that touches the ground within h [s].

        The impulse of a cap that is still in the air acts when it arrives. The second and third
        results are the shifts [m] and turns [rad] (3, n, K) that it has not caused until then.
        """
        caps = self._caps
        arms = caps.arms(state)
        places = caps.positions(state, arms)
        height, normal = (each.to(places) for each in ground(places[:2]))
        gap = (places[2] - height) * normal[2] - self._radius
        arms = arms - self._radius * normal
        rise = (caps.velocities(state, arms) * normal).sum(0)
        touching = gap + h * rise < 0.0
        down = torch.matmul(caps.on.t(), touching.to(gap)).clamp(max=1.0)
        axis = (state.axes * self._rods.t()[None, :, :, None]).sum(1)
        held = numbers.rolling * down

        state = RigidState(
            state.centre, state.axes, state.velocity, _unspun(state.rate, axis, held)
        )
        slide = caps.velocities(state, arms) - rise * normal
        pace = _norm(slide)
        mass, across = (
            1.0 / self._softness_at(state, arms, along, axis, held)
            for along in (normal.expand_as(arms), slide / pace)
        )
        deep = (-gap).clamp(min=0.0) * numbers.depth_share / h
        push = mass * (deep - (1.0 + numbers.restitution) * rise).clamp(min=0.0)
        drag = torch.minimum(numbers.sticking * across * pace, numbers.friction * push)
        impulse = torch.where(touching, push * normal - drag * slide / pace, 0.0)
        wait = torch.where(touching, gap.clamp(min=0.0) / (-rise).clamp(min=_TINY), 0.0)
        late, after = (
            self._pushed(state, *caps.wrench(arms, each)) for each in (wait * impulse, impulse)
        )
        late_turn, turn = (_unspun(each.rate - state.rate, axis, held) for each in (late, after))
        after = RigidState(after.centre, after.axes, after.velocity, state.rate + turn)
        return after, late.velocity - state.velocity, late_turn

    def _softness_at(
        self, state: RigidState, arms: Tensor, along: Tensor, axis: Tensor, held: Tensor
    ) -> Tensor:
        """(M, K) speeds of caps along unit vectors (3, M, K) by impulses of 1 N s along them [1/kg].

        Args:
          state: of the bodies.
          arms: (3, M, K) of the contacts [m].
          along: the unit vectors.
          axis, held: see `_unspun`.
        """
        on, lever = self._caps.on, torch.linalg.cross(arms, along, dim=0)
        softness = torch.matmul(on, self._softness)
        turn = _scaled(torch.matmul(on, state.axes), lever, softness)
        turn = _unspun(turn, torch.matmul(on, axis), torch.matmul(on, held))
        return torch.matmul(on, 1.0 / self._mass) + (lever * turn).sum(0)

    def longest_step(self, robot: Robot) -> float:
        """A stable step, with all cables taut in the keyframe's pose, and half the longest such [s]."""
        count = len(robot.cables)
        key = robot.keyframe
        still = State(key.qpos[None], np.zeros((1, len(key.qvel))), key.act[None])
        state = RigidState.of(robot, State(*(np.repeat(a, count, axis=0) for a in still.arrays)))
        arms, way, _ = self.cables.stretched(state)
        one = way / _norm(way) * torch.eye(count, dtype=way.dtype)
        pulled = self._pushed(state, *self.cables.ends.wrench(arms, _on_ends(one)))
        _, _, away = self.cables.stretched(pulled)  # (C, C) speeds by unit impulses

        def fastest(coefficient: Tensor) -> float:
            root = coefficient.sqrt()
            return float(torch.linalg.eigvalsh(-root * away * root.t())[-1].clamp(min=_TINY))

        damping, stiffness = fastest(self.cables.damping), fastest(self.cables.stiffness)
        return (math.sqrt(damping**2 + 2.0 * stiffness) - damping) / stiffness


def _axis(robot: Robot, index: int) -> Floats:
    """(3,) axis of a rod in its principal axes; 0 for another body."""
    body = robot.bodies[index]
    line = line_of(robot.offsets_of(body))
    return np.zeros(3) if line is None else line @ body.principal


def _scaled(axes: Tensor, vectors: Tensor, factor: Tensor) -> Tensor:
    """Vectors (3, M, K), with their components along axes (3, 3, M, K) times `factor` (3, M, 1)."""
    return (axes * ((axes * vectors[:, None]).sum(0) * factor)).sum(1)


def _unspun(rates: Tensor, axis: Tensor, held: Tensor) -> Tensor:
    """Turning rates (3, M, K) without a share `held` (M, K) of those about unit vectors (3, M, K)."""
    return rates - held * (rates * axis).sum(0) * axis


def _on_ends(pulls: Tensor) -> Tensor:
    """(3, 2 C, K) forces on all ends from the pulls (3, C, K) on the first ends."""
    return torch.stack([pulls, -pulls], dim=2).flatten(1, 2)


def _rotated(axes: Tensor, turn: Tensor) -> Tensor:
    """Axes (3, 3, n, K) after rotation vectors (3, n, K) [rad]."""
    angle = _norm(turn)
    unit = (turn / angle)[:, None].expand_as(axes)
    along = (unit * axes).sum(0) * unit
    across = torch.linalg.cross(unit, axes, dim=0)
    return along + angle.cos() * (axes - along) + angle.sin() * across


def _norm(vectors: Tensor) -> Tensor:
    """(...) lengths of (3, ...) vectors, never 0; its gradient is finite there."""
    return (vectors * vectors).sum(0).clamp(min=_TINY**2).sqrt()


def _tensor(array: Floats) -> Tensor:
    return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float64)
