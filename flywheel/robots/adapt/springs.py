"""Passive cables: they only pull, and one beside a winch has a tendon of its own."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy

from flywheel.robots.adapt.draft import Certainty, Change, Draft, actuators, digits, fresh_name
from flywheel.robots.adapt.proof import exact_change


def pull_only(draft: Draft) -> Iterator[Change]:
    """Springs and limits of tendons that are slack when short."""
    model, edits = draft.model, []
    for tendon in range(model.ntendon):
        name = model.tendon(tendon).name
        low, rest = model.tendon_lengthspring[tendon]
        if model.tendon_stiffness[tendon] > 0 and low > 0:
            draft.named("tendon", name).set("springlength", digits(0, rest))
            edits.append(f'springlength="{digits(0, rest)}" of {name!r}')
        least, most = model.tendon_range[tendon]
        if model.tendon_limited[tendon] and least > 0:
            draft.named("tendon", name).set("range", digits(0, most))
            edits.append(f'range="{digits(0, most)}" of {name!r}')
    if edits:
        reason = "A cable only pulls; these would push when shorter, as a rod does."
        yield Change(tuple(edits), reason, Certainty.GUESS)


def beside_winches(draft: Draft) -> Iterator[Change]:
    """Springs of winched tendons on tendons of their own."""
    before, edits = draft.model, []
    driven = {int(before.actuator_trnid[a, 0]) for a, _ in actuators(before)}
    taken = {before.tendon(i).name for i in range(before.ntendon)}
    for tendon in sorted(driven):
        stiffness = before.tendon_stiffness[tendon]
        if stiffness == 0:
            continue
        name = before.tendon(tendon).name
        winched = draft.named("tendon", name)
        spring = deepcopy(winched)
        spring.attrib |= {
            "name": fresh_name(f"{name}_spring", taken),
            "stiffness": digits(stiffness),
            "damping": digits(before.tendon_damping[tendon]),
            "springlength": digits(*before.tendon_lengthspring[tendon]),
            "limited": "false",
            "frictionloss": "0",
            "armature": "0",
        }
        winched.attrib |= {"stiffness": "0", "damping": "0"}
        parent = draft.parents()[winched]
        parent.insert(list(parent).index(winched) + 1, spring)
        edits.append(f"the tendon {spring.get('name')!r} with the spring of {name!r}")
    if edits:
        reason = (
            "A winched cable's stiffness is its winch's; the spring beside it is another cable."
        )
        yield exact_change(before, draft.model, {}, edits, reason)
