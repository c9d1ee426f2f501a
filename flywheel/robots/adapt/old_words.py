"""Words of MuJoCo 2 and 3 that MuJoCo 4 does not know."""

from __future__ import annotations

from collections.abc import Iterator

from flywheel.robots.adapt.draft import Certainty, Change, Draft, Element

# Element, attribute, its value (None: any), and the reason why it can be left out.
NO_LONGER = (
    ("flag", "sensornoise", None, "MuJoCo no longer adds noise to sensors."),
    ("flag", "passive", "enable", "Springs and dampers act by default."),
    ("option", "collision", "all", "Geoms and pairs collide by default."),
    ("option", "apirate", None, "Nothing of the motion depends on it."),
    ("compiler", "convexhull", None, "Nothing of primitives depends on it."),
    ("compiler", "exactmeshinertia", None, "Nothing of primitives depends on it."),
    ("compiler", "coordinate", "local", "Coordinates are local."),
)
RENAMED = (
    ("option", "mpr_iterations", "ccd_iterations"),
    ("option", "mpr_tolerance", "ccd_tolerance"),
)
IDENTITY = {"pos": [0, 0, 0], "quat": [1, 0, 0, 0], "euler": [0, 0, 0]}  # of a body's place
OTHERWISE = {"axisangle", "xyaxes", "zaxis"}  # how else it can be turned


def old_words(draft: Draft) -> Iterator[Change]:
    """An MJCF in MuJoCo's present words, where their meaning is certain."""
    for tag, attribute, value, reason in NO_LONGER:
        for element in draft.root.iter(tag):
            if attribute in element.attrib and value in (None, element.get(attribute)):
                got = element.attrib.pop(attribute)
                edit = f'no {attribute}="{got}" in <{tag}>'
                yield Change((edit,), reason, Certainty.CERTAIN)
    for tag, old, new in RENAMED:
        for element in draft.root.iter(tag):
            if old in element.attrib:
                element.set(new, element.attrib.pop(old))
                yield Change((f"{new} for {old}",), "It has another name now.", Certainty.CERTAIN)
    yield from _asleep(draft)
    yield from _unlimited(draft)
    yield from _collision(draft)
    yield from _global(draft)


def _asleep(draft: Draft) -> Iterator[Change]:
    """Bodies that may sleep, which MuJoCo refuses of bodies that springs pull."""
    edits = [
        f'no sleep="{element.attrib.pop("sleep")}" in <{element.tag}>'
        for tag in ("flag", "body")
        for element in draft.root.iter(tag)
        if "sleep" in element.attrib
    ]
    if edits:
        reason = "MuJoCo lets no body sleep that a spring pulls."
        yield Change(tuple(edits), reason, Certainty.GUESS)


def _unlimited(draft: Draft) -> Iterator[Change]:
    """Ranges that count without a word of their own."""
    for compiler in draft.root.findall("compiler"):
        if compiler.get("autolimits") == "false":
            del compiler.attrib["autolimits"]
            reason = (
                "MuJoCo refuses ranges without ...limited there; ranges that are written are meant."
            )
            yield Change(('no autolimits="false"',), reason, Certainty.GUESS)


def _collision(draft: Draft) -> Iterator[Change]:
    """Contacts by pairs only, or without pairs."""
    for option in draft.root.findall("option"):
        kind = option.get("collision")
        if kind == "predefined":
            del option.attrib["collision"]
            for geom in draft.root.iter("geom"):
                geom.set("contype", "0")
                geom.set("conaffinity", "0")
            edit = 'contype="0" conaffinity="0" for all geoms, no collision="predefined"'
            reason = "Only the geoms of <pair> touch each other."
            yield Change((edit,), reason, Certainty.CERTAIN)
        elif kind == "dynamic":
            del option.attrib["collision"]
            pairs = [
                (section, pair)
                for section in draft.root.findall("contact")
                for pair in section.findall("pair")
            ]
            for section, pair in pairs:
                section.remove(pair)
            edit = f'no collision="dynamic" in <option>, {len(pairs)} pairs left out'
            yield Change((edit,), "Pairs do not count there.", Certainty.CERTAIN)


def _global(draft: Draft) -> Iterator[Change]:
    """Local coordinates, where they are the same as global ones."""
    for compiler in draft.root.findall("compiler"):
        if compiler.get("coordinate") == "global" and not any(
            map(_placed, draft.root.iter("body"))
        ):
            del compiler.attrib["coordinate"]
            edit = 'no coordinate="global" in <compiler>'
            reason = "All bodies are at the origin, where local coordinates are global ones."
            yield Change((edit,), reason, Certainty.CERTAIN)
            for section in draft.root.findall("keyframe"):
                draft.root.remove(section)
                words = "The frames of bodies were elsewhere (in their centres of mass)."
                yield Change(("no keyframes",), words, Certainty.CERTAIN)


def _placed(body: Element) -> bool:
    """True for a body that may be elsewhere than its parent."""
    try:
        here = all(
            [float(number) for number in body.get(key, "").split()] in ([], nothing)
            for key, nothing in IDENTITY.items()
        )
    except ValueError:
        return True
    return not here or bool(OTHERWISE & set(body.keys()))
