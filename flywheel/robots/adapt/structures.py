"""MJCFs from structures in YAML or JSON: nodes with rods and strings (as NTRT's), or a platform on cables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any
from xml.etree import ElementTree

import numpy as np
from pydantic import AliasChoices, BeforeValidator, ConfigDict, Field

from flywheel.errors import MjcfError
from flywheel.files import read_json, read_yaml, shown
from flywheel.quantities import Bounds
from flywheel.records import Floats
from flywheel.robots.adapt.draft import Certainty, Change, Element, digits, fresh_name
from flywheel.robots.adapt.ropes import DAMPING, STRETCH
from flywheel.robots.world import GRAVITY
from flywheel.validation import Frozen, validated

ENDINGS = (".yaml", ".yml", ".json")
UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001}
UPS = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}  # their axes that are our x, y and z
TIMESTEP = "0.0025"  # [s]; half and twice as much divide usual control steps, too
THIN = 0.01  # radius of a rod that has none, share of its length
FLAT = 0.1  # least side of a platform's box, share of its longest


def _as_number(value: Any) -> Any:
    """Numbers that PyYAML takes for texts, as -.43 and 1e3."""
    with suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


Name = Annotated[str, Field(min_length=1, max_length=100)]
Coordinate = Annotated[float, Bounds(-1e6, 1e6), BeforeValidator(_as_number)]
Positive = Annotated[float, Bounds(0, 1e12, above=True), BeforeValidator(_as_number)]
Size = Annotated[float, Bounds(0, 1e12), BeforeValidator(_as_number)]
Place = tuple[Coordinate, Coordinate, Coordinate]


class Builder(Frozen):
    """How the pairs of a group are made.

    Attributes:
      kind: NTRT's class; rods are tgRodInfo, strings have Actuator or Cable in it.
      parameters: of it; others than density, radius, stiffness, damping and pretension have no meaning here.
    """

    kind: Name = Field(alias="class")
    parameters: dict[Name, Any] = Field(default={})


class Net(Frozen):
    """Nodes, pairs of them, and what the pairs are."""

    nodes: dict[Name, Place]
    pair_groups: dict[Name, tuple[tuple[Name, Name], ...]]
    builders: dict[Name, Builder] = Field(default={})


class Spring(Frozen):
    """Numbers of a cable; a tension is in newtons."""

    stiffness: Positive | None = None
    damping: Size | None = None
    pretension: Size = 0.0


class Platform(Frozen):
    """A platform on cables, from fixed exit points to its attachment points.

    Attributes:
      mass: [kg].
      inertia: about its centre of mass, along its axes; of a box around the attachment points if missing.
      com: its centre of mass, in its frame.
      exit_points: where cables leave the world.
      attachment_points: where they end, in the platform's frame; as many, in the same order.
      position: of its frame, at rest.
      cables: numbers of all cables.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    mass: Positive
    exit_points: tuple[Place, ...] = Field(
        validation_alias=AliasChoices("exit_points", "exits", "anchors", "frame_points"),
        min_length=1,
    )
    attachment_points: tuple[Place, ...] = Field(
        validation_alias=AliasChoices("attachment_points", "attachments", "platform_points")
    )
    position: Place = Field(
        default=(0.0, 0.0, 0.0), validation_alias=AliasChoices("position", "home")
    )
    inertia: tuple[Positive, Positive, Positive] | None = None
    com: Place = (0.0, 0.0, 0.0)
    cables: Spring = Spring()


def is_structure(path: str | Path) -> bool:
    """True for a file that is a structure, by its ending."""
    return Path(path).suffix in ENDINGS


def from_structure(path: str | Path, unit: str | None, up: str | None) -> tuple[Element, Change]:
    """The MJCF of a structure, without winches, and what it was made of.

    Args:
      path: of the file.
      unit: of its lengths, a key of `UNITS`; None for the usual one of such files.
      up: its axis that points up; None for the usual one.

    Raises:
      MjcfError: it cannot be read, or is no structure.
    """
    path = Path(path)
    read = read_json if path.suffix == ".json" else read_yaml
    values = read(path, "structure", MjcfError)
    if not isinstance(values, Mapping):
        raise MjcfError(f"The structure {path} is no mapping of names to values.")
    if "substructures" in values or "bond_groups" in values:
        raise MjcfError(
            f"The structure {path} is built of others{_included(values)}: write all nodes, pairs and "
            "builders in one file."
        )
    known = "nodes" in values
    made = _Made(path.stem, unit or ("dm" if known else "m"), up or ("y" if known else "z"))
    if known:
        made.net(validated(Net, values, f"{path} is not a structure of nodes", MjcfError))
    else:
        made.platform(validated(Platform, values, f"{path} is not a platform on cables", MjcfError))
    return made.root, made.change(asked=bool(unit and up))


