"""A robot whose gravity is along another axis than -z, turned with its world."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots.adapt.draft import Change, Draft, digits
from flywheel.robots.adapt.proof import apart, certainty_of, evidence_of, refuse_apart
from flywheel.robots.mjcf_reader import UPRIGHT, gravity_of

ALONG = {  # unit quaternions that turn an axis upwards, by the axis along which gravity is not
    (1, 0, 0): (0.5**0.5, 0.0, -(0.5**0.5), 0.0),
    (-1, 0, 0): (0.5**0.5, 0.0, 0.5**0.5, 0.0),
    (0, 1, 0): (0.5**0.5, 0.5**0.5, 0.0, 0.0),
    (0, -1, 0): (0.5**0.5, -(0.5**0.5), 0.0, 0.0),
    (0, 0, -1): (0.0, 1.0, 0.0, 0.0),
}
TURNED = ("gravity", "wind", "magnetic")  # of <option>


def upright(draft: Draft) -> Iterator[Change]:
    """The world turned so that z is up, if another axis is."""
    before = draft.model
    gravity = gravity_of(before)
    strength = float(np.linalg.norm(gravity))
    up = -gravity / max(strength, 1e-9)
    axis = tuple(round(each) for each in up.tolist())
    if axis not in ALONG or np.abs(up - axis).max() > UPRIGHT or before.nmocap:
        return
    turn = np.array(ALONG[axis])
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, turn)
    matrix = np.round(matrix.reshape(3, 3))  # of a quarter or half turn: zeros and ones
    for world in draft.root.findall("worldbody"):
        inside = list(world)
        frame = ElementTree.SubElement(world, "frame", {"quat": digits(*turn)})
        for child in inside:
            world.remove(child)
            frame.append(child)
    _turn_options(draft, before, matrix)
    _turn_keys(draft, before, turn, matrix)
    both = [copy(before), copy(draft.model)]
    for model in both:  # pyramids of friction have directions, which do not turn with the world
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    distance = apart(both[0], both[1], {}, turn=matrix)
    name = f"{'+-'[min(axis) < 0]}{'xyz'[int(np.abs(axis).argmax())]}"
    edits = (
        f'<frame quat="{digits(*turn)}"> around the world, gravity and keyframes turned with it',
    )
    reason = f"{name} was up; recordings, grounds and tasks have z up."
    refuse_apart(distance, edits)
    evidence = f"Without contacts: {evidence_of(distance)}"
    yield Change(edits, reason, certainty_of(distance), evidence)


def _turn_options(draft: Draft, model: mujoco.MjModel, matrix: Floats) -> None:
    option = draft.section("option")
    for other in draft.root.findall("option"):  # the last one that has it counts
        for kind in TURNED:
            other.attrib.pop(kind, None)
    for kind in TURNED:
        option.set(kind, digits(*(matrix @ getattr(model.opt, kind) + 0.0)))


def _turn_keys(draft: Draft, model: mujoco.MjModel, turn: Floats, matrix: Floats) -> None:
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    for key, qpos, qvel in zip(draft.elements("key"), model.key_qpos, model.key_qvel, strict=True):
        qpos, qvel = qpos.copy(), qvel.copy()
        for place, velocity in zip(model.jnt_qposadr[free], model.jnt_dofadr[free], strict=True):
            qpos[place : place + 3] = matrix @ qpos[place : place + 3]
            turned = np.zeros(4)
            mujoco.mju_mulQuat(turned, turn, qpos[place + 3 : place + 7])
            qpos[place + 3 : place + 7] = turned
            qvel[velocity : velocity + 3] = matrix @ qvel[velocity : velocity + 3]
        key.set("qpos", digits(*(qpos + 0.0)))
        if qvel.any():
            key.set("qvel", digits(*(qvel + 0.0)))
