"""Motors that give tensions, on the tendons of springs or alone, written as winches.

A spring of stiffness k and rest length L, and a motor of gear G, gain g and bias b0 + b1 length + b2 speed
that is told a, pull together as one spring of stiffness K = k - G^2 b1 and of the rest length
r = (k L + G g a + G b0) / K: a winch. That holds as long as the spring is taut, and always for one that
pushes as well. Most such motors give a tension (b1 = 0); servos are taken for them where their own rest
lengths would be below 0. A motor without a spring is a winch that takes the tension -G g a - G b0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
from flywheel.robots.winches import follows_speed, kind_of

NO_BIAS, AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


def tensions(draft: Draft) -> Iterator[Change]:
    """Springs with one motor each, as winches."""
    reason = "A spring that is pulled with another tension is a spring of another rest length."
    yield from _rewritten(draft, _sprung, reason)


def alone(draft: Draft) -> Iterator[Change]:
    """Motors on tendons without a spring, as winches that take tensions."""
    reason = (
        "A motor without a spring is a winch that takes its tension [N]; a cable does not push."
    )
    yield from _rewritten(draft, _alone, reason)


class _Winch(NamedTuple):
    """A motor as a winch.

    Attributes:
      stiffness: of the winch and the spring that it takes in [N/m]; 0 for one that takes tensions.
      scale: from the motor's activation or command to the rest length [m] or the tension [N].
      limits: attributes of its ranges.
      pushes: True for a motor that can push as well, and a winch that cannot.
    """

    stiffness: float
    scale: Scale
    limits: dict[str, str]
    pushes: bool = False


def _rewritten(
    draft: Draft, winch_of: Callable[[mujoco.MjModel, int], _Winch | None], reason: str
) -> Iterator[Change]:
    """Every motor that is a winch, as one, where its tendon has no other motor."""
    before, edits, scales, pushes = draft.model, [], {}, False
    keys = Keys.of(before)
    tendons = [int(before.actuator_trnid[a, 0]) for a, _ in actuators(before)]
    for (actuator, name), tendon in zip(actuators(before), tendons, strict=True):
        winch, follows = winch_of(before, actuator), dynamics(before, actuator)
        if winch is None or follows is None or tendons.count(tendon) > 1:
            continue
        per_speed = before.actuator_gear[actuator, 0] ** 2 * before.actuator_biasprm[actuator, 2]
        attributes = {
            **follows,
            "gainprm": digits(winch.stiffness or -1.0),
            "biastype": "affine",
            "biasprm": digits(0.0, -winch.stiffness, per_speed),
            **winch.limits,
        }
        general(draft, before, actuator, gear="1", **attributes)
        if winch.stiffness:
            cable = draft.named("tendon", before.tendon(tendon).name)
            cable.attrib |= {"stiffness": "0", "springlength": "0"}
            draft.rests[name] = float(before.tendon_lengthspring[tendon, 1])
        scales[name] = winch.scale
        pushes |= winch.pushes
        keys.rescale(name, winch.scale, winch.scale)
        shown = " ".join(f'{key}="{value}"' for key, value in attributes.items())
        edits.append(f"{name!r} {shown}{commands(winch.scale)}")
    if edits:
        keys.write(draft)
        distance = apart(before, draft.model, scales)
        certainty = Certainty.GUESS if pushes else certainty_of(distance)
        yield Change(tuple(edits), reason, certainty, evidence_of(distance))


def _alone(model: mujoco.MjModel, actuator: int) -> _Winch | None:
    """A motor that gives a tension, without a spring; None for others, such as one that never pulls."""
    tendon, kind = int(model.actuator_trnid[actuator, 0]), kind_of(model, actuator)
    constant, per_length, per_speed = map(float, model.actuator_biasprm[actuator, :3])
    affine = int(model.actuator_biastype[actuator]) in (NO_BIAS, AFFINE)
    alone = model.tendon_stiffness[tendon] == 0 and not curved(model, tendon)
    if not (affine and alone) or per_length or per_speed > 0 or kind in ("rate", "tension"):
        return None
    if follows_speed(model, actuator):  # its commands are no tensions
        return None
    gear, gain = map(float, (model.actuator_gear[actuator, 0], model.actuator_gainprm[actuator, 0]))
    scale = Scale(-gear * gain, -gear * constant)
    low, high = _range(model, actuator, scale, Scale(-gear)) or (-1.0, weight_of(model))
    if high <= 0:
        return None
    limits = {
        "ctrllimited": "true",
        "ctrlrange": digits(max(low, 0.0), high),
        "actlimited": "false",
        "forcelimited": "true",
        "forcerange": digits(-high, 0.0),
    }
    return _Winch(0.0, scale, limits, low < 0)


def _sprung(model: mujoco.MjModel, actuator: int) -> _Winch | None:
    """A motor and its spring; None for other motors, and for those that are winches by themselves."""
    tendon = int(model.actuator_trnid[actuator, 0])
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
    scale = Scale(gear * gain / stiffness, offset)
    told = _range(model, actuator, scale, Scale(gear / spring, rest))
    limits = {"forcelimited": "false", "ctrllimited": "true" if told else "false"}
    if told:
        limits["ctrlrange"] = digits(told[0], max(told))
    return _Winch(stiffness, scale, limits)


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


def _range(
    model: mujoco.MjModel, actuator: int, told: Scale, force: Scale
) -> tuple[float, float] | None:
    """Range for a winch, from a motor's ranges of commands and of forces; None without any."""
    ranges = []
    if model.actuator_ctrllimited[actuator]:
        ranges.append(scaled(model.actuator_ctrlrange[actuator], told))
    if model.actuator_forcelimited[actuator]:
        ranges.append(scaled(model.actuator_forcerange[actuator], force))
    if not ranges:
        return None
    return max(low for low, _ in ranges), min(high for _, high in ranges)
