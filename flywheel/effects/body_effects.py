"""Effects on the bodies: drag and mass."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.effects.effect import ModelEffect, Numbers, Parameter
from flywheel.robots import Robot, moving_bodies

LINEAR = 3  # a free joint's first velocities are linear


class AirDrag(ModelEffect):
    """Linear drag on every free body, as of air or a hose."""

    name = "air_drag"
    sizes = (Parameter("drag", "N s/m", lambda s: 0.1 * s.weight * s.time / s.length / s.bodies),)
    equation = "F = -c v of each body"
    source = "Stokes' law"
    shown_by = "swinging or rolling fast"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        free = model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        for first in model.jnt_dofadr[free]:
            model.dof_damping[first : first + LINEAR] += values["drag"]


class Payload(ModelEffect):
    """Point mass missing from the MJCF, at a tracked point."""

    name = "payload"
    where = "point"
    moves_mass = True
    sizes = (Parameter("mass", "kg", lambda s: 0.02 * s.mass),)
    equation = "m at the point, with its weight and inertia"
    source = "Steiner's theorem"
    shown_by = "lifting the point, and fast strokes"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        point = robot.points[place]
        body, site = moving_bodies(model)[point.body], point.offset
        old, extra = float(model.body_mass[body]), values["mass"]
        centre = model.body_ipos[body].copy()
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes = turn.reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        total = old + extra
        together = (old * centre + extra * site) / total
        inertia = inertia + _about(old, centre - together) + _about(extra, site - together)
        model.body_mass[body], model.body_ipos[body] = total, together
        _set_inertia(model, body, inertia)


class BodyMass(ModelEffect):
    """Bodies heavier or lighter than in the MJCF, all by the same fraction."""

    name = "body_mass"
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-15.0, high=40.0),)
    equation = "m (1 + s), I (1 + s) of every body"
    source = "Newton's second law"
    shown_by = "drops and fast strokes"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        model.body_mass[:] *= 1.0 + values["share"]
        model.body_inertia[:] *= 1.0 + values["share"]


def _about(mass: float, arm: np.ndarray) -> np.ndarray:
    """Inertia (3, 3) of a point mass at an arm [kg m^2]."""
    return mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))


def _set_inertia(model: mujoco.MjModel, body: int, inertia: np.ndarray) -> None:
    moments, axes = np.linalg.eigh(inertia)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    model.body_inertia[body] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())
