"""Other ways to write an MJCF down that mean the same robot, made by code on the XML tree.

Every function takes a tree whose elements say everything themselves (see `spelled_out`), changes it, and
returns it. `WRITTEN` only says it in other words; `ORDERED` puts it into another order, or nests it in other
frames and bodies.
"""

import copy
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import combinations
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

Rewriting = Callable[[Element], Element]

# Kind of the <default> that an element has.
KINDS = {
    "geom": "geom", "site": "site", "joint": "joint", "camera": "camera", "light": "light",
    "spatial": "tendon", "general": "general", "material": "material", "pair": "pair",
}  # fmt: skip
CLASSLESS = {"name", "class", "target", "site1", "site2", "geom1", "geom2", "tendon"}
ROWS = ("friction", "solref", "solimp", "size", "gear", "dynprm", "gainprm", "biasprm")
BODIES = ("worldbody", "body", "frame")

# Attribute -> (what no robot would have, MuJoCo's own), of every kind that code may add to a robot.
HOSTILE = {
    "geom": {
        "type": ("box", "sphere"), "pos": ("1 2 3", "0 0 0"), "contype": ("4", "1"),
        "conaffinity": ("8", "1"), "condim": ("1", "3"), "priority": ("7", "0"), "group": ("5", "0"),
        "friction": ("9 8 7", "1 0.005 0.0001"), "solmix": ("5", "1"), "solref": ("0.5 3", "0.02 1"),
        "solimp": ("0.1 0.2 0.3 0.4 1", "0.9 0.95 0.001 0.5 2"), "margin": ("0.3", "0"),
        "gap": ("0.2", "0"), "surfacevel": ("3 2 1 0 0 0", "0 0 0 0 0 0"), "adhesion": ("90", "0"),
        "density": ("9", "1000"), "shellinertia": ("true", "false"), "rgba": ("1 0 0 0", "0.5 0.5 0.5 1"),
        "fluidshape": ("ellipsoid", "none"), "fluidcoef": ("9 9 9 9 9", "0.5 0.25 1.5 1 1"),
    },
    "site": {
        "type": ("box", "sphere"), "pos": ("1 2 3", "0 0 0"), "size": ("3 3 3", "0.005 0.005 0.005"),
        "group": ("5", "0"), "rgba": ("1 0 0 0", "0.5 0.5 0.5 1"),
    },
    "tendon": {
        "group": ("5", "0"), "limited": ("true", "auto"), "range": ("0 0.01", "0 0"),
        "frictionloss": ("50", "0"), "margin": ("2", "0"), "stiffness": ("70", "0"),
        "damping": ("60", "0"), "springlength": ("0 0.1", "-1 -1"), "width": ("3", "0.003"),
        "armature": ("4", "0"), "rgba": ("1 0 0 0", "0.5 0.5 0.5 1"),
    },
    "general": {
        "ctrllimited": ("true", "auto"), "ctrlrange": ("-0.01 0.01", "0 0"),
        "forcelimited": ("true", "auto"), "forcerange": ("-2 3", "0 0"), "actlimited": ("true", "auto"),
        "actrange": ("-0.1 0.2", "0 0"), "gear": ("3", "1 0 0 0 0 0"), "dyntype": ("filter", "none"),
        "dynprm": ("4", "1 0 0"), "gaintype": ("affine", "fixed"), "gainprm": ("77 2", "1 0 0"),
        "biastype": ("affine", "none"), "biasprm": ("5 6 7", "0 0 0"), "actearly": ("true", "false"),
        "group": ("5", "0"), "armature": ("2", "0"), "damping": ("3", "0"),
    },
    "joint": {
        "stiffness": ("40", "0"), "damping": ("30", "0"), "armature": ("20", "0"),
        "frictionloss": ("10", "0"), "group": ("5", "0"), "type": ("slide", "hinge"),
    },
    "pair": {
        "condim": ("1", "3"), "margin": ("0.5", "0"), "friction": ("9 9 9 9 9", "1 1 0.005 0.0001 0.0001"),
    },
    "equality": {"active": ("false", "true")},
    "light": {"castshadow": ("false", "true"), "pos": ("9 9 9", "0 0 0")},
    "camera": {"fovy": ("90", "45"), "pos": ("9 9 9", "0 0 0")},
    "material": {"specular": ("1", "0.5"), "rgba": ("1 0 0 0", "1 1 1 1")},
}  # fmt: skip


