"""Reasons that no adaptation removes: joints, bent tendons, muscles, soft parts, impossible numbers."""

from __future__ import annotations

from functools import partial

from flywheel.errors import RobotError
from flywheel.robots.adapt.classes import Classes
from flywheel.robots.adapt.draft import Draft
from flywheel.robots.cables import about_bent
from flywheel.robots.mjcf_numbers import check_numbers
from flywheel.robots.mjcf_reader import about_joints
from flywheel.robots.mjcf_source import refuse_unfit
from flywheel.robots.problems import Problems, problems_of

LINE = ["site", "site"]  # what a cable passes


def bent(draft: Draft) -> tuple[str, ...]:
    """Joints, and tendons that are no straight lines, as far as they are read without MuJoCo."""
    problems = Problems()
    if held := _held(draft):
        problems.add(about_joints(held))
    for number, tendon in enumerate(draft.elements("tendon")):
        path = [each.tag for each in tendon if isinstance(each.tag, str)]
        if path != LINE:
            name = tendon.get("name")
            whom = repr(name) if name else f"number {number}"
            problems.add_alike("tendon", whom, about_bent(path))
    return _told(problems)


def structural(draft: Draft) -> tuple[str, ...]:
    """Reasons why an MJCF cannot become a robot of free bodies on straight cables.

    Only without any of these there is something that can be simulated.
    """
    problems = Problems()
    problems.attempt(partial(refuse_unfit, draft.root, "The MJCF"))
    if not problems:
        problems.attempt(lambda: check_numbers(draft.model, "The MJCF"))
    return (*bent(draft), *_told(problems))


def _told(problems: Problems) -> tuple[str, ...]:
    try:
        problems.check()
    except RobotError as error:
        return problems_of(error)
    return ()


def _held(draft: Draft) -> list[tuple[str, str, str]]:
    """Name, kind and body of each joint that is not free."""
    classes = Classes(draft.root)
    found = []
    for joint in draft.root.iter("joint"):
        if classes.parent(joint).tag in ("body", "frame"):
            kind = classes.get(joint, "type", "hinge")
            if kind != "free":
                found.append((joint.get("name", ""), kind, classes.body(joint).get("name", "")))
    return found
