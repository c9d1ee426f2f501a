"""Winches: the actuators of the MJCF that change the rest length of a cable.

A winch's actuator is a `general` actuator on the cable's tendon whose force is
`k * (activation - length) - c * speed`, never positive, with the rest length as its activation:

    <general tendon="..." dyntype="integrator" actlimited="true" actrange="0.4 2"
      ctrllimited="true" ctrlrange="-0.6 0.6" gainprm="k" biastype="affine" biasprm="0 -k -c"
      forcelimited="true" forcerange="-F 0"/>

`dyntype="integrator"` takes the rate of the rest length [m/s], `dyntype="filterexact"` the desired
rest length [m], reached with the lag `dynprm` [s]. With `gainprm="-1"` and `biasprm="0 0 -c"` the
latter takes the tension [N], whatever the cable's length. Several cables on one winch are one
`<custom><tuple name="lift"> <element objtype="actuator" objname="..."/> ... </tuple></custom>`; an
element's `prm` is its cable's share of the motion, -1 for the antagonist of a cable with 1.
"""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import Floats
from flywheel.robots.parts import Winch, WinchKind
from flywheel.robots.problems import Problems, called

LAST_GROUP = 30  # of actuators that an MJCF can disable


def kind_of(model: mujoco.MjModel, actuator: int) -> WinchKind | None:
    """Kind of the winch that an actuator would be; None for no such dynamics."""
    dynamics, bias = model.actuator_dyntype[actuator], model.actuator_biasprm[actuator]
    if dynamics == mujoco.mjtDyn.mjDYN_INTEGRATOR:
        return "rate"
    if dynamics != mujoco.mjtDyn.mjDYN_FILTEREXACT:
        return None
    return "tension" if bias[1] == 0 and model.actuator_gainprm[actuator, 0] < 0 else "position"


def read_winches(model: mujoco.MjModel, act: Floats) -> tuple[Winch, ...]:
    """The winches, in the order of their first actuators.

    Args:
      act: (na,) the keyframe's activations.

    Raises:
      RobotError: an actuator that is neither a winch's nor passive, or that is switched off, a
        winch's actuator without a required limit, a tuple whose actuators could not move equally,
        or two winches of one name.
    """
    driving = [a for a in range(model.nu) if not is_passive(model, a)]
    if not driving:
        return ()
    problems = Problems()
    problems.attempt(partial(_refuse_disabled, model))
    problems.attempt(partial(_refuse_unfit, model, driving))
    problems.attempt(partial(_refuse_shared_cables, model, driving))
    problems.check()
    for actuator in driving:
        problems.attempt(partial(_check_start, model, actuator, act))
    problems.check()
    measured = _measured(model)
    groups, shares = _groups(model, driving), _shares(model)
    for name, actuators in groups.items():
        _check_alike(model, name, actuators, act, shares)
    winches = [_winch(model, name, group, measured, shares) for name, group in groups.items()]
    told = [winch.name for winch in winches if winch.kind == "tension"]
    if 0 < len(told) < len(winches):
        raise RobotError(
            f"The winches {', '.join(told)} take tensions, and the others rest lengths; all winches of a "
            "robot must take the one or the other."
        )
    return tuple(sorted(winches, key=lambda w: min(w.actuators)))


def is_passive(model: mujoco.MjModel, actuator: int) -> bool:
    """True if the actuator's control has no effect (a fixed gain of zero)."""
    fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    return bool(fixed and model.actuator_gainprm[actuator, 0] == 0)


def follows_speed(model: mujoco.MjModel, actuator: int) -> bool:
    """True for a <velocity>: its force is k (control - speed), whatever the length."""
    gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, :3]
    at_once = model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    return bool(at_once and gain > 0 and (bias == [0, 0, -gain]).all())


