"""Names for what has none, made from what it joins."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element, fresh_name
from flywheel.robots.mjcf_source import LONGEST_NAME

TARGETS = ("tendon", "objname", "site", "actuator", "body", "joint", "geom")  # what a sensor is of


def names(draft: Draft) -> Iterator[Change]:
    """An MJCF with names for itself, its moving bodies, tendons, actuators and sensors."""
    edits = []
    if not draft.root.get("model"):
        draft.root.set("model", _plain(draft.name) or "robot")
        edits.append(f'<mujoco model="{draft.root.get("model")}">')
    bodies = [body for body in draft.root.iter("body") if _moves(body)]
    edits += _named(bodies, "body", list(draft.root.iter("body")), _of_body)
    for kind, name in (("tendon", _of_tendon), ("actuator", _of_actuator), ("sensor", _of_sensor)):
        every = draft.elements(kind)
        edits += _named(every, kind, every, name)
    if edits:
        reason = "Columns of recordings and rows of tables are named after them."
        yield Change(tuple(edits), reason, Certainty.CERTAIN)


def _moves(body: Element) -> bool:
    return any(body.find(tag) is not None for tag in ("freejoint", "joint"))


def _named(
    lacking: list[Element], kind: str, every: list[Element], name: Callable[[Element], str]
) -> list[str]:
    """Give names to those elements of a kind that have none."""
    taken = {each.get("name", "") for each in every}
    edits = []
    for number, element in enumerate(lacking):
        if not element.get("name"):
            wanted = _plain(name(element)) or f"{kind}{number}"
            element.set("name", fresh_name(wanted[:LONGEST_NAME], taken))
            edits.append(f"the {kind} {element.get('name')!r}")
    return edits


def _plain(text: str) -> str:
    return re.sub(r"[^\w.-]+", "_", text).strip("_")


def _of_body(body: Element) -> str:
    return next((geom.get("name", "") for geom in body.findall("geom") if geom.get("name")), "")


def _of_tendon(tendon: Element) -> str:
    return "_".join(each.get(each.tag, "") for each in tendon if isinstance(each.tag, str))


def _of_actuator(actuator: Element) -> str:
    driven = next((actuator.get(key, "") for key in TARGETS if actuator.get(key)), "")
    return f"{driven}_winch" if actuator.get("tendon") else f"{driven}_{actuator.tag}"


def _of_sensor(sensor: Element) -> str:
    of = next((sensor.get(key, "") for key in TARGETS if sensor.get(key)), "")
    return f"{of}_{sensor.tag}"
