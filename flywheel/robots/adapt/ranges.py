"""Ranges of winches that an MJCF leaves open, from the lengths of their cables."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from flywheel.records import Floats
from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    actuators,
    at_start,
    digits,
    general,
)
from flywheel.robots.adapt.proof import exact_change
from flywheel.robots.winches import kind_of

SHORTEST = 0.1  # of a cable's length: what a winch can wind it to
DURATION = 5.0  # of winding from one end of the range to the other [s]
RANGE = (
    f"Winches wind cables from today's length, or that to the furthest other exit, to {SHORTEST:.0%} of it, "
    f"in {DURATION:g} s"
)


def limits(draft: Draft) -> Iterator[Change]:
    """Limits of tendons (`actuatorfrcrange`) as the forcerange of the only actuator on each."""
    before, edits = draft.model, []
    on_tendon = before.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    on = before.actuator_trnid[on_tendon, 0].tolist()
    for actuator, name in actuators(before):
        tendon = int(before.actuator_trnid[actuator, 0])
        limited, own = _limits(before, "force", actuator)
        low, high = map(float, before.tendon_actfrcrange[tendon])
        if limited:
            low, high = max(low, own[0]), min(high, own[1])
        pulls = low < min(high, 0.0)
        if not before.tendon_actfrclimited[tendon] or on.count(tendon) > 1 or not pulls:
            continue
        forcerange = digits(low, high)
        general(draft, before, actuator, forcelimited="true", forcerange=forcerange)
        element = draft.named("tendon", before.tendon(tendon).name)
        element.attrib.pop("actuatorfrcrange", None)  # it may be that of a class
        element.set("actuatorfrclimited", "false")
        edits.append(f'forcerange="{forcerange}" of {name!r}')
    if edits:
        reason = "The limit of a cable with one actuator is that actuator's."
        yield exact_change(before, draft.model, {}, edits, reason)


def forces(draft: Draft) -> Iterator[Change]:
    """Ranges of forces that only pull, for winches that may push or have none."""
    model, edits = draft.model, []
    data = at_start(model)
    for actuator, name in _winches(model):
        limited, (low, high) = _limits(model, "force", actuator)
        if limited and low < 0 == high:
            continue
        # Without a limit, more than there is on a cable that is wound in altogether.
        never = float(model.actuator_gainprm[actuator, 0]) * _longest(model, data, actuator)
        forcerange = digits(low if limited and low < 0 else -never, 0)
        general(draft, model, actuator, forcelimited="true", forcerange=forcerange)
        edits.append(f'forcerange="{forcerange}" of {name!r}')
    if edits:
        reason = "A cable only pulls; a winch without a limit pulls as hard as its stiffness says."
        yield Change(tuple(edits), reason, Certainty.GUESS)


def ranges(draft: Draft) -> Iterator[Change]:
    """Ranges of commands and rest lengths, for winches that have none."""
    model, edits = draft.model, []
    data = at_start(model)
    for actuator, name in _winches(model):
        changes = _missing(model, data, actuator)
        if changes:
            general(draft, model, actuator, **changes)
            shown = (f'{key}="{value}"' for key, value in changes.items() if value != "true")
            edits.append(f"{' '.join(shown)} of {name!r}")
    if edits:
        reason = f"{RANGE}, unless there are numbers that do not count."
        yield Change(tuple(edits), reason, Certainty.GUESS)


def _winches(model: mujoco.MjModel) -> Iterator[tuple[int, str]]:
    """Actuators that are winches but for their ranges."""
    for actuator, name in actuators(model):
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, 1]
        if kind_of(model, actuator) is not None and gain > 0 and bias < 0:
            yield actuator, name


def reach(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> float:
    """Length that a winch has to pay out [m].

    That is the cable's own one; from a fixed place, the distance to the furthest fixed place of any cable if
    that is more: between them a body can hang anywhere.
    """
    ends = [_fixed_places(model, data, each) for each in range(model.ntendon)]
    own, others = ends[tendon], np.concatenate(ends)
    apart = np.linalg.norm(own[:, None] - others, axis=-1)
    return max(float(data.ten_length[tendon]), float(apart.max(initial=0.0)))


def _fixed_places(model: mujoco.MjModel, data: mujoco.MjData, tendon: int) -> Floats:
    """(E, 3) sites of a tendon that do not move [m]."""
    path = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
    sites = model.wrap_objid[path][model.wrap_type[path] == mujoco.mjtWrap.mjWRAP_SITE]
    return data.site_xpos[sites[model.body_weldid[model.site_bodyid[sites]] == 0]]


def _longest(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """Length that a winch has to pay out, or its rest length if that is longer [m]."""
    length = reach(model, data, int(model.actuator_trnid[actuator, 0]))
    return max(length, float(data.act[model.actuator_actadr[actuator]]))


def _missing(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> dict[str, str]:
    """Attributes of the ranges that a winch needs and does not have."""
    high = _longest(model, data, actuator)
    low = SHORTEST * high
    acts, act = _limits(model, "act", actuator)
    controlled, control = _limits(model, "ctrl", actuator)
    if kind_of(model, actuator) == "position":
        usable = controlled and (control[0] >= 0 or control[1] <= 0)
        return {} if usable else _written("ctrl", _counting(control, low, high))
    ends = act if acts and act[0] >= 0 else _counting(act, low, high)
    changes = {} if acts and act[0] >= 0 else _written("act", ends)
    if not controlled:
        fast = (ends[1] - ends[0]) / DURATION
        meant = tuple(control) if control[0] < 0 < control[1] else (-fast, fast)
        changes |= _written("ctrl", meant)
    return changes


def _limits(model: mujoco.MjModel, limit: str, actuator: int) -> tuple[bool, tuple[float, float]]:
    """True if a range counts, and the range."""
    low, high = getattr(model, f"actuator_{limit}range")[actuator]
    return bool(getattr(model, f"actuator_{limit}limited")[actuator]), (float(low), float(high))


def _counting(written: tuple[float, float], low: float, high: float) -> tuple[float, float]:
    """A range of rest lengths that is written but does not count, else one from `low` to `high`."""
    if 0 <= written[0] < written[1]:
        return written
    return low, max(high, written[1])


def _written(limit: str, ends: tuple[float, ...] | np.ndarray) -> dict[str, str]:
    return {f"{limit}limited": "true", f"{limit}range": digits(*ends)}
