"""Contact of the robot with the ground: by another kind of MuJoCo's contacts, or by our own springs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats
from flywheel.robots import Robot, collides, ground_of
from flywheel.truth_simulator.skeleton import Skeleton

Contact = Literal["elliptic", "pyramidal", "penalty"]
CONTACTS: dict[str, mujoco.mjtCone] = {  # -> the cone of what MuJoCo still does itself
    "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC,
    "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL,
    "penalty": mujoco.mjtCone.mjCONE_ELLIPTIC,
}
STIFFER = 4.0  # than the MJCF's reference, which MuJoCo stiffens further under a static load
LEVER = 4.0  # a rod's end feels a quarter of the rod's mass
SLOW_SPIN = 0.1  # below it, resistance to spinning and rolling fades out [rad/s]
UP = np.array([0.0, 0.0, 1.0])

Geom = mujoco.mjtGeom


@dataclass(frozen=True)
class Feet:
    """All places of the robot that can touch the ground first.

    Each is the lowest point of a ball around a centre (radius 0: a corner), or of a disc across an
    axis (the rim of a cylinder's end).

    Attributes:
      body: (n,) MuJoCo's body.
      geom: (n,) MuJoCo's geom.
      offset: (n, 3) centre in the body frame [m].
      axis: (n, 3) of the disc in the body frame.
      radius: (n,) [m].
      disc: (n,) bool.
    """

    body: np.ndarray
    geom: np.ndarray
    offset: Floats
    axis: Floats
    radius: Floats
    disc: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Feet:
        """The feet of all geoms that collide."""
        rows, touching = [], collides(model)
        for geom in range(model.ngeom):
            body = int(model.geom_bodyid[geom])
            if model.body_weldid[body] == 0 or not touching[geom]:
                continue
            flat = np.zeros(9)
            mujoco.mju_quat2Mat(flat, model.geom_quat[geom])
            turn = flat.reshape(3, 3)
            for local, radius, disc in _local_feet(model, geom):
                offset = model.geom_pos[geom] + turn @ local
                rows.append((body, geom, offset, turn[:, 2], radius, disc))
        return cls(
            body=np.array([row[0] for row in rows], int),
            geom=np.array([row[1] for row in rows], int),
            offset=np.array([row[2] for row in rows], float).reshape(-1, 3),
            axis=np.array([row[3] for row in rows], float).reshape(-1, 3),
            radius=np.array([row[4] for row in rows], float),
            disc=np.array([row[5] for row in rows], bool),
        )


def _local_feet(model: mujoco.MjModel, geom: int) -> list[tuple[Floats, float, bool]]:
    """(centre in the geom frame, radius, is a disc) of each foot of a geom."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == Geom.mjGEOM_SPHERE:
        return [(np.zeros(3), float(size[0]), False)]
    ends = [np.array([0.0, 0.0, sign * size[1]]) for sign in (-1, 1)]
    if kind == Geom.mjGEOM_CAPSULE:
        return [(end, float(size[0]), False) for end in ends]
    if kind == Geom.mjGEOM_CYLINDER:
        return [(end, float(size[0]), True) for end in ends]
    if kind == Geom.mjGEOM_BOX:
        signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
        return [(corner * size, 0.0, False) for corner in signs]
    name = model.geom(geom).name
    raise ModelError(
        f"The geom {name!r} cannot stand on springs; allowed: sphere, capsule, cylinder, box."
    )


class PenaltyGround:
    """Springs and dampers under every foot, with dry friction as sliders on springs (Cundall).

    The slider's spring yields at the Coulomb limit, so that the robot can rest on it, whereas
    friction that depends on the sliding speed alone would let it creep.

    Args:
      robot: for its name in errors.
      model: its ground plane is removed from MuJoCo's collisions (it is changed).
      skeleton: of the same model.

    Raises:
      ModelError: the ground is not level, or a geom has another shape.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel, skeleton: Skeleton) -> None:
        self._skeleton, self.feet = skeleton, Feet.of(model)
        ground = ground_of(model)
        if ground is None or not ground.level or model.npair:
            raise ModelError(
                "A penalty contact needs a level ground plane and no contact pairs; "
                f"{robot.name} is otherwise."
            )
        plane, self._height = ground.geom, ground.height
        model.geom_contype[plane] = model.geom_conaffinity[plane] = 0
        geom = self.feet.geom
        friction = np.maximum(model.geom_friction[geom], model.geom_friction[plane])
        condim = np.maximum(model.geom_condim[geom], model.geom_condim[plane])
        self._slide = friction[:, 0] * (condim >= 3)
        self._spin = friction[:, 1] * (condim >= 4)
        self._roll = friction[:, 2] * (condim >= 6)
        mass = model.body_subtreemass[model.body_weldid[self.feet.body]] / LEVER
        stiffness, damping = _reference(model.geom_solref[geom])
        self._stiffness = STIFFER * stiffness * mass
        self._damping = np.sqrt(STIFFER) * damping * mass
        self._slider = np.zeros((len(geom), 3))

    def push(self, data: mujoco.MjData, step: float) -> None:
        """Add the ground's forces of this moment, and advance the sliders by a step."""
        feet, skeleton = self.feet, self._skeleton
        centre = skeleton.place(data, feet.body, feet.offset)
        lowest = centre + self._reach(data)
        depth = self._height - lowest[:, 2]
        touching = depth > 0
        velocity = skeleton.velocity(data, feet.body, lowest)
        normal = self._stiffness * depth - self._damping * velocity[:, 2]
        normal = np.where(touching, np.maximum(normal, 0.0), 0.0)
        slide = velocity * (1.0, 1.0, 0.0)
        self._slider = np.where(touching[:, None], self._slider + slide * step, 0.0)
        wanted = -self._stiffness[:, None] * self._slider - self._damping[:, None] * slide
        size = np.linalg.norm(wanted, axis=1)
        limit = self._slide * normal
        kept = np.minimum(1.0, limit / np.maximum(size, 1e-12))
        held = wanted * kept[:, None]
        yields = (kept < 1)[:, None]
        self._slider = np.where(yields, -held / self._stiffness[:, None], self._slider)
        skeleton.push(data, feet.body, lowest, held + normal[:, None] * UP)
        self._resist_spin(data, normal)

    def _reach(self, data: mujoco.MjData) -> Floats:
        """(n, 3) from each foot's centre down to its lowest point."""
        feet = self.feet
        turn = data.xmat[feet.body].reshape(-1, 3, 3)
        axis = (turn @ feet.axis[:, :, None])[:, :, 0]
        down = -UP + np.where(feet.disc, axis[:, 2], 0.0)[:, None] * axis
        length = np.linalg.norm(down, axis=1)
        return np.asarray(feet.radius[:, None] * down / np.maximum(length, 1e-9)[:, None])

    def _resist_spin(self, data: mujoco.MjData, normal: Floats) -> None:
        if not (self._spin.any() or self._roll.any()):
            return
        spin = data.cvel[self.feet.body, :3]
        flat = spin * (1.0, 1.0, 0.0)
        speed = np.linalg.norm(flat, axis=1)
        rolling = self._roll * normal * np.tanh(speed / SLOW_SPIN) / np.maximum(speed, 1e-12)
        torque = -rolling[:, None] * flat
        torque[:, 2] = -self._spin * normal * np.tanh(spin[:, 2] / SLOW_SPIN)
        np.add.at(data.xfrc_applied[:, 3:], self.feet.body, torque)


def _reference(solref: Floats) -> tuple[Floats, Floats]:
    """Stiffness [1/s^2] and damping [1/s] (n,) of contact references (n, 2), in either format."""
    direct = solref[:, 0] < 0
    time, ratio = np.where(direct, 1.0, solref[:, 0]), np.where(direct, 1.0, solref[:, 1])
    stiffness = np.where(direct, -solref[:, 0], 1.0 / (time * ratio) ** 2)
    damping = np.where(direct, -solref[:, 1], 2.0 / time)
    return stiffness, damping
