"""Compile the text of an MJCF into MuJoCo's model: one file of limited size.

MuJoCo's compiler does everything that a text requests, and ignores Ctrl-C meanwhile. The expanded
size of the text is therefore counted before, and its memory requests are checked.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import MjcfError
from flywheel.files import MB, read_text, shown
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.robots.problems import Problems, called

LARGEST = 5 * MB  # of a text [bytes]; those of a robot of 300 bodies have some 0.5 MB
MOST_ELEMENTS = 8000  # copies counted, for which MuJoCo takes 2 s; a robot of 300 bodies has 5,000
DEEPEST = 400  # elements within elements; MuJoCo's own end is at 500
LONGEST_NAME = 100  # characters: columns of recordings, files and rows of tables are named after it
MOST_FREEDOMS = 3000  # of all joints, as of 500 free bodies: MuJoCo's memory grows with the square
MOST_NUMBERS = 100_000  # that all sensors give, that actuators remember, or that are set aside
# Keyframes, or numbers beside each element: both are multiplied by the elements.
MOST_OF_EACH = 1000
MOST_PIXELS = 200 * MB  # of all textures [bytes]; one of 4096 x 4096 has 50 MB
MOST_MEMORY = 2000 * MB  # that is asked for by number [bytes]
FREEDOMS = {
    mujoco.mjtJoint.mjJNT_FREE: 6,
    mujoco.mjtJoint.mjJNT_BALL: 3,
    mujoco.mjtJoint.mjJNT_SLIDE: 1,
    mujoco.mjtJoint.mjJNT_HINGE: 1,
}
IN_BYTES, SET_ASIDE = ("memory", "nstack"), ("njmax", "nconmax", "nuserdata")
WITH_NUMBERS = ("body", "jnt", "geom", "site", "cam", "tendon", "actuator", "sensor")
OF_EACH = ("nkey", *(f"nuser_{kind}" for kind in WITH_NUMBERS))
SIDES_OF_A_CUBE = 6


class _Unfit(NamedTuple):
    """Reason for rejecting an element: its function, and the problem with it."""

    does: str
    but: str


_PLAIN = (
    "a robot is one self-contained file of primitive geoms, because it is sent to workers and "
    "stored with the data"
)
_FILE = _Unfit("reads another file", _PLAIN)
_SHAPE = _Unfit("has a shape that is no primitive", _PLAIN)
_SOFT = _Unfit("has a flexible part", "bodies are rigid here; give them joints or cables")
_PLUGIN = _Unfit("needs a plugin of MuJoCo", "a robot must be the same on every installation")
_MUSCLE = _Unfit(
    "has a muscle",
    "no winch is one, and MuJoCo's compiler may simulate for ever to find its lengths",
)
_SEARCH = _Unfit(
    "lets MuJoCo look for the lengths of its actuators",
    'no winch needs that, and the compiler may simulate for ever: delete it, or write mode="none"',
)
_DOUBLED = _Unfit(
    "has a sensor of nothing beside <replicate>",
    "MuJoCo doubles it with each copy: delete it",
)
_PERCENT = _Unfit(
    "has a percent sign in an attribute",
    "MuJoCo may take it for a command of its messages: write another character",
)
UNFIT = {
    **dict.fromkeys(("mesh", "hfield", "skin"), _SHAPE),
    **dict.fromkeys(("include", "model", "attach"), _FILE),
    **dict.fromkeys(("flexcomp", "flex", "deformable", "composite"), _SOFT),
    **dict.fromkeys(("plugin", "extension"), _PLUGIN),
    "muscle": _MUSCLE,
}
KINDS = ("body", "site", "camera", "light", "target", "joint", "geom", "tendon", "actuator")
REFERENCES = {f"{kind}{number}" for kind in KINDS for number in ("", "1", "2")} | {
    *("objname", "refname", "sidesite", "cranksite", "slidersite", "refsite", "jointinparent")
}  # attributes that name another element
WITHOUT_SEARCH = (
    "muscle",
    "none",
)  # modes of <lengthrange> in which a robot without muscles is not simulated
SHOWN = 5  # of the elements that have one problem
TELLING = ("class", "name", "file")  # attributes that tell which element it is
PICTURES = "file"  # how attributes of <texture> begin that read one


def read_mjcf(path: str | Path, what: str = "MJCF") -> str:
    """Text of an MJCF file.

    Args:
      path: of the file.
      what: its kind, for messages: "MJCF", "course".

    Raises:
      MjcfError: see `flywheel.files.read_text`.
    """
    return read_text(path, what, MjcfError, LARGEST)


def compiled(
    xml: str, what: str = "MJCF"
) -> tuple[ElementTree.Element, mujoco.MjSpec, mujoco.MjModel]:
    """The elements of an MJCF, MuJoCo's editable model of it, and its compiled model.

    Raises:
      MjcfError: not an MJCF; one that reads other files or is too large; MuJoCo rejects it; or an actuator
        takes several commands.
    """
    root = parsed(xml, f"The {what}")
    refuse_unfit(root, f"The {what}")
    try:
        with collected_warnings() as said:
            spec = mujoco.MjSpec.from_string(xml)
            if any("NaN" in words for words in said):  # which may stand for "not given"
                raise MjcfError(f"The {what} has an invalid number (nan){_nan(root)}.")
            _refuse_too_much(spec, f"The {what}")
            model = spec.compile()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise MjcfError(f"MuJoCo cannot compile the {what}: {reason}") from error
    _refuse_several_commands(model, what)
    return root, spec, model


def without_keyframes(xml: str) -> str:
    """The same MJCF with no keyframe."""
    root = parsed(xml, "The MJCF")
    for keyframes in root.findall("keyframe"):
        root.remove(keyframes)
    return ElementTree.tostring(root, encoding="unicode")


class _Counting(ElementTree.TreeBuilder):
    """Builds the tree, and stops if a text would expand to too much.

    Args:
      what: name of the text, at the beginning of a sentence.
      comments: keep them.
    """

    def __init__(self, what: str, comments: bool) -> None:
        super().__init__(insert_comments=comments)
        self._what = what
        self._copies = [1]  # of each element that is open
        self._elements = 0

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        """Reject a document type: entities could expand to anything, and name other files."""
        raise MjcfError(
            f"{self._what} begins with <!DOCTYPE {shown(name)}>, as web pages do; an MJCF has none."
        )

    def start(self, tag: str, attributes: dict[str, str]) -> ElementTree.Element:
        """An element opens."""
        self._copies.append(self._copies[-1] * _copies(tag, attributes))
        self._elements += self._copies[-1]  # an empty <replicate> is copied, too
        if self._elements > MOST_ELEMENTS:
            raise MjcfError(
                f"{self._what} has more than {MOST_ELEMENTS:,} elements, including the copies of "
                "<replicate>; that is the limit."
            )
        if len(self._copies) > DEEPEST + 1:
            raise MjcfError(f"{self._what} has more than {DEEPEST} elements within each other.")
        for key in ("name", "model"):
            if len(name := attributes.get(key, "")) > LONGEST_NAME:
                raise MjcfError(
                    f"{self._what} has a {key} of {len(name):,} characters (<{tag} {key}={shown(name)}>); "
                    f"at most {LONGEST_NAME} are allowed."
                )
        return super().start(tag, attributes)

    def end(self, tag: str) -> ElementTree.Element:
        """An element closes."""
        self._copies.pop()
        return super().end(tag)


def _copies(tag: str, attributes: dict[str, str]) -> int:
    """Number of copies of its content made by an element."""
    if tag != "replicate":
        return 1
    try:
        return max(1, int(attributes.get("count", "1")))
    except ValueError:
        return 1  # which MuJoCo refuses


def parsed(xml: str, what: str, comments: bool = False) -> ElementTree.Element:
    """The elements of an MJCF.

    Args:
      xml: its text.
      what: its name, at the beginning of a sentence.
      comments: keep them.

    Raises:
      MjcfError: too large, not XML, or not an MJCF.
    """
    if len(xml) > LARGEST:
        raise MjcfError(f"{what} has {len(xml):,} characters; at most {LARGEST:,.0f} are read.")
    if not xml.strip():
        raise MjcfError(f"{what} is empty; it needs at least <mujoco model=...>.")
    parser = ElementTree.XMLParser(target=_Counting(what, comments))
    try:
        parser.feed(xml)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, UnicodeError) as error:
        raise MjcfError(f"{what} is not valid XML: {error}.") from error
    if root.tag == "robot":
        raise MjcfError(
            f"{what} is a URDF (<robot>), an MJCF (<mujoco>) is needed. MuJoCo converts it: spec = "
            'mujoco.MjSpec.from_file("my.urdf"); spec.compile(); spec.to_file("my.xml"). Then '
            "add cables, winches, sensors and a keyframe."
        )
    if root.tag != "mujoco":
        raise MjcfError(
            f"{what} begins with <{shown(root.tag)[1:-1]}>; an MJCF begins with <mujoco>."
        )
    return root


def refuse_unfit(root: ElementTree.Element, what: str) -> None:
    """Refuse elements that read other files, bend, or need more than winches and rigid bodies.

    Raises:
      MjcfError: there are such elements; the message says all of them.
    """
    found: dict[_Unfit, list[str]] = {}
    for element in root.iter():
        unfit = UNFIT.get(element.tag)
        if element.tag == "texture" and any(key.startswith(PICTURES) for key in element.attrib):
            unfit = _FILE
        if element.tag == "lengthrange" and element.get("mode", "muscle") not in WITHOUT_SEARCH:
            unfit = _SEARCH
        if "muscle" in (element.get("gaintype"), element.get("biastype")):
            unfit = _MUSCLE
        if unfit is None and any("%" in value for value in element.attrib.values()):
            unfit = _PERCENT
        if unfit is not None:
            found.setdefault(unfit, []).append(_begun(element))
    for _, element in doubled_sensors(root):
        found.setdefault(_DOUBLED, []).append(_begun(element))
    problems = Problems()
    for unfit, elements in found.items():
        more = f" and {len(elements) - SHOWN} more" if len(elements) > SHOWN else ""
        reason = f"{what} {unfit.does} ({', '.join(elements[:SHOWN])}{more}); {unfit.but}."
        problems.add(reason, bad_input=True)
    problems.check()


def doubled_sensors(
    root: ElementTree.Element,
) -> list[tuple[ElementTree.Element, ElementTree.Element]]:
    """Sections and sensors, such as <clock>, that MuJoCo doubles with each copy of <replicate>."""
    return [
        (section, element)
        for section in (root.findall("sensor") if root.find(".//replicate") is not None else ())
        for element in section
        if isinstance(element.tag, str) and REFERENCES.isdisjoint(element.keys())
    ]


def _begun(element: ElementTree.Element) -> str:
    """An element as it begins, by what tells it from others."""
    told = (f" {key}={shown(element.get(key))}" for key in TELLING if element.get(key))
    return f"<{element.tag}{''.join(told)}>"


def _nan(root: ElementTree.Element) -> str:
    """Location of the first NaN, as far as known."""
    for element in root.iter():
        for key, value in element.attrib.items():
            if "nan" in value.lower().split() and key not in ("name", "class", "model"):
                name = f" name={shown(element.get('name'))}" if element.get("name") else ""
                return f": <{element.tag}{name} {key}={shown(value)}>"
    return ""


def _refuse_several_commands(model: mujoco.MjModel, what: str) -> None:
    """Reject actuators behind which a command is not at its actuator's number."""
    several = np.flatnonzero(model.actuator_ctrlnum != 1).tolist()
    if several:
        names = ", ".join(called(model, "actuator", actuator) for actuator in several)
        raise MjcfError(
            f"Actuators of the {what} take several commands, or none ({names}), as a <pid> takes a place "
            "and a speed; a winch takes one: write a <position> with timeconst, or a <general>."
        )