def _winch(
    model: mujoco.MjModel,
    name: str,
    actuators: tuple[int, ...],
    measured: dict[int, str],
    shares: Floats,
) -> Winch:
    actuators = tuple(sorted(actuators, key=lambda a: a not in measured))
    first = actuators[0]
    kind = kind_of(model, first)
    assert kind is not None
    control_range = model.actuator_ctrlrange[first]
    limited = model.actuator_actlimited[first]
    rest_range = model.actuator_actrange[first] if limited else control_range
    return Winch(
        name=name,
        kind=kind,
        cables=tuple(int(model.actuator_trnid[a, 0]) for a in actuators),
        actuators=actuators,
        control_range=(float(control_range[0]), float(control_range[1])),
        rest_range=(float(rest_range[0]), float(rest_range[1])),
        time_constant=0.0 if kind == "rate" else float(model.actuator_dynprm[first, 0]),
        measured=first in measured,
        activation=int(model.actuator_actadr[first]),
        ratios=tuple(float(shares[a] / shares[first]) for a in actuators),
        sensor=measured.get(first, ""),
    )


def _refuse_unfit(model: mujoco.MjModel, driving: list[int]) -> None:
    """Refuse actuators that are not winches', with everything that they lack."""
    problems = Problems()
    for actuator in driving:
        name = called(model, "actuator", actuator)
        for must, got in _unmet(model, actuator):
            problems.add_alike("actuator", name, f"{{}} must {must}.", got)
    problems.check()


def _no_winch(model: mujoco.MjModel, actuator: int) -> str:
    """The requirement without which an actuator is no winch at all, after "must"; "" if it is met."""
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_TENDON:
        return "drive a tendon (or have gainprm 0, if it is passive)"
    if follows_speed(model, actuator):
        return (
            "have a stiffness, which a <velocity> lacks: a winch that takes the rate of its rest length is "
            '<intvelocity kp="k" kv="c" actrange="SHORTEST LONGEST"/>'
        )
    if model.actuator_biasprm[actuator, 1] >= 0 and kind_of(model, actuator) != "tension":
        return (
            'have a stiffness k, by biastype "affine" and biasprm "0 -k -c", or take tensions, by dyntype '
            '"filterexact" and gainprm "-1"'
        )
    return ""


def _unmet(model: mujoco.MjModel, actuator: int) -> list[tuple[str, str]]:
    """Unmet requirements on a winch's actuator: each after "must", and what it got, if that is told."""
    force = model.actuator_forcerange[actuator]
    kind = kind_of(model, actuator)
    if reason := _no_winch(model, actuator):
        return [(reason, "")]
    needs = [
        (
            kind is not None,
            'have dyntype "integrator" (takes the rate of a rest length) or "filterexact" (takes a rest '
            "length, as a <position> with timeconst does)",
            "",
        ),
        *_laws(model, actuator),
        (
            model.actuator_forcelimited[actuator] and force[0] < 0 == force[1],
            'only pull, with a forcerange "-F 0"'
            f"{_counting('force', model.actuator_forcelimited[actuator], force)}",
            f"{tuple(force.tolist())}",
        ),
        (
            not model.tendon_actfrclimited[model.actuator_trnid[actuator, 0]],
            "have its limit as its forcerange, not as its tendon's actuatorfrcrange",
            "",
        ),
        *_ranges(model, actuator),
        (
            (model.actuator_gear[actuator] == [1, 0, 0, 0, 0, 0]).all(),
            "have gear 1 (the same without a gear g: gainprm and biasprm times g^2, forcerange times g, and "
            "act, actrange and ctrlrange divided by g)",
            "",
        ),
        (kind is None or model.actuator_actnum[actuator] == 1, "have one activation", ""),
    ]
    return [(must, got) for met, must, got in needs if not met]


def _laws(model: mujoco.MjModel, actuator: int) -> list[tuple[bool, str, str]]:
    """Requirements on the gain and the bias of a winch's actuator: if they are met, and as of `_unmet`."""
    gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
    fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    affine = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
    if kind_of(model, actuator) == "tension":
        none = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        return [
            (fixed and gain == -1, 'have gaintype "fixed" and gainprm "-1"', f"{gain:g}"),
            (
                none or (affine and bias[0] == 0 and bias[2] <= 0),
                'have biastype "affine" and biasprm "0 0 -c"',
                f'"{bias[0]:g} 0 {bias[2]:g}"',
            ),
        ]
    return [
        (fixed and gain > 0, 'have gaintype "fixed" and gainprm k > 0, the stiffness [N/m]', ""),
        (
            affine and bias[0] == 0 and np.isclose(bias[1], -gain) and bias[2] <= 0,
            'have biastype "affine" and biasprm "0 -k -c"',
            f'gainprm {gain:g} and biasprm "{bias[0]:g} {bias[1]:g} {bias[2]:g}"',
        ),
    ]


