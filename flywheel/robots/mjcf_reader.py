"""Reading a robot off its MJCF, and refusing what cannot be a cable-driven robot.

What stands for what:

- every body that moves is a rigid body; bodies welded to it are part of it;
- every tendon is a cable between two sites, one of them at least on a moving body;
- every actuator on a tendon is a winch (`winches.py` says which kinds there are); a custom tuple of
  actuators is one winch that drives all their cables alike;
- an actuator whose control has no effect (`gainprm="0"`) is passive: never a control;
- every `framepos` sensor of a site is a tracked point, named by the sensor;
- a `user` sensor whose object is a winch's actuator says that the winch's position is measured;
- the first keyframe, with `act`, is where every reset starts.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.records import State
from flywheel.robots.bodies import read_bodies
from flywheel.robots.cables import read_cables
from flywheel.robots.ground import ground_of
from flywheel.robots.robot import Body, Cable, Robot, TrackedPoint, Winch
from flywheel.robots.winches import read_winches

ASSETS = ("mesh", "hfield", "skin", "include", "model")


def read_robot(source: str | Path) -> Robot:
    """Read a robot from an MJCF file, or from its text (anything that starts with "<").

    Raises:
      RobotError: the MJCF cannot be used; the message says which element and what is allowed.
    """
    xml = _text(source)
    root = _parse(xml)
    spec, model = _compile(xml)
    _refuse_unnamed(model)
    keyframe = _keyframe(model)
    data = mujoco.MjData(model)
    data.qpos[:] = keyframe.qpos
    mujoco.mj_kinematics(model, data)
    bodies, points = read_bodies(spec, model, data)
    winches = read_winches(model, keyframe.act)
    cables = read_cables(model, data, bodies, points, winches, keyframe.act)
    _refuse_equal_columns(points, winches)
    return Robot(
        name=root.attrib["model"],
        xml=xml,
        digest=hashlib.sha256(_canonical(xml).encode()).hexdigest(),
        bodies=bodies,
        points=points,
        cables=cables,
        winches=winches,
        keyframe=keyframe,
        timestep=float(model.opt.timestep),
        length=_characteristic_length(bodies, points, cables),
        grounded=ground_of(model) is not None,
    )


def _text(source: str | Path) -> str:
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return source
    try:
        return Path(source).read_text()
    except OSError as error:
        raise RobotError(f"The MJCF {str(source)!r} cannot be read: {error.strerror}.") from error


def _parse(xml: str) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise RobotError(f"The MJCF is not valid XML: {error}.") from error
    if not root.attrib.get("model"):
        raise RobotError('The MJCF has no name: write <mujoco model="my_robot">.')
    for tag in ASSETS:
        if (found := next(root.iter(tag), None)) is not None:
            raise RobotError(
                f"The MJCF reads another file (<{tag} {found.attrib}>); a robot is one self-contained "
                "file of primitive geoms, because it travels to workers and into stored data."
            )
    return root


def _canonical(xml: str) -> str:
    """The MJCF without comments, layout and attribute order, for the digest."""
    return ElementTree.canonicalize(xml, strip_text=True, with_comments=False)


def _compile(xml: str) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    try:
        spec = mujoco.MjSpec.from_string(xml)
        return spec, spec.compile()
    except ValueError as error:
        raise RobotError(f"MuJoCo cannot compile the MJCF: {error}") from error


def _refuse_unnamed(model: mujoco.MjModel) -> None:
    kinds = {"tendon": model.ntendon, "actuator": model.nu, "sensor": model.nsensor}
    for kind, count in kinds.items():
        for index in range(count):
            if not getattr(model, kind)(index).name:
                raise RobotError(
                    f"The {kind} number {index} (counted from 0) has no name; every tendon, actuator "
                    "and sensor needs one, because columns of recordings are named after them."
                )
    for index in range(1, model.nbody):
        if model.body_weldid[index] == index and not model.body(index).name:
            raise RobotError(f"The moving body number {index} has no name; give it one.")


def _refuse_equal_columns(points: tuple[TrackedPoint, ...], winches: tuple[Winch, ...]) -> None:
    """Columns of recordings are named after sensors and winches, beside one that is called time."""
    columns = Counter(
        [
            "time",
            *(f"{point.name}.{axis}" for point in points for axis in "xyz"),
            *(f"ctrl.{winch.name}" for winch in winches),
            *(winch.sensor for winch in winches if winch.sensor),
        ]
    )
    column, count = columns.most_common(1)[0]
    if count > 1:
        raise RobotError(
            f"{count} columns of a recording would be named {column!r}; give the sensor or the actuator "
            "that it comes from another name."
        )


def _keyframe(model: mujoco.MjModel) -> State:
    if model.nkey == 0:
        raise RobotError(
            "The MJCF has no keyframe; give it one with qpos and act (the winches' rest lengths): "
            "every reset starts there."
        )
    return State(model.key_qpos[0].copy(), model.key_qvel[0].copy(), model.key_act[0].copy())


def _characteristic_length(
    bodies: tuple[Body, ...], points: tuple[TrackedPoint, ...], cables: tuple[Cable, ...]
) -> float:
    """Longest distance between two tracked points of one body, else the longest rest length [m]."""
    longest = 0.0
    for body in bodies:
        offsets = np.array([points[i].offset for i in body.points])
        gaps = np.linalg.norm(offsets[:, None] - offsets, axis=-1)
        longest = max(longest, float(gaps.max()))
    return longest or max(c.rest_length for c in cables)
