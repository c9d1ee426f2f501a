"""Small changes of mechanical states, as vectors with one entry per velocity."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.dynamics.plant.plant import Plant
from flywheel.records import Floats, State

TURNS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL)
FREE_LINEAR = 3


def moved(plant: Plant, state: State, position: Floats, velocity: Floats) -> State:
    """States (n,) whose positions were moved by (n, nv) and whose velocities changed by (n, nv).

    Positions move along the tangent: metres, and turns as rotation vectors in the body's frame.
    """
    qpos = np.array(state.qpos)
    for row, change in zip(qpos, position, strict=True):
        mujoco.mj_integratePos(plant.model, row, change, 1.0)
    return State(qpos, state.qvel + velocity, state.act)


def between(plant: Plant, origin: State, state: State) -> tuple[Floats, Floats]:
    """The change from states `origin` (n,) to `state` (n,), inverse of `moved`: two arrays (n, nv)."""
    change = np.empty_like(origin.qvel)
    for row, start, end in zip(change, origin.qpos, state.qpos, strict=True):
        mujoco.mj_differentiatePos(plant.model, row, 1.0, start, end)
    return change, state.qvel - origin.qvel


def turning(plant: Plant) -> np.ndarray:
    """(nv,) bool: True for angles in a change; the others are lengths."""
    model = plant.model
    angles = np.zeros(model.nv, bool)
    for joint in range(model.njnt):
        first = model.jnt_dofadr[joint]
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            angles[first + FREE_LINEAR : first + 2 * FREE_LINEAR] = True
        elif model.jnt_type[joint] in TURNS:
            last = model.jnt_dofadr[joint + 1] if joint + 1 < model.njnt else model.nv
            angles[first:last] = True
    return angles