def _ranges(model: mujoco.MjModel, actuator: int) -> list[tuple[bool, str, str]]:
    """Requirements on the ranges of a winch's commands and rest lengths, as of `_laws`."""
    kind = kind_of(model, actuator)
    what = "tension" if kind == "tension" else "rest length"
    limits, control = model.actuator_actrange[actuator], model.actuator_ctrlrange[actuator]
    return [
        (
            model.actuator_ctrllimited[actuator],
            f"have a ctrlrange{_counting('ctrl', model.actuator_ctrllimited[actuator], control)}",
            "",
        ),
        (
            kind != "rate" or control[0] <= 0 <= control[1],
            "be able to hold: its ctrlrange must include 0",
            f"{control[0]:g} to {control[1]:g}",
        ),
        (
            kind in ("rate", None) or control[0] >= 0,
            f"have no ctrlrange below 0: it is a {what}",
            f"{control[0]:g} to {control[1]:g}",
        ),
        (
            model.actuator_actlimited[actuator] or kind != "rate",
            "have an actrange (shortest and longest rest length)"
            f"{_counting('act', model.actuator_actlimited[actuator], limits)}",
            "",
        ),
        (
            not model.actuator_actlimited[actuator] or limits[0] >= 0,
            f"have no actrange below 0: it is a {what}",
            f"{limits[0]:g} to {limits[1]:g}",
        ),
    ]


def _counting(limit: str, limited: int, limits: Floats) -> str:
    """Reason why an existing range is ignored; "" if it counts."""
    if limited or not limits.any():
        return ""
    return (
        f' that counts: {limit}limited is false (by itself, from a default class, or by autolimits="false"), '
        f'write {limit}limited="true"'
    )


def _check_start(model: mujoco.MjModel, actuator: int, act: Floats) -> None:
    """Refuse a first rest length, or tension, that the winch cannot have."""
    kind = kind_of(model, actuator)
    what, unit = ("tension", "N") if kind == "tension" else ("rest length", "m")
    limits, control = model.actuator_actrange[actuator], model.actuator_ctrlrange[actuator]
    rest = act[model.actuator_actadr[actuator]]
    # A winch that takes positions holds its own only within its ctrlrange.
    least = 0.0 if kind == "tension" else 1e-9
    low, high = limits if model.actuator_actlimited[actuator] else (least, np.inf)
    if kind != "rate":
        low, high = max(low, control[0]), min(high, control[1])
    if not low <= rest <= high:
        raise RobotError(
            f"The first keyframe starts the actuator {model.actuator(actuator).name!r} at {what} "
            f"{rest:g}, allowed {low:g} to {high:g} {unit}; give the keyframe act (0 where it is missing)."
        )


def _refuse_disabled(model: mujoco.MjModel) -> None:
    problems = Problems()
    for actuator, group in enumerate(model.actuator_group.tolist()):
        if 0 <= group <= LAST_GROUP and int(model.opt.disableactuator) >> group & 1:
            problems.add(
                f"The actuator {model.actuator(actuator).name!r} is in group {group}, which the MJCF's "
                "actuatorgroupdisable switches off; leave the actuator or the group out."
            )
    problems.check()