def parsed(xml: str) -> Element:
    return ElementTree.fromstring(xml)


def text(root: Element) -> str:
    return ElementTree.tostring(root, encoding="unicode")


# --- The same in other words


def spelled_out(root: Element) -> Element:
    """No <default>: every element says everything itself."""
    classes: dict[str, dict[str, dict[str, str]]] = {}

    def read(default: Element, above: dict[str, dict[str, str]]) -> None:
        mine = {kind: dict(values) for kind, values in above.items()}
        for child in default:
            if child.tag != "default":
                mine[child.tag] = _over(child.attrib, mine.get(child.tag, {}))
        classes[default.get("class", "main")] = mine
        for child in default.findall("default"):
            read(child, mine)

    classes["main"] = {}
    for default in root.findall("default"):
        read(default, classes["main"])
        root.remove(default)

    def write(element: Element, inherited: str) -> None:
        inherited = element.attrib.pop("childclass", inherited)
        for child in element:
            kind = KINDS.get(child.tag)
            if kind is not None and element.tag != "spatial":
                values = classes[child.attrib.pop("class", inherited)].get(kind, {})
                own = {name: builtin for name, (_, builtin) in HOSTILE[kind].items()}
                whole = _over(child.attrib, _over(values, own))
                child.attrib.update({k: whole[k] for k in (*values, *child.attrib)})
            write(child, inherited)

    write(root, "main")
    return root


def in_the_global_default(root: Element) -> Element:
    """What all elements of a kind have in common is said in the unnamed default."""
    default = Element("default")
    for kind in sorted(set(KINDS.values())):
        elements = list(of_kind(root, kind))
        common = _common(elements)
        if common:
            ElementTree.SubElement(default, kind, common)
        _without(elements, common)
    root.insert(0, default)
    return root


def in_classes_of_their_own(root: Element) -> Element:
    """Every element has a class that says everything but its name."""
    main = Element("default")
    for number, (element, kind) in enumerate(defaultable(root)):
        values = {k: v for k, v in element.attrib.items() if k not in CLASSLESS}
        own = ElementTree.SubElement(main, "default", {"class": f"c{number}"})
        ElementTree.SubElement(own, kind, values)
        _without([element], values)
        element.set("class", f"c{number}")
    root.insert(0, main)
    return root


def in_nested_classes(root: Element) -> Element:
    """Every element has a class in a class in a class, the outer of which say something else first."""
    main = Element("default")
    for number, (element, kind) in enumerate(defaultable(root)):
        values = {k: v for k, v in element.attrib.items() if k not in CLASSLESS}
        outside = {k: HOSTILE[kind][k][0] for k in values if k in HOSTILE[kind]}
        half = dict(list(values.items())[::2])
        at = main
        for level, said in enumerate(
            (outside, half, {k: values[k] for k in values if k not in half})
        ):
            at = ElementTree.SubElement(at, "default", {"class": f"c{number}_{level}"})
            ElementTree.SubElement(at, kind, said)
        _without([element], values)
        element.set("class", f"c{number}_2")
    root.insert(0, main)
    return root


def by_childclass(root: Element) -> Element:
    """What elements of a body have in common is said in the class that the body gives its children."""
    main = Element("default")
    for number, body in enumerate(root.iter("body")):
        own = ElementTree.SubElement(main, "default", {"class": f"of_body{number}"})
        for kind in ("geom", "site", "joint"):
            elements = body.findall(kind)
            common = _common(elements)
            ElementTree.SubElement(own, kind, common)
            _without(elements, common)
        body.set("childclass", f"of_body{number}")
    root.insert(0, main)
    return root


def under_hostile_defaults(root: Element) -> Element:
    """Defaults that no element wants, as all of them say what they are themselves."""
    hostile = Element("default")
    for kind, values in HOSTILE.items():
        elements = list(of_kind(root, kind))
        placed = any(
            "fromto" in each.attrib for each in elements
        )  # which no element may say beside pos
        said = {k: both for k, both in values.items() if not (placed and k == "pos")}
        for element in elements:
            element.attrib.update(
                {k: own for k, (_, own) in said.items() if k not in element.attrib}
            )
        ElementTree.SubElement(hostile, kind, {k: other for k, (other, _) in said.items()})
    root.insert(0, hostile)
    return root


