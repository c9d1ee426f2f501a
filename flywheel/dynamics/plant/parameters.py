"""Physical parameters of a plant that may differ from its MJCF, as multiplicative scales."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.quantities import Factor
from flywheel.robots import Robot
from flywheel.validation import Frozen


class PlantParameters(Frozen):
    """Scales on the MJCF's numbers; with 1 everywhere the plant equals the MJCF, bit by bit.

    Attributes:
      friction: of all contact friction coefficients.
      contact_stiffness: of all contacts; their damping ratio stays the same.
      cable_stiffness: of all cables, winched and passive.
      cable_damping: of all cables.
      winch_speed: ratio of the rate of rate winches to the commanded one; others lag less.
      mass: of all bodies, with their inertia.
    """

    friction: Factor = 1.0
    contact_stiffness: Factor = 1.0
    cable_stiffness: Factor = 1.0
    cable_damping: Factor = 1.0
    winch_speed: Factor = 1.0
    mass: Factor = 1.0

    def changed(self) -> dict[str, float]:
        """The scales that differ from 1, for provenance."""
        return {name: value for name, value in self.model_dump().items() if value != 1.0}


def scaled(model: mujoco.MjModel, robot: Robot, parameters: PlantParameters) -> mujoco.MjModel:
    """A copy of the compiled model with the scales applied."""
    model = model.__copy__()
    if not parameters.changed():
        return model
    for friction in (model.geom_friction, model.pair_friction):
        friction[:] *= parameters.friction
    for solref in (model.geom_solref, model.pair_solref, model.pair_solreffriction):
        _scale_contact(solref, parameters.contact_stiffness)
    _scale_cables(model, parameters)
    _scale_winches(model, robot, parameters.winch_speed)
    model.body_mass[:] *= parameters.mass
    model.body_inertia[:] *= parameters.mass
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _scale_contact(solref: np.ndarray, scale: float) -> None:
    """Scale the stiffness of (n, 2) contact references, in either of MuJoCo's two formats."""
    direct = solref[:, 0] < 0  # (-stiffness, -damping); else (time constant, damping ratio)
    root = np.sqrt(scale)
    solref[direct] *= (scale, root)
    solref[~direct] *= (1.0 / root, 1.0)


def _scale_cables(model: mujoco.MjModel, parameters: PlantParameters) -> None:
    """Scale tendons' springs and dampers, and the same terms of the actuators on tendons."""
    stiffness, damping = parameters.cable_stiffness, parameters.cable_damping
    model.tendon_stiffness[:] *= stiffness
    model.tendon_stiffnesspoly[:] *= stiffness
    model.tendon_damping[:] *= damping
    model.tendon_dampingpoly[:] *= damping
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    springs = on_tendon & (model.actuator_biasprm[:, 1] != 0)  # others take tensions
    model.actuator_gainprm[springs, 0] *= stiffness
    model.actuator_biasprm[springs, :2] *= stiffness
    model.actuator_biasprm[on_tendon, 2] *= damping


def _scale_winches(model: mujoco.MjModel, robot: Robot, scale: float) -> None:
    """Let position winches lag less; `Plant` scales the commands of rate winches."""
    for winch in robot.winches:
        if winch.kind != "rate":
            model.actuator_dynprm[list(winch.actuators), 0] /= scale