def _groups(model: mujoco.MjModel, driving: list[int]) -> dict[str, tuple[int, ...]]:
    """Winch name -> its actuators: the tuples of actuators, then each actuator that is in none.

    Raises:
      RobotError: a tuple of something else, an actuator in two tuples, or two winches of one name.
    """
    groups: dict[str, tuple[int, ...]] = {}
    for index in range(model.ntuple):
        start, size = model.tuple_adr[index], model.tuple_size[index]
        entries = slice(start, start + size)
        of_actuators = model.tuple_objtype[entries] == mujoco.mjtObj.mjOBJ_ACTUATOR
        if not of_actuators.any():
            continue
        name = model.tuple(index).name
        members = tuple(int(i) for i in model.tuple_objid[entries])
        taken = {a for group in groups.values() for a in group}
        if not of_actuators.all() or not set(members) <= set(driving) or taken & set(members):
            raise RobotError(
                f"The tuple {name!r} must list actuators of winches only, each in one tuple at most."
            )
        groups[name] = members
    taken = {a for group in groups.values() for a in group}
    alone = {model.actuator(a).name: (a,) for a in driving if a not in taken}
    if both := groups.keys() & alone.keys():
        raise RobotError(
            f"A tuple and a winch's actuator that is in none are both named {min(both)!r}; "
            "winches need unique names, because columns of recordings are named after them."
        )
    return groups | alone


def _shares(model: mujoco.MjModel) -> Floats:
    """(nu,) shares of actuators in the motion of their winches: the tuples' prm; 1 where it is missing."""
    shares = np.ones(model.nu)
    actuators = model.tuple_objtype == mujoco.mjtObj.mjOBJ_ACTUATOR
    given = model.tuple_objprm[actuators]
    shares[model.tuple_objid[actuators]] = np.where(given == 0, 1.0, given)
    return shares


def _check_alike(
    model: mujoco.MjModel, name: str, actuators: tuple[int, ...], act: Floats, shares: Floats
) -> None:
    """Reject actuators of one winch whose rest lengths would not change in their ratio."""
    first = actuators[0]
    start = act[model.actuator_actadr[list(actuators)]]
    for actuator, shift in zip(actuators, start - start[0], strict=True):
        position, ratio = kind_of(model, actuator) != "rate", shares[actuator] / shares[first]
        begins = (start[0], start[0] + shift)
        same = (
            kind_of(model, actuator) == kind_of(model, first)
            and ((shift == 0 and ratio == 1) or kind_of(model, first) != "tension")
            and model.actuator_actlimited[actuator] == model.actuator_actlimited[first]
            and model.actuator_dynprm[actuator, 0] == model.actuator_dynprm[first, 0]
            and _fits(
                model.actuator_ctrlrange[[first, actuator]],
                begins if position else (0.0, 0.0),
                ratio,
            )
            and _fits(model.actuator_actrange[[first, actuator]], begins, ratio)
        )
        if not same:
            about = "" if ratio == 1 else f", times {ratio:g} (the ratio of their prm) about these"
            raise RobotError(
                f"The actuators {model.actuator(first).name!r} and {model.actuator(actuator).name!r} "
                f"of winch {name!r} must have the same dyntype, dynprm and ctrlrange, and actranges "
                f"that differ as the keyframe's rest lengths do ({shift:g} m){about}."
            )


def _fits(ranges: np.ndarray, begins: tuple[float, float], ratio: float) -> bool:
    """True if the second range (2, 2) is the first one, times a ratio, about where both begin."""
    wanted = np.sort(begins[1] + ratio * (ranges[0] - begins[0]))
    return bool(not ranges.any() or np.allclose(ranges[1], wanted, rtol=0, atol=1e-9))


def _measured(model: mujoco.MjModel) -> dict[int, str]:
    """Actuators measured by a `user` sensor, and the sensor's name."""
    user = model.sensor_type == mujoco.mjtSensor.mjSENS_USER
    of_actuator = model.sensor_objtype == mujoco.mjtObj.mjOBJ_ACTUATOR
    sensors = np.flatnonzero(user & of_actuator)
    return {int(model.sensor_objid[i]): model.sensor(int(i)).name for i in sensors}


def _refuse_shared_cables(model: mujoco.MjModel, driving: list[int]) -> None:
    owners: dict[int, list[str]] = {}
    for actuator in driving:
        if model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON:
            cable = int(model.actuator_trnid[actuator, 0])
            owners.setdefault(cable, []).append(called(model, "actuator", actuator))
    problems = Problems()
    for cable, names in owners.items():
        if len(names) > 1:
            tendon = called(model, "tendon", cable)
            problems.add(
                f"The tendon {tendon} is driven by {' and '.join(names)}; a cable has one winch."
            )
    problems.check()
