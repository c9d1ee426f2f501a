"""The bodies: MuJoCo moves them, without any actuation of its own.

Tendons, actuators, sensors and keyframes are removed from the MJCF. Cable lengths, their rates and
the wrenches of tensions are computed here from the poses and velocities of the bodies.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.effect import ModelEffect


def bare_spec(robot: Robot, effects: Sequence[ModelEffect] = ()) -> mujoco.MjSpec:
    """The robot's MJCF without cables, winches and sensors, with the effects written into it."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    for group in (spec.keys, spec.sensors, spec.tuples, spec.actuators, spec.tendons):
        for element in list(group):
            spec.delete(element)
    for effect in effects:
        effect.edit(spec, robot)
    return spec


class Skeleton:
    """Poses and velocities of points fixed to the bodies of one simulation.

    Args:
      robot: of the cables and points.
      model: compiled from its bare spec.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel) -> None:
        ids = np.array([model.body(body.name).id for body in robot.bodies] + [0])  # -1 is the world
        self.bodies = ids[:-1]
        self.mass = np.array([body.mass for body in robot.bodies])
        self._root = model.body_rootid
        ends = [end for cable in robot.cables for end in cable.ends]
        self.end_body = ids[[end.body for end in ends]]
        self.end_offset = np.array([end.offset for end in ends])
        self.end_point = np.array([end.point for end in ends])
        self.point_body = ids[[point.body for point in robot.points]]
        self.point_offset = np.array([point.offset for point in robot.points])

    def place(self, data: mujoco.MjData, body: np.ndarray, offset: Floats) -> Floats:
        """World positions (n, 3) of offsets (n, 3) on bodies (n,), by MuJoCo's numbers."""
        turn = data.xmat[body].reshape(-1, 3, 3)
        return np.asarray(data.xpos[body] + (turn @ offset[:, :, None])[:, :, 0])

    def velocity(self, data: mujoco.MjData, body: np.ndarray, place: Floats) -> Floats:
        """World velocities (n, 3) of material points at world positions (n, 3) [m/s]."""
        spin, slide = data.cvel[body, :3], data.cvel[body, 3:]
        return np.asarray(slide + cross(spin, place - data.subtree_com[self._root[body]]))

    def points(self, data: mujoco.MjData, moved: Floats) -> Floats:
        """World positions (P, 3) of the tracked points, moved by (P, 3) in body frames."""
        return self.place(data, self.point_body, self.point_offset + moved)

    def cables(self, data: mujoco.MjData, bent: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Ends (2C, 3), unit vectors from first to second end (C, 3), lengths and rates (C,).

        Args:
          bent: (P, 3) displacements of the tracked points, shared by the adjacent ends.
        """
        shift = np.where(self.end_point[:, None] >= 0, bent[self.end_point], 0.0)
        ends = self.place(data, self.end_body, self.end_offset + shift)
        speed = self.velocity(data, self.end_body, ends)
        apart = ends[1::2] - ends[::2]
        length = np.sqrt((apart * apart).sum(axis=1))
        along = apart / length[:, None]
        rate = (along * (speed[1::2] - speed[::2])).sum(axis=1)
        return ends, along, length, rate

    def push(self, data: mujoco.MjData, body: np.ndarray, place: Floats, force: Floats) -> None:
        """Add forces (n, 3) [N] that act at world positions (n, 3) on bodies (n,)."""
        torque = cross(place - data.xipos[body], force)
        np.add.at(data.xfrc_applied, body, np.concatenate([force, torque], axis=1))

    def pull(self, data: mujoco.MjData, ends: Floats, along: Floats, tension: Floats) -> Floats:
        """Apply the tensions (C,) at both ends of the cables; returns their forces (2C, 3)."""
        force = np.empty_like(ends)
        force[::2] = tension[:, None] * along
        force[1::2] = -force[::2]
        self.push(data, self.end_body, ends, force)
        return force

    def point_loads(self, data: mujoco.MjData, force: Floats) -> Floats:
        """Sums (P, 3) of the cables' forces (2C, 3) next to each tracked point, in body frames."""
        turn = data.xmat[self.end_body].reshape(-1, 3, 3)
        local = (force[:, None, :] @ turn)[:, 0, :]
        loads = np.zeros_like(self.point_offset)
        held = self.end_point >= 0
        np.add.at(loads, self.end_point[held], local[held])
        return loads


def cross(a: Floats, b: Floats) -> Floats:
    """Cross products (n, 3); several times faster than numpy's for few rows."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    product[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    product[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product
