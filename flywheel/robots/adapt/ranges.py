"""Ranges of winches that an MJCF leaves open, from the lengths of their cables."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from flywheel.robots.adapt.draft import (
    Certainty,
    Change,
    Draft,
    actuators,
    at_start,
    digits,
    general,
)
from flywheel.robots.winches import kind_of

SHORTEST = 0.1  # of a cable's length: what a winch can wind it to
DURATION = 5.0  # of winding from one end of the range to the other [s]


def forces(draft: Draft) -> Iterator[Change]:
    """Ranges of forces that only pull, for winches that may push or have none."""
    model, edits = draft.model, []
    data = at_start(model)
    for actuator, name in _winches(model):
        limited, (low, high) = _limits(model, "force", actuator)
        if limited and low < 0 and high <= 0:
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
        reason = (
            f"Winches wind cables from today's length to {SHORTEST:.0%} of it, in {DURATION:g} s, unless "
            "there are numbers that do not count."
        )
        yield Change(tuple(edits), reason, Certainty.GUESS)


def _winches(model: mujoco.MjModel) -> Iterator[tuple[int, str]]:
    """Actuators that are winches but for their ranges."""
    for actuator, name in actuators(model):
        gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator, 1]
        if kind_of(model, actuator) is not None and gain > 0 and bias < 0:
            yield actuator, name


def _longest(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float:
    """A cable's length, or its rest length if that is longer [m]."""
    length = float(data.ten_length[model.actuator_trnid[actuator, 0]])
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