def _included(values: Mapping[str, Any]) -> str:
    """The files that a structure includes, in brackets; "" where it does not say them."""
    parts = values.get("substructures")
    every = parts.values() if isinstance(parts, Mapping) else ()
    paths = [shown(one["path"]) for one in every if isinstance(one, Mapping) and "path" in one]
    return f" ({', '.join(dict.fromkeys(paths))})" if paths else ""


@dataclass
class _Body:
    """Rods that share nodes.

    Attributes:
      nodes: names of them.
      rods: pairs of nodes, each with its radius [m] and mass [kg].
    """

    nodes: set[str] = field(default_factory=set)
    rods: list[tuple[str, str, float, float]] = field(default_factory=list)


class _Made:
    """An MJCF that is being made.

    Attributes:
      root: its elements.
    """

    def __init__(self, name: str, unit: str, up: str) -> None:
        self.unit, self.up = unit, up
        self.metre = UNITS[unit]
        self.root = ElementTree.Element("mujoco", model=name)
        self._add(self.root, "option", timestep=TIMESTEP, integrator="implicitfast")
        self.world = self._add(self.root, "worldbody")
        self.tendons = self._add(self.root, "tendon")
        self._edits: list[str] = []
        self._cables = set[str]()  # their names

    def change(self, asked: bool) -> Change:
        """The change that all of it is; a guess unless its unit and its axis were given."""
        given = "as --unit and --up say" if asked else "(--unit and --up say others)"
        reason = (
            f"A structure with lengths in {self.unit} and {self.up} up becomes metres with z up {given}; "
            f"gravity is {GRAVITY:g} m/s^2."
        )
        return Change(tuple(self._edits), reason, Certainty.CERTAIN if asked else Certainty.GUESS)

    def net(self, net: Net) -> None:
        """Make bodies of rods that share nodes, and cables of strings. Nodes without a rod are fixed."""
        groups = {name: _builder(net, name) for name in net.pair_groups}
        rods = [(pair, groups[name]) for name, pairs in net.pair_groups.items() for pair in pairs
                if groups[name].kind == "tgRodInfo"]  # fmt: skip
        strings = [(pair, groups[name]) for name, pairs in net.pair_groups.items() for pair in pairs
                   if groups[name].kind != "tgRodInfo"]  # fmt: skip
        if lost := {node for pair, _ in rods + strings for node in pair} - net.nodes.keys():
            raise MjcfError(f"Pairs name nodes that there are not: {', '.join(sorted(lost))}.")
        if not rods or not strings:
            raise MjcfError("A structure of nodes has at least one rod and one string.")
        places = {name: self._place(place) for name, place in net.nodes.items()}
        bodies = self._bodies(rods, places)
        lift = -min(places[n][2] - r for body in bodies for *ends, r, _ in body.rods for n in ends)
        places = {name: place + [0, 0, lift] for name, place in places.items()}
        self._edits.append(
            f"a ground, on which it stands: it is {lift:.4g} m higher than in the file"
        )
        self._add(self.world, "geom", name="ground", type="plane", size="0 0 1")
        for number, body in enumerate(bodies):
            self._rigid(f"rod{number}", body, places)
        held = {node for body in bodies for node in body.nodes}
        for node in sorted({node for pair, _ in strings for node in pair} - held):
            self._add(self.world, "site", name=node, pos=digits(*places[node]))
            self._edits.append(f"the node {node!r}, which no rod has, is fixed")
        mass = sum(rod[3] for body in bodies for rod in body.rods)
        for pair, builder in strings:
            given = {k: v for k, v in builder.parameters.items() if k in Spring.model_fields}
            spring = validated(Spring, given, f"The strings {builder.kind} are wrong", MjcfError)
            # A file in decimetres has forces in kg dm/s^2.
            tension = spring.pretension * self.metre
            self._cable(pair, places[pair[0]] - places[pair[1]], spring, tension, mass)

    def platform(self, platform: Platform) -> None:
        """Make a box that hangs on cables."""
        exits, ends = platform.exit_points, platform.attachment_points
        if len(exits) != len(ends):
            raise MjcfError(
                f"There are {len(exits)} exit points and {len(ends)} attachment points; each cable has one "
                "of either."
            )
        home, local = self._place(platform.position), np.array([self._place(e) for e in ends])
        body = self._add(self.world, "body", name="platform", pos=digits(*home))
        self._add(body, "freejoint")
        sides = np.ptp(local, axis=0) / 2
        sides = np.maximum(sides, FLAT * max(sides.max(), self.metre * 1e-3))
        box = {
            "type": "box",
            "size": digits(*sides),
            "pos": digits(*(local.min(0) + local.max(0)) / 2),
        }
        com = self._place(platform.com)
        if platform.inertia is None:
            a, b, c = (2 * sides) ** 2 * platform.mass / 12
            inertia = np.array([b + c, a + c, a + b])
            self._edits.append(
                "the inertia of a box around the attachment points, as none is given"
            )
        else:
            inertia = np.array(platform.inertia)[list(UPS[self.up])] * self.metre**2
        mass = digits(platform.mass)
        self._add(body, "inertial", pos=digits(*com), mass=mass, diaginertia=digits(*inertia))
        self._add(body, "geom", **box, contype="0", conaffinity="0")
        for number, (exit_point, end) in enumerate(zip(exits, local, strict=True)):
            place = self._place(exit_point)
            pair = (f"exit{number}", f"attachment{number}")
            self._add(self.world, "site", name=pair[0], pos=digits(*place))
            self._add(body, "site", name=pair[1], pos=digits(*end))
            tension = platform.cables.pretension
            self._cable(pair, place - home - end, platform.cables, tension, platform.mass)

    def _place(self, place: Sequence[float]) -> Floats:
        """A place in metres, z up."""
        return np.array(place, float)[list(UPS[self.up])] * self.metre

    def _bodies(
        self, rods: Sequence[tuple[tuple[str, str], Builder]], places: Mapping[str, Floats]
    ) -> list[_Body]:
        found: list[_Body] = []
        for pair, builder in rods:
            length = float(np.linalg.norm(places[pair[0]] - places[pair[1]]))
            if not length:
                raise MjcfError(f"The rod from {pair[0]!r} to {pair[1]!r} has no length.")
            radius = _number(builder, "radius", THIN * length / self.metre) * self.metre
            density = _number(builder, "density", None) / self.metre**3
            whole = _Body(set(pair), [(*pair, radius, density * math.pi * radius**2 * length)])
            for body in [body for body in found if body.nodes & set(pair)]:
                found.remove(body)
                whole = _Body(whole.nodes | body.nodes, body.rods + whole.rods)
            found.append(whole)
        return found

    def _rigid(self, name: str, body: _Body, places: Mapping[str, Floats]) -> None:
        middle = np.mean([places[node] for node in sorted(body.nodes)], axis=0)
        element = self._add(self.world, "body", name=name, pos=digits(*middle))
        self._add(element, "freejoint")
        for a, b, radius, mass in body.rods:
            ends = digits(*(places[a] - middle), *(places[b] - middle))
            self._add(
                element, "geom", type="capsule", fromto=ends, size=digits(radius), mass=digits(mass)
            )
        for node in sorted(body.nodes):
            self._add(element, "site", name=node, pos=digits(*(places[node] - middle)))
        self._edits.append(
            f"the body {name!r} of {', '.join(sorted(body.nodes))}, {sum(rod[3] for rod in body.rods):.4g} kg"
        )

    def _cable(
        self, ends: tuple[str, str], apart: Floats, spring: Spring, tension: float, mass: float
    ) -> None:
        length = float(np.linalg.norm(apart))
        name = fresh_name(f"{ends[0]}_{ends[1]}", self._cables)
        stiffness = spring.stiffness or mass * GRAVITY / (STRETCH * max(length, 1e-9))
        damping = spring.damping
        if damping is None:
            damping = 2 * DAMPING * math.sqrt(stiffness * mass)
        rest = length - tension / stiffness
        if rest <= 0:
            raise MjcfError(
                f"The cable {name!r} is {length:.4g} m long: a pretension of {tension:.4g} N at "
                f"{stiffness:.4g} N/m would need a rest length of {rest:.4g} m."
            )
        element = self._add(
            self.tendons, "spatial", name=name, stiffness=digits(stiffness), damping=digits(damping),
            springlength=digits(0, rest),
        )  # fmt: skip
        for end in ends:
            self._add(element, "site", site=end)
        given = "" if spring.stiffness else f", {STRETCH:.0%} longer with all the weight on it"
        self._edits.append(
            f"the cable {name!r}, {length:.6g} m long, with {tension:.4g} N: rest length {rest:.6g} m at "
            f"{stiffness:.4g} N/m{given}"
        )

    @staticmethod
    def _add(parent: Element, tag: str, **attributes: str) -> Element:
        return ElementTree.SubElement(parent, tag, attributes)


def _builder(net: Net, group: str) -> Builder:
    """The builder whose words are all in a group's name."""
    words = set(group.split())
    if not net.builders:
        raise MjcfError(
            "There are no builders. A file that others include has theirs: write all of it in one file."
        )
    found = [each for name, each in net.builders.items() if set(name.split()) <= words]
    if len(found) != 1:
        raise MjcfError(f"The pairs {group!r} have {len(found)} builders; they need one.")
    kind = found[0].kind
    if kind != "tgRodInfo" and "Actuator" not in kind and "Cable" not in kind:
        raise MjcfError(
            f"The pairs {group!r} are {kind}; rods are tgRodInfo, strings have Actuator or Cable in their "
            "class."
        )
    return found[0]


def _number(builder: Builder, name: str, default: float | None) -> float:
    value = _as_number(builder.parameters.get(name, default))
    good = isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1e12
    if not good:
        raise MjcfError(f"The {name} of {builder.kind} must be a number above 0; got {value!r}.")
    return float(value)
