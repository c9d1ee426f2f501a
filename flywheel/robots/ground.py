"""The ground: the plane under a robot."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from flywheel.records import Floats

LEVEL = 1e-12  # by how much the upward part of a level plane's normal may fall short of 1


@dataclass(frozen=True)
class Ground:
    """A plane that takes part in contacts; MuJoCo's planes do not move.

    Attributes:
      geom: MuJoCo's id.
      place: (3,) a point of it in the world [m].
      normal: (3,) unit vector.
    """

    geom: int
    place: Floats
    normal: Floats

    @property
    def level(self) -> bool:
        """True if its normal points straight up."""
        return bool(self.normal[2] > 1.0 - LEVEL)

    @property
    def height(self) -> float:
        """Height of a level ground [m]."""
        return float(self.place[2])


def collides(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) bool: True for geoms in contacts, by themselves or in listed pairs."""
    listed = np.isin(np.arange(model.ngeom), [model.pair_geom1, model.pair_geom2])
    return ((model.geom_contype | model.geom_conaffinity) != 0) | listed


def ground_of(model: mujoco.MjModel) -> Ground | None:
    """The ground of a model, None without any.

    Of several planes it is the most level one, then the highest, then the roughest, independent of
    their order in the MJCF.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    planes = np.flatnonzero((model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & collides(model))
    grounds = [
        Ground(geom, data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3)[:, 2].copy())
        for geom in planes.tolist()
    ]

    def rank(ground: Ground) -> tuple[float, ...]:
        at, from_origin = ground.geom, float(ground.place @ ground.normal)
        place = (round(float(ground.normal[2]), 9), round(from_origin, 9))
        return (*place, *model.geom_friction[at], *model.geom_solref[at])

    return max(grounds, key=rank, default=None)
