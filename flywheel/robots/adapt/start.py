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
from flywheel.robots.winches import kind_of


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
            if kind_of(model, actuator) == "tension":
                given[name] = float(np.clip(weight_of(model) / _lift(model, data), low, high))
                edits.append(f"tension of {name!r} {given[name]:.6g} N")
                continue
            stretch = pull / len(winched) / float(model.actuator_gainprm[actuator, 0])
            given[name] = float(np.clip(draft.rests.get(name, length - stretch), low, high))
            edits.append(f"rest length of {name!r} {given[name]:.6g} m")
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
    takes = {name: kind_of(model, a) for a, name in winched}
    for name, rest in given.items():
        keys.act[0][name] = rest
        keys.ctrl[0][name] = 0.0 if takes[name] == "rate" else rest
    keys.write(draft)
    reason = (
        "Every reset begins at the first keyframe, and winches with act 0 would pull everything in."
    )
    if pull and not draft.rests:
        reason += " All winches together pull as much as it weighs."
    yield Change(tuple(edits), reason, Certainty.GUESS)


def with_key(xml: str, qpos: Floats, act: Floats) -> str:
    """An MJCF with another first keyframe, "settled", at rest with a pose and rest lengths, all digits kept.

    Args:
      xml: of a robot.
      qpos: (nq,) its pose.
      act: (na,) its rest lengths [m].
    """
    root = parsed(xml, "The MJCF", comments=True)
    key = next(root.iter("key"))
    model = compiled(xml)[2]
    ctrl = model.key_ctrl[0].copy()
    for actuator, _ in actuators(model):
        if kind_of(model, actuator) in ("position", "tension"):
            ctrl[actuator] = act[model.actuator_actadr[actuator]]
    key.attrib.pop("qvel", None)
    key.attrib |= {"name": "settled", "qpos": digits(*qpos)}
    key.attrib |= {k: digits(*v) for k, v in (("act", act), ("ctrl", ctrl)) if len(v)}
    return ElementTree.tostring(root, encoding="unicode")


def with_steps(xml: str, integrator: str, timestep: float) -> str:
    """An MJCF with another integrator and time step [s]."""
    root = parsed(xml, "The MJCF", comments=True)
    option = root.find("option")
    option = ElementTree.SubElement(root, "option") if option is None else option
    option.attrib |= {"timestep": digits(timestep), "integrator": integrator}
    return ElementTree.tostring(root, encoding="unicode")


def _limits(model: mujoco.MjModel, actuator: int) -> tuple[float, float]:
    """Least and largest rest length [m], or tension [N], with which a winch may start."""
    low, high = 1e-9, np.inf
    if model.actuator_actlimited[actuator]:
        low, high = map(float, model.actuator_actrange[actuator])
    if kind_of(model, actuator) in ("position", "tension"):
        control = model.actuator_ctrlrange[actuator]
        low, high = max(low, float(control[0])), min(high, float(control[1]))
    return low, max(low, high)


def _lift(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Sum of the cosines between the winched cables to fixed points and the vertical; at least their number
    if they do not lift.
    """
    found, cables = 0.0, [int(model.actuator_trnid[a, 0]) for a, _ in actuators(model)]
    for cable in cables:
        sites = model.wrap_objid[model.tendon_adr[cable] : model.tendon_adr[cable] + 2]
        fixed = model.body_weldid[model.site_bodyid[sites]] == 0
        rise = float(np.diff(data.site_xpos[sites, 2])[0])
        if fixed.sum() == 1:
            found += (rise if fixed[1] else -rise) / max(float(data.ten_length[cable]), 1e-9)
    return found if found > 0 else float(len(cables))


def _pull(model: mujoco.MjModel) -> float:
    """Tension of all winches together [N]: the weight, or none if springs are taut anyway."""
    lengths = at_start(model).ten_length
    taut = (model.tendon_stiffness > 0) & (lengths > model.tendon_lengthspring[:, 1])
    return 0.0 if taut.any() else weight_of(model)