def _refuse_too_much(spec: mujoco.MjSpec, what: str) -> None:
    """Reject sizes that MuJoCo would have to allocate, or iterate over, during compilation."""
    asked = {
        "degrees of freedom": (sum(FREEDOMS[joint.type] for joint in spec.joints), MOST_FREEDOMS),
        "numbers of sensors": (sum(map(_numbers_of, spec.sensors)), MOST_NUMBERS),
        "numbers in actuator memories": (
            sum(max(a.nsample, 0) + max(a.actdim, 0) for a in spec.actuators),
            MOST_NUMBERS,
        ),
        "bytes of textures": (sum(map(_bytes_of, spec.textures)), MOST_PIXELS),
        **{f"bytes in <size {name}>": (getattr(spec, name), MOST_MEMORY) for name in IN_BYTES},
        **{f"in <size {name}>": (getattr(spec, name), MOST_NUMBERS) for name in SET_ASIDE},
        **{f"in <size {name}>": (getattr(spec, name), MOST_OF_EACH) for name in OF_EACH},
    }
    for name, (wanted, most) in asked.items():
        if wanted > most:
            raise MjcfError(f"{what} requests {wanted:,} {name}; at most {most:,.0f} are allowed.")


def _numbers_of(sensor: mujoco.MjsSensor) -> int:
    """Number of values of a sensor, including its whole history."""
    each = max(sensor.get_data_size(), sensor.dim, *(int(n) for n in sensor.intprm))
    return each * max(1, sensor.nsample)


def _bytes_of(texture: mujoco.MjsTexture) -> int:
    height = max(texture.height, SIDES_OF_A_CUBE * texture.width)
    return max(0, texture.width) * max(0, height) * texture.nchannel
