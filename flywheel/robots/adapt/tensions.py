"""Motors on the tendons of springs, written as winches of the springs.

A spring of stiffness k and rest length L, and a motor of gear G, gain g and bias b0 + b1 length + b2 speed
that is told a, pull together as one spring of stiffness K = k - G^2 b1 and of the rest length
r = (k L + G g a + G b0) / K: a winch. That holds as long as the spring is taut, and always for one that
pushes as well. Most such motors give a tension (b1 = 0); servos are taken for them where their own rest
lengths would be below 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import mujoco

from flywheel.robots.adapt.draft import Change, Draft, Keys, Scale, actuators, digits, general
from flywheel.robots.adapt.proof import apart, certainty_of, evidence_of
from flywheel.robots.adapt.servos import commands, dynamics, scaled
from flywheel.robots.cables import curved


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
