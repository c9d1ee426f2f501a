"""Servos on tendons, written as winches: their tension as a stiffness times stretch beyond a rest length.

With gear G, gain g and bias b0 + b1 length + b2 speed (both times G), an actuator whose activation or
command is a pulls with

    G g a + G b0 + G^2 b1 length + G^2 b2 speed = K (r - length) - C speed,

K = -G^2 b1, C = -G^2 b2, with the rest length r = (G g a + G b0) / K: a winch, whose commands and
activations are such rest lengths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    Keys,
    Scale,
    actuators,
    digits,
    general,
)
from flywheel.robots.adapt.proof import apart, evidence_of, exact_change

NONE, FILTER, EXACT, INTEGRATOR = (
    int(getattr(mujoco.mjtDyn, f"mjDYN_{kind}"))
    for kind in ("NONE", "FILTER", "FILTEREXACT", "INTEGRATOR")
)


def joined(draft: Draft) -> Iterator[Change]:
    """One actuator for a tendon that has a stiff one and dampers, whose commands are taken to be 0."""
    before = draft.model
    on: dict[int, list[int]] = {}
    for actuator, _ in actuators(before):
        on.setdefault(int(before.actuator_trnid[actuator, 0]), []).append(actuator)
    edits = []
    keys = Keys.of(before)
    for several in on.values():
        stiff = [a for a in several if before.actuator_biasprm[a, 1] < 0]
        dampers = [a for a in several if _damps(before, a)]
        if len(stiff) != 1 or not dampers or len(stiff) + len(dampers) != len(several):
            continue
        gears = before.actuator_gear[:, 0]
        extra = sum(float(before.actuator_biasprm[a, 2] * gears[a] ** 2) for a in dampers)
        bias = before.actuator_biasprm[stiff[0], :3].copy()
        bias[2] += extra / gears[stiff[0]] ** 2
        general(draft, before, stiff[0], biasprm=digits(*bias))
        for damper in dampers:
            _take_out(draft, before.actuator(damper).name)
        names = ", ".join(repr(before.actuator(a).name) for a in dampers)
        edits.append(f"{names} as the damping of {before.actuator(stiff[0]).name!r}")
    if edits:
        keys.write(draft)
        evidence = evidence_of(apart(before, draft.model, {}))
        reason = "A cable has one winch. The commands of the dampers are taken to be 0."
        yield Change(tuple(edits), reason, Certainty.GUESS, evidence)


def _damps(model: mujoco.MjModel, actuator: int) -> bool:
    bias = model.actuator_biasprm[actuator]
    at_once = model.actuator_dyntype[actuator] == NONE
    return bool(at_once and bias[0] == 0 and bias[1] == 0 and bias[2] < 0)


def _take_out(draft: Draft, name: str) -> None:
    """Remove an actuator, with the sensors of it and its places in tuples."""
    draft.remove(draft.named("actuator", name))
    for sensor in draft.elements("sensor"):
        if name in (sensor.get("actuator"), sensor.get("objname")):
            draft.remove(sensor)
    for element in list(draft.root.iter("element")):
        if element.get("objtype") == "actuator" and element.get("objname") == name:
            draft.remove(element)


@dataclass(frozen=True)
class _Servo:
    """An actuator on a tendon as a winch.

    Attributes:
      stiffness: [N/m].
      damping: [N s/m].
      scale: from its activation, or its command without one, to the rest length [m].
      gear: by which its forces are multiplied.
      dynamics: attributes of how it follows its commands.
    """

    stiffness: float
    damping: float
    scale: Scale
    gear: float
    dynamics: dict[str, str]

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int) -> _Servo | None:
        """A servo, or None for something that is no winch, or is one already."""
        gear = float(model.actuator_gear[actuator, 0])
        gain = float(model.actuator_gainprm[actuator, 0])
        constant, per_length, per_speed = map(float, model.actuator_biasprm[actuator, :3])
        stiffness = -(gear**2) * per_length
        known = int(model.actuator_dyntype[actuator]) in (NONE, FILTER, EXACT, INTEGRATOR)
        one_number = model.actuator_ctrlnum[actuator] == 1 and model.actuator_actnum[actuator] <= 1
        affine = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
        follows = dynamics(model, actuator)
        if not (known and one_number and affine and stiffness > 0) or follows is None:
            return None
        scale = Scale(gear * gain / stiffness, gear * constant / stiffness)
        if scale == (1.0, 0.0) and gear == 1 and not follows:
            return None
        return cls(stiffness, -(gear**2) * per_speed, scale, gear, follows)

    def attributes(self, model: mujoco.MjModel, actuator: int) -> dict[str, str]:
        """Those of the winch."""
        rate = model.actuator_dyntype[actuator] == INTEGRATOR
        rest, pay = self.scale, Scale(self.scale.factor)
        return {
            **self.dynamics,
            "gear": "1",
            "gainprm": digits(self.stiffness),
            "biasprm": digits(0.0, -self.stiffness, -self.damping),
            **_written("ctrlrange", model.actuator_ctrlrange[actuator], pay if rate else rest),
            **_written("actrange", model.actuator_actrange[actuator], rest),
            **_written("forcerange", model.actuator_forcerange[actuator], Scale(self.gear)),
        }


def dynamics(model: mujoco.MjModel, actuator: int) -> dict[str, str] | None:
    """Changes of how a servo follows its commands, so that it is a winch; None if it cannot be one."""
    kind, lag = model.actuator_dyntype[actuator], float(model.actuator_dynprm[actuator, 0])
    if kind == NONE:
        return {"dyntype": "filterexact", "dynprm": "0", "actearly": "true"}
    if kind == FILTER:
        step = model.opt.timestep
        if lag < step:
            return None
        exact = -step / np.log1p(-step / lag) if lag > step else 0.0
        return {"dyntype": "filterexact", "dynprm": digits(exact)}
    return {}


def scaled(limits: np.ndarray, scale: Scale) -> tuple[float, float]:
    """A range after a change of scale, the lower end first."""
    low, high = sorted(float(scale.factor * end + scale.offset) for end in limits)
    return low, high


def _written(attribute: str, limits: np.ndarray, scale: Scale) -> dict[str, str]:
    return {attribute: digits(*scaled(limits, scale))} if limits.any() else {}


def as_winches(draft: Draft) -> Iterator[Change]:
    """Servos with gears, offsets, other gains or no lag, and with MuJoCo's older lag, as winches."""
    before, edits, scales = draft.model, [], {}
    keys = Keys.of(before)
    for actuator, name in actuators(before):
        servo = _Servo.of(before, actuator)
        if servo is None or servo.scale.factor == 0:
            continue
        rate = before.actuator_dyntype[actuator] == INTEGRATOR
        scales[name] = servo.scale
        attributes = servo.attributes(before, actuator)
        general(draft, before, actuator, **attributes)
        pay = Scale(servo.scale.factor) if rate else servo.scale
        keys.rescale(name, servo.scale, pay)
        words = " ".join(f'{key}="{value}"' for key, value in attributes.items() if key != "gear")
        edits.append(f"{name!r} {words}{commands(pay)}")
    if not edits:
        return
    keys.write(draft)
    reason = "The same tensions, written as a stiffness times the stretch beyond a rest length."
    yield exact_change(before, draft.model, scales, edits, reason)


def commands(scale: Scale) -> str:
    """The old commands in the new ones, if they differ."""
    if scale == (1.0, 0.0):
        return ""
    offset = f" {scale.offset:+.6g}" if scale.offset else ""
    return f" (its commands: old ones times {scale.factor:.6g}{offset})"
