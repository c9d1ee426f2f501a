"""Ropes, which MuJoCo stops at their length as stiff limits, as stiff springs that are slack below it."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from flywheel.robots.adapt.draft import Certainty, Change, Draft, digits, weight_of

STRETCH = 0.01  # of a rope's length, with all the weight on it
FAR = 2.0  # times a rope's length: a limit that it never reaches
DAMPING = 0.2  # of critical, for all the mass on one rope


def ropes(draft: Draft) -> Iterator[Change]:
    """Stiffnesses for tendons that nothing pulls but a limit of their length."""
    model, edits = draft.model, []
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    pulled = set(model.actuator_trnid[on_tendon, 0].tolist())
    weight = weight_of(model)
    mass = float(model.body_mass[model.body_weldid != 0].sum())
    for tendon in range(model.ntendon):
        length, name = float(model.tendon_range[tendon, 1]), model.tendon(tendon).name
        limited = model.tendon_limited[tendon] and length > 0
        if tendon in pulled or not limited or model.tendon_stiffness[tendon] > 0 or not weight:
            continue
        stiffness = weight / (STRETCH * length)
        attributes = {
            "range": digits(0, FAR * length),  # and no less, because sensors of limits need one
            "stiffness": digits(stiffness),
            "damping": digits(2 * DAMPING * np.sqrt(stiffness * mass)),
            "springlength": digits(0, length),
        }
        draft.named("tendon", name).attrib |= attributes
        words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
        edits.append(f"{words} of {name!r}")
    if edits:
        reason = (
            f"A rope is stiff above its length: {STRETCH:.0%} longer with all the weight on it."
        )
        yield Change(tuple(edits), reason, Certainty.GUESS)