def renamed(root: Element) -> Element:
    """Every element has another name, and their order in the alphabet is turned round."""
    return _with_names(
        root, lambda names, kind: [f"{kind[:1]}{9999 - i}" for i in range(len(names))]
    )


def named_after_each_other(root: Element) -> Element:
    """Names that happen to agree with those of other elements, and with those that code likes to give."""
    sensors = [e.get("name", "") for e in root.find("sensor") or []]

    def misleading(names: list[str], kind: str) -> list[str]:
        tempting = {
            "site": [*sensors[1:], *sensors[:1]],
            "geom": ["terrain", "obstacle0", "obstacle1", "ground"],
            "actuator": [e.get("name", "") for e in root.iter("spatial")][::-1],
            "tendon": [e.get("name", "") for e in root.find("actuator") or []],
            "body": ["world_", *sensors],
        }.get(kind, [])
        others = (f"n{i}" for i in range(len(names)))
        return [*tempting[: len(names)], *others][: len(names)]

    return _with_names(root, misleading, keep=("sensor",))


WRITTEN: dict[str, Rewriting] = {
    each.__name__: each
    for each in (
        in_the_global_default,
        in_classes_of_their_own,
        in_nested_classes,
        by_childclass,
        under_hostile_defaults,
        renamed,
        named_after_each_other,
    )
}


# --- The same in another order, or in other frames


def reordered(root: Element) -> Element:
    """Everything that stands in a row stands in it the other way round."""
    for element in list(root.iter()):
        if element.tag in (*BODIES, "tendon", "actuator", "sensor", "contact"):
            element[:] = element[::-1]
    _keyframes_turned(root)
    return root


def in_frames(root: Element) -> Element:
    """Everything in the world, and in bodies, stands in two frames that undo each other."""
    for parent in [e for e in root.iter() if e.tag in ("worldbody", "body")]:
        moved = [c for c in parent if c.tag in ("geom", "site", "body")]
        outer = Element("frame", {"pos": "0.5 -0.25 0.125", "quat": "0 0 0 1"})
        inner = ElementTree.SubElement(
            outer, "frame", {"pos": "0.5 -0.25 -0.125", "quat": "0 0 0 -1"}
        )
        for child in moved:
            parent.remove(child)
            inner.append(child)
        parent.append(outer)
    return root


def in_bodies(root: Element) -> Element:
    """Sites, and geoms of the world, are in bodies of their own that are welded to where they were.

    Geoms of bodies that move stay: MuJoCo reckons from the masses of a geom's own body, without those of
    what is welded to it, how soft its contacts are.
    """
    for parent in [e for e in root.iter() if e.tag in ("worldbody", "body")]:
        for site in parent.findall("site"):
            parent.remove(site)
            turned = ElementTree.SubElement(parent, "body", {"quat": "0 0 0 1"})
            x, y, z = (float(number) for number in site.get("pos", "0 0 0").split())
            site.set("pos", f"{-x!r} {-y!r} {z!r}")
            turned.append(site)
        for child in parent.findall("geom") if parent.tag == "worldbody" else ():
            parent.remove(child)
            outer = ElementTree.SubElement(
                parent, "body", {"pos": "0.5 -0.25 0.125", "quat": "0 1 0 0"}
            )
            inner = ElementTree.SubElement(
                outer, "body", {"pos": "-0.5 -0.25 0.125", "quat": "0 -1 0 0"}
            )
            inner.append(child)
    return root


def in_pairs(root: Element) -> Element:
    """Contacts are listed one by one, of geoms that would make none of themselves.

    For robots all of whose geoms have the same contact numbers.
    """
    bodies = [root.find("worldbody"), *root.iter("body")]
    touching = [
        (body, geom)
        for body in bodies
        for geom in body.findall("geom")
        if geom.get("contype", "1") != "0" or geom.get("conaffinity", "1") != "0"
    ]
    contact = ElementTree.SubElement(root, "contact")
    for (body, geom), (other, met) in combinations(touching, 2):
        if body is other:
            continue
        said = {k: geom.get(k, own) for k, (_, own) in HOSTILE["geom"].items()}
        slide, turn, roll = said["friction"].split()
        numbers = {k: said[k] for k in ("condim", "solref", "solimp", "margin", "gap")}
        numbers["friction"] = f"{slide} {slide} {turn} {roll} {roll}"
        ElementTree.SubElement(
            contact, "pair", numbers | {"geom1": geom.get("name"), "geom2": met.get("name")}
        )
    for _, geom in touching:
        geom.attrib.update(contype="0", conaffinity="0")
    return root


