"""Copies that <replicate> makes, written out as MuJoCo makes them."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element, digits
from flywheel.robots.mjcf_source import REFERENCES, compiled, doubled_sensors, without_keyframes
from flywheel.robots.mujoco_warnings import collected_warnings

# In which MuJoCo copies what refers to copies.
SECTIONS = ("tendon", "equality", "contact", "actuator", "sensor", "custom")
SAME = 1e-9  # of a number that was computed in another order


def copies(draft: Draft) -> Iterator[Change]:
    """The elements that <replicate> copies, and what refers to them, each in the file.

    Raises:
      RobotError: MuJoCo refuses the MJCF, or makes other copies.
    """
    edits = [
        f"the {each.get('count', '1')} copies of <replicate>"
        for each in draft.root.iter("replicate")
    ]
    if not edits:
        return
    for section, sensor in doubled_sensors(draft.root):
        section.remove(sensor)
        edits.append(f"no <{sensor.tag}>, which MuJoCo doubles with each copy")
    before = _model(draft)  # with copies within bodies only, or there would be no end
    while (replicate := _next(draft)) is not None:
        _write_out(draft, replicate)
    if not _same(before, _model(draft)):
        raise RobotError(
            "Copies (<replicate>) are not in the file to be changed, and cannot be written out as MuJoCo "
            "makes them: write them out."
        )
    yield Change(tuple(edits), "Copies are not in the file to be changed.", Certainty.CERTAIN)


def _next(draft: Draft) -> Element | None:
    """The first <replicate> that has none within it; None for no more."""
    every = draft.root.iter("replicate")
    return next((each for each in every if each.find(".//replicate") is None), None)


def _model(draft: Draft) -> mujoco.MjModel:
    """MuJoCo's model of a draft without its keyframes.

    Raises:
      MjcfError: MuJoCo refuses it.
    """
    return compiled(without_keyframes(draft.xml))[2]


def _write_out(draft: Draft, replicate: Element) -> None:
    places, separator = _places(draft, replicate), replicate.get("sep", "")
    ends = [f"{separator}{i:0{len(str(len(places) - 1))}}" for i in range(len(places))]
    named = {each.get("name", "") for each in replicate.iter()} - {""}
    outside = _referring(draft, named)
    parent = draft.parents()[replicate]
    at = list(parent).index(replicate)
    parent.remove(replicate)
    for number, (place, end) in enumerate(zip(places, ends, strict=True)):
        frame = Element("frame", place)
        frame.extend(_copy(each, named, end) for each in replicate)
        parent.insert(at + number, frame)
        for section, elements in outside:
            section.extend(_copy(each, named, end) for each in elements)
    for section, elements in outside:
        for each in elements:
            section.remove(each)


def _places(draft: Draft, replicate: Element) -> list[dict[str, str]]:
    """Place of each copy, as attributes of a <frame>."""
    small, world = Element("mujoco"), Element("worldbody")
    small.extend([*draft.root.findall("compiler"), world])
    mark = Element("replicate", replicate.attrib)
    mark.append(Element("site"))
    world.append(mark)
    with collected_warnings():
        model = compiled(ElementTree.tostring(small, encoding="unicode"))[2]
    return [
        {"pos": digits(*pos), "quat": digits(*quat)}
        for pos, quat in zip(model.site_pos, model.site_quat, strict=True)
    ]


def _referring(draft: Draft, named: set[str]) -> list[tuple[Element, list[Element]]]:
    """Sections of an MJCF with their elements that refer to names, whose own names are added to these."""
    found: dict[Element, list[Element]] = {}
    for section in (each for tag in SECTIONS for each in draft.root.findall(tag)):
        for element in section:
            refers = any(
                value in named and key in REFERENCES
                for part in element.iter()
                for key, value in part.attrib.items()
            )
            if refers:
                found.setdefault(section, []).append(element)
                named |= {element.get("name", "")} - {""}
    return list(found.items())


def _copy(element: Element, named: set[str], end: str) -> Element:
    copy = deepcopy(element)
    for part in copy.iter():
        for key, value in part.attrib.items():
            if value in named and key in REFERENCES | {"name"}:
                part.set(key, value + end)
    return copy


def _same(one: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    """True for two models of equal names and numbers."""
    arrays = (name for name in dir(one) if isinstance(getattr(one, name), np.ndarray))
    return one.names == other.names and all(
        getattr(one, name).shape == getattr(other, name).shape
        and np.allclose(getattr(one, name), getattr(other, name), rtol=SAME, atol=SAME)
        for name in arrays
    )
