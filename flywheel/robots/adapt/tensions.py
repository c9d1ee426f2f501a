"""Motors that give tensions, on the tendons of springs or alone, written as winches.

A spring of stiffness k and rest length L, and a motor of gear G, gain g and bias b0 + b1 length + b2 speed
that is told a, pull together as one spring of stiffness K = k - G^2 b1 and of the rest length
r = (k L + G g a + G b0) / K: a winch. That holds as long as the spring is taut, and always for one that
pushes as well. Most such motors give a tension (b1 = 0); servos are taken for them where their own rest
lengths would be below 0. A motor without a spring is a winch that takes the tension -G g a - G b0.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import mujoco

from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    Keys,
    Scale,
    actuators,
    digits,
    general,
    weight_of,
)
from flywheel.robots.adapt.proof import apart, certainty_of, evidence_of
from flywheel.robots.adapt.servos import commands, dynamics, scaled
from flywheel.robots.cables import curved
from flywheel.robots.winches import kind_of

NO_BIAS, AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


def tensions(draft: Draft) -> Iterator[Change]:
    """Springs with one motor each, as winches."""
    before, edits, scales = draft.model, [], {}
    keys = Keys.of(before)
    several = [int(before.actuator_trnid[a, 0]) for a, _ in actuators(before)]
    for actuator, name in actuators(before):
        tendon = int(before.actuator_trnid[actuator, 0])
        winch, follows = _Sprung.of(before, actuator, tendon), dynamics(before, actuator)
        if winch is None or follows is None or several.count(tendon) > 1:
            continue
        scale, gear = winch.scale, before.actuator_gear[actuator, 0]
        attributes = {
            **follows,
            "gear": "1",
            "gainprm": digits(winch.stiffness),
            "biastype": "affine",
            "biasprm": digits(
                0.0, -winch.stiffness, gear**2 * before.actuator_biasprm[actuator, 2]
            ),
            "forcelimited": "false",
            **_limits(before, actuator, tendon, scale),
        }
        general(draft, before, actuator, **attributes)
        cable = draft.named("tendon", before.tendon(tendon).name)
        cable.attrib |= {"stiffness": "0", "springlength": "0"}
        scales[name] = scale
        draft.rests[name] = float(before.tendon_lengthspring[tendon, 1])
        keys.rescale(name, scale, scale)
        shown = " ".join(f'{key}="{value}"' for key, value in attributes.items() if key != "gear")
        edits.append(f"{name!r} {shown}{commands(scale)}")
    if edits:
        keys.write(draft)
        distance = apart(before, draft.model, scales)
        reason = "A spring that is pulled with another tension is a spring of another rest length."
        yield Change(tuple(edits), reason, certainty_of(distance), evidence_of(distance))


def alone(draft: Draft) -> Iterator[Change]:
    """Motors on tendons without a spring, as winches that take tensions."""
    before, edits, scales, pushes = draft.model, [], {}, False
    keys = Keys.of(before)
    several = [int(before.actuator_trnid[a, 0]) for a, _ in actuators(before)]
    for actuator, name in actuators(before):
        scale, follows = _scale_alone(before, actuator), dynamics(before, actuator)
        one = several.count(int(before.actuator_trnid[actuator, 0])) == 1
        if scale is None or follows is None or not one:
            continue
        low, high = _pulls(before, actuator, scale)
        if high <= 0:
            continue
        pushes |= low < 0
        gear = before.actuator_gear[actuator, 0]
        attributes = {
            **follows,
            "gear": "1",
            "gainprm": "-1",
            "biastype": "affine",
            "biasprm": digits(0.0, 0.0, gear**2 * before.actuator_biasprm[actuator, 2]),
            "ctrllimited": "true",
            "ctrlrange": digits(max(low, 0.0), high),
            "actlimited": "false",
            "forcelimited": "true",
            "forcerange": digits(-high, 0.0),
        }
        general(draft, before, actuator, **attributes)
        scales[name] = scale
        keys.rescale(name, scale, scale)
        edits.append(f'{name!r} ctrlrange="{attributes["ctrlrange"]}"{commands(scale)}')
    if edits:
        keys.write(draft)
        distance = apart(before, draft.model, scales)
        reason = (
            "A motor without a spring is a winch that takes its tension [N]; a cable does not push."
        )
        certainty = Certainty.GUESS if pushes else certainty_of(distance)
        yield Change(tuple(edits), reason, certainty, evidence_of(distance))


def _scale_alone(model: mujoco.MjModel, actuator: int) -> Scale | None:
    """From a motor's activation or command to its tension [N]; None unless it gives one, without a spring."""
    tendon, kind = int(model.actuator_trnid[actuator, 0]), kind_of(model, actuator)
    constant, per_length, per_speed = map(float, model.actuator_biasprm[actuator, :3])
    affine = int(model.actuator_biastype[actuator]) in (NO_BIAS, AFFINE)
    alone = model.tendon_stiffness[tendon] == 0 and not curved(model, tendon)
    if not (affine and alone) or per_length or per_speed > 0 or kind in ("rate", "tension"):
        return None
    gear, gain = model.actuator_gear[actuator, 0], model.actuator_gainprm[actuator, 0]
    return Scale(float(-gear * gain), float(-gear * constant))