ORDERED: dict[str, Rewriting] = {each.__name__: each for each in (reordered, in_frames, in_bodies)}


def rewritten(xml: str, rewriting: Rewriting) -> str:
    """An MJCF in other words."""
    return text(rewriting(spelled_out(copy.deepcopy(parsed(xml)))))


# --- What they are made of


def defaultable(root: Element) -> Iterator[tuple[Element, str]]:
    """Elements that may have a class, and the kind of their default."""
    for parent in root.iter():
        if parent.tag not in ("default", "spatial"):
            yield from ((child, KINDS[child.tag]) for child in parent if child.tag in KINDS)


def of_kind(root: Element, kind: str) -> Iterator[Element]:
    return (element for element, its in defaultable(root) if its == kind)


def _over(values: dict[str, str], below: dict[str, str]) -> dict[str, str]:
    """Attributes over inherited ones, of which the last numbers of a row stay if fewer are given."""
    merged = dict(below)
    for name, value in values.items():
        given, inherited = value.split(), below.get(name, "").split()
        left = inherited[len(given) :] if name in ROWS else []
        merged[name] = " ".join((*given, *left)) if left else value
    return merged


def _common(elements: list[Element]) -> dict[str, str]:
    """Attributes that all of them have alike, and that a default may say."""
    counts = Counter(
        item for e in elements for item in e.attrib.items() if item[0] not in CLASSLESS
    )
    return dict(item for item, count in counts.items() if count == len(elements))


def _without(elements: list[Element], values: dict[str, str]) -> None:
    for element in elements:
        for name in values:
            del element.attrib[name]


# Where names are used: (tag, attribute) -> kind of what is named.
USED = {
    ("site", "site"): "site", ("framepos", "objname"): "site", ("spatial", "name"): "tendon",
    ("general", "tendon"): "tendon", ("general", "name"): "actuator", ("user", "objname"): "actuator",
    ("element", "objname"): "actuator", ("freejoint", "name"): "joint", ("framepos", "name"): "sensor",
    ("user", "name"): "sensor", ("geom", "material"): "material", ("site", "material"): "material",
    ("spatial", "material"): "material", ("material", "texture"): "texture",
    ("pair", "geom1"): "geom", ("pair", "geom2"): "geom",
}  # fmt: skip
UNNAMED = ("mujoco", "element")


def _with_names(
    root: Element, new: Callable[[list[str], str], list[str]], keep: tuple[str, ...] = ()
) -> Element:
    """Give every element the name that `new(names, kind)` has for it, wherever it is used."""
    places: list[tuple[Element, str, str]] = []
    for element in root.iter():
        if element.tag in UNNAMED[:1]:
            continue
        for attribute in element.attrib:
            kind = USED.get((element.tag, attribute))
            if kind is None and attribute == "name":
                kind = element.tag
            if kind is not None:
                places.append((element, attribute, kind))
    for kind in {kind for _, _, kind in places} - set(keep):
        here = [(e, attribute) for e, attribute, its in places if its == kind]
        names = list(dict.fromkeys(e.attrib[attribute] for e, attribute in here))
        better = dict(zip(names, new(names, kind), strict=True))
        for element, attribute in here:
            element.set(attribute, better[element.attrib[attribute]])
    return root


def _keyframes_turned(root: Element) -> None:
    """Positions of free bodies, activations and controls in a keyframe, the other way round."""
    for key in root.iter("key"):
        for name, width in (("qpos", 7), ("act", 1), ("ctrl", 1)):
            numbers = key.get(name, "").split()
            rows = [numbers[i : i + width] for i in range(0, len(numbers), width)]
            if rows:
                key.set(name, " ".join(n for row in rows[::-1] for n in row))
