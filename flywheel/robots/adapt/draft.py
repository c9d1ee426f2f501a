"""An MJCF that is being edited: its elements, and MuJoCo's model of them as they are now."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.options import AdaptOptions
from flywheel.robots.mjcf_reader import read_robot
from flywheel.robots.mjcf_source import compiled, parsed, read_mjcf, without_keyframes
from flywheel.robots.problems import problems_of

Element = ElementTree.Element
SHORTCUTS = ("kp", "kv", "dampratio", "timeconst", "inheritrange")  # that <general> does not have
SECTIONS = {"tendon": "tendon", "actuator": "actuator", "sensor": "sensor", "key": "keyframe"}


class Certainty(StrEnum):
    """How sure a change is."""

    CERTAIN = "certain"  # the file says so
    EQUIVALENT = "equivalent"  # another way to write the same motion
    GUESS = "guess"  # to be confirmed


@dataclass(frozen=True)
class Change:
    """A change of an MJCF, or several for one reason.

    Attributes:
      edits: each with its element.
      reason: of all of them.
      certainty: of them.
      evidence: by which they are equivalent; "" if there is nothing to be shown.
    """

    edits: tuple[str, ...]
    reason: str
    certainty: Certainty
    evidence: str = ""


class Draft:
    """An MJCF that is being edited.

    Args:
      path: of its file.
      options: see there.
      root: its elements; those of the file by default.

    Attributes:
      root: its elements, to be edited in place.
      folder: in which it looks for other files.
      name: of the file, without its ending.
      options: as given.
      rests: rest lengths with which winches start where there is no keyframe, by name [m].

    Raises:
      MjcfError: no such file, or not an MJCF.
    """

    def __init__(
        self, path: str | Path, options: AdaptOptions, root: Element | None = None
    ) -> None:
        if root is None:
            root = parsed(read_mjcf(path), "The MJCF", comments=True)
        self.root = root
        self.folder, self.name = Path(path).resolve().parent, Path(path).stem
        self.options = options
        self.rests: dict[str, float] = {}
        self._compiled: tuple[str, mujoco.MjModel] | None = None

    @property
    def xml(self) -> str:
        """Its text as it is now."""
        return ElementTree.tostring(self.root, encoding="unicode")

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model of it as it is now.

        Raises:
          MjcfError: MuJoCo refuses it.
        """
        text = self.xml
        if self._compiled is None or self._compiled[0] != text:
            self._compiled = text, compiled(text)[2]
        return self._compiled[1]

    def problems(self) -> tuple[str, ...]:
        """All reasons for which it cannot be used as it is now."""
        try:
            read_robot(self.xml)
        except RobotError as error:
            return problems_of(error)
        return ()

    def elements(self, kind: str) -> list[Element]:
        """Its tendons, actuators, sensors or keys, in MuJoCo's order."""
        sections = self.root.findall(SECTIONS[kind])
        return [each for section in sections for each in section if isinstance(each.tag, str)]

    def named(self, kind: str, name: str) -> Element:
        """One of these, by its name.

        Raises:
          RobotError: the file has none, because copies make it.
        """
        return _only((e for e in self.elements(kind) if e.get("name") == name), kind, name)

    def body(self, name: str) -> Element:
        """A body by its name.

        Raises:
          RobotError: see `named`.
        """
        return _only((e for e in self.root.iter("body") if e.get("name") == name), "body", name)

    def section(self, tag: str) -> Element:
        """A section of the MJCF, made if there is none."""
        found = self.root.find(tag)
        return ElementTree.SubElement(self.root, tag) if found is None else found

    def parents(self) -> dict[Element, Element]:
        """Each element's parent."""
        return {child: parent for parent in self.root.iter() for child in parent}

    def remove(self, doomed: Element) -> None:
        """Take an element out."""
        self.parents()[doomed].remove(doomed)


def _only(found: Iterator[Element], kind: str, name: str) -> Element:
    element = next(found, None)
    if element is None:
        raise RobotError(
            f"The {kind} {name!r} is made by copying (<replicate>), and is not in the file to be changed: "
            "write the copies out."
        )
    return element


def fresh_name(wanted: str, taken: set[str]) -> str:
    """A name, with a number if it is taken already; taken from then on."""
    name, number = wanted, 2
    while name in taken:
        name, number = f"{wanted}_{number}", number + 1
    taken.add(name)
    return name


def digits(*values: float) -> str:
    """Numbers in the format of an MJCF's attribute, with all their digits."""
    return " ".join(_short(float(value)) for value in values)


