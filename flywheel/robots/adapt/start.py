"""The first keyframe: one that MuJoCo takes, with rest lengths that the winches can have."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import MjcfError
from flywheel.records import Floats
from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    Keys,
    actuators,
    at_start,
    digits,
    weight_of,
)
from flywheel.robots.mjcf_source import compiled, parsed
from flywheel.robots.winches import KINDS


def fitting(draft: Draft) -> Iterator[Change]:
    """Keyframes without the numbers that do not fit the MJCF's joints and actuators."""
    edits = []
    for _ in range(3 * len(draft.elements("key"))):
        try:
            draft.model  # noqa: B018  which MuJoCo compiles
            break
        except MjcfError as error:
            doomed = _misfit(draft, str(error))
            if doomed is None:
                break
            key, attribute = doomed
            del key.attrib[attribute]
            edits.append(f"no {attribute} in the keyframe {key.get('name', '')!r}")
    if edits:
        reason = "There are more or fewer numbers than the MJCF's joints and actuators have."
        yield Change(tuple(edits), reason, Certainty.CERTAIN)


def _misfit(draft: Draft, error: str) -> tuple[ElementTree.Element, str] | None:
    for attribute in ("qpos", "qvel", "act", "ctrl"):
        if f"invalid {attribute} size" in error:
            for key in draft.elements("key"):
                name = key.get("name")
                if attribute in key.attrib and (not name or f"'{name}'" in error):
                    return key, attribute
    return None


def start(draft: Draft) -> Iterator[Change]:
    """A first keyframe in which each winch has a rest length that it can have."""
    model = draft.model
    winched = [(a, name) for a, name in actuators(model) if model.actuator_actadr[a] >= 0]
    if not winched and not model.nkey:
        key = {"name": "start", "qpos": digits(*model.qpos0)}
        ElementTree.SubElement(draft.section("keyframe"), "key", key)
        reason = "Every reset begins at the first keyframe."
        yield Change(("the pose of the MJCF",), reason, Certainty.CERTAIN)
    if not winched:
        return
    data, pull = at_start(model), _pull(model)
    edits, given = [], {}
    for actuator, name in winched:
        length = float(data.ten_length[model.actuator_trnid[actuator, 0]])
        low, high = _limits(model, actuator)
        now = float(data.act[model.actuator_actadr[actuator]])
        if not model.nkey or not low <= now <= high:
            stretch = pull / len(winched) / float(model.actuator_gainprm[actuator, 0])
            given[name] = float(np.clip(draft.rests.get(name, length - stretch), low, high))
            edits.append(f"{name!r} {given[name]:.6g} m")
    if not model.nkey:
        attributes = {"name": "start", "qpos": digits(*model.qpos0)}
        ElementTree.SubElement(draft.section("keyframe"), "key", attributes)
        names = [model.actuator(a).name for a in range(model.nu)]
        keys = Keys(({},), (dict.fromkeys(names, 0.0),))
        keys.act[0].update(dict.fromkeys(names, 0.0))
    else:
        keys = Keys.of(model)
    if not given:
        return
    takes = {name: KINDS.get(int(model.actuator_dyntype[a])) for a, name in winched}
    for name, rest in given.items():
        keys.act[0][name] = rest
        keys.ctrl[0][name] = rest if takes[name] == "position" else 0.0
    keys.write(draft)
    reason = (
        "Every reset begins at the first keyframe, and winches with act 0 would pull everything in."
    )
    if pull and not draft.rests:
        reason += " All winches together pull as much as it weighs."
    yield Change(tuple(f"rest length of {each}" for each in edits), reason, Certainty.GUESS)


def with_key(xml: str, name: str, qpos: Floats, act: Floats) -> str:
    """An MJCF with another first keyframe, at rest at a pose and with rest lengths, all digits kept.

    Args:
      xml: of a robot.
      name: of the keyframe.
      qpos: (nq,) its pose.
      act: (na,) its rest lengths [m].
    """
    root = parsed(xml, "The MJCF", comments=True)
    key = next(root.iter("key"))
    model = compiled(xml)[2]
    ctrl = model.key_ctrl[0].copy()
    for actuator, _ in actuators(model):
        if KINDS.get(int(model.actuator_dyntype[actuator])) == "position":
            ctrl[actuator] = act[model.actuator_actadr[actuator]]
    key.attrib.pop("qvel", None)
    key.attrib |= {"name": name, "qpos": digits(*qpos)}
    key.attrib |= {k: digits(*v) for k, v in (("act", act), ("ctrl", ctrl)) if len(v)}
    return ElementTree.tostring(root, encoding="unicode")


def _limits(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Least and largest rest length with which a winch may start [m]."""
    low, high = 1e-9, np.inf
    if model.actuator_actlimited[actuator]:
        low, high = map(float, model.actuator_actrange[actuator])
    if KINDS.get(int(model.actuator_dyntype[actuator])) == "position":
        control = model.actuator_ctrlrange[actuator]
        low, high = max(low, float(control[0])), min(high, float(control[1]))
    return low, max(low, high)


def _pull(model: mujoco.MjModel) -> float:
    """Tension of all winches together [N]: the weight, or none if springs are taut anyway."""
    lengths = at_start(model).ten_length
    taut = (model.tendon_stiffness > 0) & (lengths > model.tendon_lengthspring[:, 1])
    return 0.0 if taut.any() else weight_of(model)
