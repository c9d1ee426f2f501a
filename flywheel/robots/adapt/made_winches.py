"""Passive cables as winches, where that is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from xml.etree import ElementTree

from flywheel.errors import RobotError
from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    Keys,
    actuators,
    at_start,
    digits,
    fresh_name,
)
from flywheel.robots.adapt.ranges import DURATION, RANGE, SHORTEST, reach
from flywheel.robots.cables import curved

LAG = 0.1  # of a winch that takes positions [s]


def made_winches(draft: Draft) -> Iterator[Change]:
    """Winches on the passive cables whose names match `AdaptOptions.winches`.

    Raises:
      RobotError: a pattern matches no passive cable with a stiffness.
    """
    patterns = draft.options.winches
    if not patterns:
        return
    model = draft.model
    data, keys = at_start(model), Keys.of(model)
    driven = {int(model.actuator_trnid[a, 0]) for a, _ in actuators(model)}
    passive = {
        model.tendon(i).name: i
        for i in range(model.ntendon)
        if i not in driven and model.tendon_stiffness[i] > 0 and not curved(model, i)
    }
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in passive):
            raise RobotError(
                f"--winch {pattern!r} matches no passive cable with a stiffness; there are: "
                f"{', '.join(passive) or 'none'}."
            )
    chosen = [name for name in passive if any(fnmatchcase(name, each) for each in patterns)]
    taken = {model.actuator(a).name for a in range(model.nu)}
    edits = []
    for name in chosen:
        tendon = passive[name]
        rest, length = float(model.tendon_lengthspring[tendon, 1]), reach(model, data, tendon)
        winch = fresh_name(f"{name}_winch", taken)
        attributes = {
            "gainprm": digits(model.tendon_stiffness[tendon]),
            "biastype": "affine",
            "biasprm": digits(0.0, -model.tendon_stiffness[tendon], -model.tendon_damping[tendon]),
            "forcelimited": "true",
            "forcerange": digits(-model.tendon_stiffness[tendon] * max(rest, length), 0.0),
            **_limits(draft.options.winch_kind, rest, length),
        }
        draft.named("tendon", name).attrib |= {"stiffness": "0", "damping": "0"}
        ElementTree.SubElement(
            draft.section("actuator"), "general", {"name": winch, "tendon": name, **attributes}
        )
        draft.rests[winch] = rest
        for act, ctrl in zip(keys.act, keys.ctrl, strict=True):
            act[winch] = rest
            ctrl[winch] = 0.0 if draft.options.winch_kind == "rate" else rest
        numbers = " ".join(
            f'{key}="{value}"' for key, value in attributes.items() if "range" in key
        )
        edits.append(f"the winch {winch!r} {numbers}, which starts at {rest:.6g} m")
    keys.write(draft)
    reason = f"Winches that --winch names, or of a structure, as stiff and damped as the springs. {RANGE}."
    yield Change(tuple(edits), reason, Certainty.GUESS)


def _limits(kind: str, rest: float, length: float) -> dict[str, str]:
    low, high = SHORTEST * min(rest, length), max(rest, length)
    limits = {"ctrllimited": "true"}
    if kind == "position":
        lag = {"dyntype": "filterexact", "dynprm": digits(LAG)}
        return limits | lag | {"ctrlrange": digits(low, high)}
    fast = (high - low) / DURATION
    rests = {"dyntype": "integrator", "actlimited": "true", "actrange": digits(low, high)}
    return limits | rests | {"ctrlrange": digits(-fast, fast)}