def _pulls(model: mujoco.MjModel, actuator: int, scale: Scale) -> tuple[float, float]:
    """Least and largest tension of a motor [N]; up to the robot's weight without limits."""
    ranges = []
    if model.actuator_ctrllimited[actuator]:
        ranges.append(scaled(model.actuator_ctrlrange[actuator], scale))
    if model.actuator_forcelimited[actuator]:
        gear = float(model.actuator_gear[actuator, 0])
        ranges.append(scaled(model.actuator_forcerange[actuator], Scale(-gear)))
    if not ranges:
        return -1.0, weight_of(model)
    return max(low for low, _ in ranges), min(high for _, high in ranges)


class _Sprung(NamedTuple):
    """A motor and its spring as a winch.

    Attributes:
      stiffness: of both [N/m].
      scale: from the motor's activation or command to the rest length [m].
    """

    stiffness: float
    scale: Scale

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int, tendon: int) -> _Sprung | None:
        """Such a winch; None for other motors, and for those that are winches by themselves."""
        low, rest = map(float, model.tendon_lengthspring[tendon])
        spring, gear = (
            float(model.tendon_stiffness[tendon]),
            float(model.actuator_gear[actuator, 0]),
        )
        constant, per_length, per_speed = map(float, model.actuator_biasprm[actuator, :3])
        rates = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_INTEGRATOR
        if (
            spring <= 0
            or curved(model, tendon)
            or low not in (0.0, rest)
            or per_length > 0
            or per_speed > 0
            or rates
        ):
            return None
        if per_length < 0 and not _below_zero(model, actuator):
            return None
        stiffness, gain = spring - gear**2 * per_length, float(model.actuator_gainprm[actuator, 0])
        offset = (spring * rest + gear * constant) / stiffness
        return cls(stiffness, Scale(gear * gain / stiffness, offset))


def _below_zero(model: mujoco.MjModel, actuator: int) -> bool:
    """True for a servo without limits of its force that can be told to have a rest length below 0."""
    gain, constant = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, 0]
    scale = Scale(float(gain), float(constant))
    pull = scaled(model.actuator_ctrlrange[actuator], scale)
    gear = model.actuator_gear[actuator, 0]
    unlimited = not model.actuator_forcelimited[actuator]
    return bool(
        model.actuator_ctrllimited[actuator] and unlimited and min(gear * p for p in pull) < 0
    )


def _limits(model: mujoco.MjModel, actuator: int, tendon: int, scale: Scale) -> dict[str, str]:
    """The range of rest lengths, from those of commands and forces."""
    rest, stiffness = model.tendon_lengthspring[tendon, 1], model.tendon_stiffness[tendon]
    ranges = []
    if model.actuator_ctrllimited[actuator]:
        ranges.append(scaled(model.actuator_ctrlrange[actuator], scale))
    if model.actuator_forcelimited[actuator]:
        force = Scale(float(model.actuator_gear[actuator, 0] / stiffness), float(rest))
        ranges.append(scaled(model.actuator_forcerange[actuator], force))
    if not ranges:
        return {"ctrllimited": "false"}
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    return {"ctrllimited": "true", "ctrlrange": digits(low, max(low, high))}