def _short(value: float) -> str:
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def actuators(model: mujoco.MjModel) -> Iterator[tuple[int, str]]:
    """Numbers and names of the actuators on tendons whose controls have an effect."""
    for actuator in range(model.nu):
        on_tendon = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON
        fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        if on_tendon and fixed and model.actuator_gainprm[actuator, 0] != 0:
            yield actuator, model.actuator(actuator).name


def at_start(model: mujoco.MjModel) -> mujoco.MjData:
    """A model at its first keyframe, or as it is written, with its cables' lengths."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    return data


def general(draft: Draft, model: mujoco.MjModel, actuator: int, **changes: str) -> None:
    """Write an actuator as a <general> with all its numbers, as in a model but for some changes."""
    element = draft.named("actuator", model.actuator(actuator).name)
    element.tag = "general"
    for key in SHORTCUTS:
        element.attrib.pop(key, None)
    element.attrib |= _numbers(model, actuator) | changes


def _numbers(model: mujoco.MjModel, actuator: int) -> dict[str, str]:
    def word(enum: type, field: str, prefix: str) -> str:
        return str(enum(int(getattr(model, field)[actuator])).name).removeprefix(prefix).lower()

    def limit(kind: str) -> dict[str, str]:
        limited = bool(getattr(model, f"actuator_{kind}limited")[actuator])
        low, high = getattr(model, f"actuator_{kind}range")[actuator]
        wide = {f"{kind}range": digits(low, high)} if low < high else {}
        return {f"{kind}limited": "true" if limited else "false", **wide}

    return {
        "dyntype": word(mujoco.mjtDyn, "actuator_dyntype", "mjDYN_"),
        "dynprm": digits(model.actuator_dynprm[actuator, 0]),
        "gaintype": word(mujoco.mjtGain, "actuator_gaintype", "mjGAIN_"),
        "gainprm": digits(model.actuator_gainprm[actuator, 0]),
        "biastype": word(mujoco.mjtBias, "actuator_biastype", "mjBIAS_"),
        "biasprm": digits(*model.actuator_biasprm[actuator, :3]),
        "gear": digits(model.actuator_gear[actuator, 0]),
        "actearly": "true" if model.actuator_actearly[actuator] else "false",
        **limit("ctrl"),
        **limit("act"),
        **limit("force"),
    }


class Scale(NamedTuple):
    """A rest length in the new file: `factor` times the old activation or command, plus `offset`."""

    factor: float
    offset: float = 0.0

    def of(self, value: float) -> float:
        """The new value."""
        return self.factor * value + self.offset


@dataclass(frozen=True)
class Keys:
    """Values of each actuator in each keyframe, by the actuators' names.

    Attributes:
      act: activations; without actuators that have none.
      ctrl: commands.
    """

    act: tuple[dict[str, float], ...]
    ctrl: tuple[dict[str, float], ...]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Keys:
        """Those of a model."""
        names = [model.actuator(a).name for a in range(model.nu)]
        stateful = {n: int(model.actuator_actadr[a]) for a, n in enumerate(names)}
        act = tuple(
            {name: float(row[adr]) for name, adr in stateful.items() if adr >= 0}
            for row in model.key_act.reshape(model.nkey, model.na)
        )
        ctrl = tuple(
            dict(zip(names, map(float, row), strict=True))
            for row in model.key_ctrl.reshape(model.nkey, model.nu)
        )
        return cls(act, ctrl)

    def rescale(self, name: str, rest: Scale, told: Scale) -> None:
        """Change an actuator's activations, or commands without any, to rest lengths.

        Args:
          name: of the actuator.
          rest: of the activations.
          told: of the commands.
        """
        for act, ctrl in zip(self.act, self.ctrl, strict=True):
            act[name] = rest.of(act.get(name, ctrl[name]))
            ctrl[name] = told.of(ctrl[name])

    def write(self, draft: Draft) -> None:
        """Write them into the keyframes of a draft whose actuators may have changed."""
        model = compiled(without_keyframes(draft.xml))[2]
        names = [model.actuator(a).name for a in range(model.nu)]
        stateful = [name for a, name in enumerate(names) if model.actuator_actadr[a] >= 0]
        for key, act, ctrl in zip(draft.elements("key"), self.act, self.ctrl, strict=True):
            _write(key, "act", [act[name] for name in stateful])
            _write(key, "ctrl", [ctrl[name] for name in names])


def _write(key: Element, attribute: str, values: list[float]) -> None:
    key.attrib.pop(attribute, None)
    if values:
        key.set(attribute, digits(*values))


def weight_of(model: mujoco.MjModel) -> float:
    """Weight of all that moves [N]."""
    moving = model.body_weldid != 0
    return float(model.body_mass[moving].sum() * np.linalg.norm(model.opt.gravity))
