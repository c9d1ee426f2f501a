"""Reading a robot from its MJCF, and rejecting robots that are not cable-driven.

Mapping:

- every body that moves is a rigid body; bodies welded to it are part of it;
- every tendon is a cable between two sites, one of them at least on a moving body;
- every actuator on a tendon is a winch (`winches.py` lists the kinds); a custom tuple of actuators
  is one winch that drives all their cables equally;
- an actuator whose control has no effect (`gainprm="0"`) is passive: never a control;
- every `framepos` sensor of a site is a tracked point, named by the sensor;
- a `user` sensor whose object is a winch's actuator marks the winch's position as measured;
- the first keyframe, with `act`, is the state after every reset.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from flywheel.errors import MjcfError, RobotError
from flywheel.records import Floats, State
from flywheel.robots.bodies import moving_bodies, read_bodies
from flywheel.robots.cables import read_cables, refuse_bent, refuse_without_cables
from flywheel.robots.ground import ground_of
from flywheel.robots.integrators import integrator_of
from flywheel.robots.mjcf_numbers import check_numbers
from flywheel.robots.mjcf_source import compiled, read_mjcf, without_keyframes
from flywheel.robots.mujoco_warnings import collected_warnings
from flywheel.robots.parts import Body, Cable, TrackedPoint, Winch
from flywheel.robots.problems import Problems, called
from flywheel.robots.robot import Robot
from flywheel.robots.winches import read_winches

# Of a robot's length [m]: below, contacts and cables of MuJoCo are of the same size.
SHORTEST = 1e-3
MOST_CONTACTS = 5000  # at the keyframe: MuJoCo takes a second for a step with 60,000
UPRIGHT = 1e-3  # of gravity that may be sideways: what a measured vector has for its numbers
SHOWN = 6  # of the joints that a message names
SINGLE = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)  # of one number
# What a robot's cables, winches and sensors cannot do without, by MuJoCo's bit and the MJCF's word.
NEEDED = {
    mujoco.mjtDisableBit.mjDSBL_ACTUATION: "actuation",
    mujoco.mjtDisableBit.mjDSBL_SPRING: "spring",
    mujoco.mjtDisableBit.mjDSBL_DAMPER: "damper",
    mujoco.mjtDisableBit.mjDSBL_SENSOR: "sensor",
    mujoco.mjtDisableBit.mjDSBL_AUTORESET: "autoreset",
}


def read_robot(source: str | Path) -> Robot:
    """Read a robot from an MJCF file, or from its text (anything that starts with "<").

    Raises:
      RobotError: the MJCF cannot be used; the message says which elements and what is allowed, the
        decisive problem first.
    """
    is_text = isinstance(source, str) and source.lstrip().startswith("<")
    xml = str(source) if is_text else read_mjcf(source)
    root, spec, model, misfit = _compiled(xml)
    keyframe = _keyframe(model)
    bodies, points, winches, cables = _parts(root, spec, model, keyframe, misfit)
    # The digest is independent of comments, layout and the order of attributes.
    canonical = ElementTree.canonicalize(xml, strip_text=True, with_comments=False)
    return Robot(
        name=root.attrib["model"],
        xml=xml,
        digest=hashlib.sha256(canonical.encode()).hexdigest(),
        bodies=bodies,
        points=points,
        cables=cables,
        winches=winches,
        keyframe=keyframe,
        timestep=float(model.opt.timestep),
        integrator=integrator_of(model),
        length=_characteristic_length(bodies, points, cables),
        grounded=ground_of(model) is not None,
        free=bool((model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).all()),
    )


def _compiled(
    xml: str,
) -> tuple[ElementTree.Element, mujoco.MjSpec, mujoco.MjModel, MjcfError | None]:
    """The same as `compiled`, and why MuJoCo refuses the keyframes, without which it is compiled then.

    A keyframe does not fit where actuators are not what they were meant to be; then that has to be told, too.
    """
    try:
        return *compiled(xml), None
    except MjcfError as error:
        if "keyframe" not in str(error):
            raise
        try:
            return *compiled(without_keyframes(xml)), error
        except MjcfError:
            raise error from None


def _parts(
    root: ElementTree.Element,
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    keyframe: State,
    misfit: MjcfError | None,
) -> tuple[tuple[Body, ...], tuple[TrackedPoint, ...], tuple[Winch, ...], tuple[Cable, ...]]:
    """The parts of a robot.

    Args:
      keyframe: see `_keyframe`.
      misfit: see `_compiled`.

    Raises:
      MjcfError: MuJoCo refuses it, or it has numbers that cannot be.
      RobotError: something else is wrong; both say everything that is.
    """
    problems = Problems()
    for structure in (_refuse_immovable, _refuse_moved, refuse_without_cables, refuse_bent):
        problems.attempt(partial(structure, model))
    _check_numbers(problems, root, model)
    problems.attempt(partial(_refuse_tilted, model))
    winches = problems.attempt(partial(read_winches, model, keyframe.act))
    problems.attempt(partial(_refuse_keyless, model, misfit))
    for refuse in (_refuse_disabled, _refuse_memories, _refuse_unnamed, _refuse_limited_joints):
        problems.attempt(partial(refuse, model))
    problems.attempt(partial(_refuse_joints_out_of_range, model, keyframe))
    data = problems.attempt(partial(_placed, model, keyframe))
    seen = cables = None
    if data is not None:
        if moving_bodies(model):
            seen = problems.attempt(partial(read_bodies, spec, model, data))
        bodies, points = seen or ((), ())
        read = partial(read_cables, model, data, bodies, points, winches, keyframe.act)
        cables = problems.attempt(read)
        problems.attempt(partial(_refuse_equal_columns, points, winches or ()))
    _add_joints(problems, model)
    problems.check()
    assert seen is not None and winches is not None and cables is not None
    return *seen, winches, cables


def _check_numbers(problems: Problems, root: ElementTree.Element, model: mujoco.MjModel) -> None:
    """Add the missing name and the numbers that cannot be.

    Raises:
      MjcfError: there are such numbers, with which nothing can be computed.
    """
    if not root.attrib.get("model"):
        problems.add('The MJCF has no name: write <mujoco model="my_robot">.')
    before = len(problems)
    problems.attempt(partial(check_numbers, model, "The MJCF"))
    if len(problems) > before:
        _add_joints(problems, model)
        problems.check()


def _add_joints(problems: Problems, model: mujoco.MjModel) -> None:
    """Begin the problems of an MJCF that has any with its joints, with which few commands can do anything."""
    held = np.flatnonzero(model.jnt_type != mujoco.mjtJoint.mjJNT_FREE).tolist()
    if problems and held:
        kinds = [mujoco.mjtJoint(int(model.jnt_type[j])).name for j in held]
        joints = [
            (model.joint(j).name, kind.removeprefix("mjJNT_").lower(), model.body(body).name)
            for j, kind, body in zip(held, kinds, model.jnt_bodyid[held].tolist(), strict=True)
        ]
        problems.add_first(about_joints(joints))


def about_joints(joints: Sequence[tuple[str, str, str]]) -> str:
    """A sentence about the joints, by name, kind and body, of an MJCF that cannot be used as it is."""
    each = [
        f"{repr(name) if name else 'without a name'} ({kind}, of "
        f"{f'the body {body!r}' if body else 'a body without a name'})"
        for name, kind, body in joints
    ]
    more = [f"and {len(each) - SHOWN} more"] if len(each) > SHOWN else []
    return (
        f"It has {'the joint' if len(joints) == 1 else 'the joints'} {', '.join([*each[:SHOWN], *more])}. "
        "Robots of free bodies (<freejoint/>) are what compare, diagnose and adapt are made for."
    )


def _refuse_tilted(model: mujoco.MjModel) -> None:
    """Reject gravity that is not along -z; zero gravity is allowed."""
    gravity = gravity_of(model)
    strength = float(np.linalg.norm(gravity))
    if gravity[2] > 0 or np.linalg.norm(gravity[:2]) > UPRIGHT * strength:
        axis = int(np.abs(gravity).argmax())
        along = np.abs(np.delete(gravity, axis)).max() <= UPRIGHT * strength
        where = f"{'+-'[int(gravity[axis] < 0)]}{'xyz'[axis]}" if along else "a slanting line"
        raise MjcfError(
            f'The MJCF has gravity along {where} (<option gravity="{_numbers(gravity)}">); recordings, '
            "grounds and tasks have z up, so it must be along -z: turn the robot, its ground and its "
            f'keyframe, and write gravity="0 0 {-strength:g}".'
        )


def gravity_of(model: mujoco.MjModel) -> Floats:
    """(3,) effective gravity [m/s^2]: zero if a flag switches it off."""
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if off else np.array(model.opt.gravity)


def _numbers(values: np.ndarray) -> str:
    """Numbers in the format of an MJCF attribute."""
    return " ".join(f"{value:g}" for value in values)


def _refuse_unnamed(model: mujoco.MjModel) -> None:
    problems = Problems()
    kinds = {"tendon": model.ntendon, "actuator": model.nu, "sensor": model.nsensor}
    for kind, count in kinds.items():
        unnamed = [index for index in range(count) if not getattr(model, kind)(index).name]
        if unnamed:
            problems.add(
                f"{_numbered(kind, unnamed)} no name; every tendon, actuator "
                "and sensor needs one, because columns of recordings are named after them."
            )
    if unnamed := [index for index in moving_bodies(model) if not model.body(index).name]:
        problems.add(f"{_numbered('moving body', unnamed)} no name; give each one.")
    problems.check()


def _numbered(kind: str, numbers: list[int]) -> str:
    """Elements without names as a subject, with its verb."""
    kinds = {"moving body": "moving bodies"}.get(kind, f"{kind}s")
    numbering = f"number {', '.join(map(str, numbers))} (counted from 0)"
    return f"The {kind} {numbering} has" if len(numbers) == 1 else f"The {kinds} {numbering} have"


def _refuse_equal_columns(points: tuple[TrackedPoint, ...], winches: tuple[Winch, ...]) -> None:
    """Columns of recordings are named after sensors and winches, next to one called time."""
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
            f"{count} columns of a recording would be named {column!r}; rename the sensor or the "
            "actuator."
        )


def _refuse_disabled(model: mujoco.MjModel) -> None:
    off = [flag for bit, flag in NEEDED.items() if model.opt.disableflags & bit]
    if off:
        flags = " ".join(f'{flag}="disable"' for flag in off)
        raise RobotError(f"The MJCF switches off a required feature: <flag {flags}>.")


def _refuse_memories(model: mujoco.MjModel) -> None:
    """Reject state that a `State` cannot contain."""
    size = mujoco.mj_stateSize(model, int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
    if size != 1 + model.nq + model.nv + model.na:
        raise RobotError(
            "The MJCF has a state beyond positions, velocities and activations: delays "
            "(nsample), plastic tendons (springyield) and plugins are not supported. Delays are "
            "an effect."
        )


def _refuse_joints_out_of_range(model: mujoco.MjModel, keyframe: State) -> None:
    problems = Problems()
    single = np.isin(model.jnt_type, [int(kind) for kind in SINGLE])
    for joint in np.flatnonzero(model.jnt_limited & single).tolist():
        low, high = model.jnt_range[joint]
        value = keyframe.qpos[model.jnt_qposadr[joint]]
        if not low <= value <= high:
            problems.add(
                f"The first keyframe has the joint {model.joint(joint).name!r} at {value:g}, allowed "
                f"{low:g} to {high:g} (its range)."
            )
    problems.check()


def _refuse_limited_joints(model: mujoco.MjModel) -> None:
    """Reject limits of what cables do to a joint, which are in no tension that is computed here."""
    problems = Problems()
    for joint in np.flatnonzero(model.jnt_actfrclimited).tolist():
        problems.add_alike(
            "joint",
            called(model, "joint", joint),
            "{} must have no actuatorfrcrange, which limits what cables do to it: the limit of a winch is "
            "its forcerange.",
            f"{tuple(model.jnt_actfrcrange[joint].tolist())}",
        )
    problems.check()


def _placed(model: mujoco.MjModel, keyframe: State) -> mujoco.MjData:
    """The robot at its keyframe, with kinematics computed."""
    data = mujoco.MjData(model)
    data.qpos[:] = keyframe.qpos
    with collected_warnings():
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
    if data.ncon > MOST_CONTACTS:
        raise RobotError(
            f"At the first keyframe there are {data.ncon:,} contacts, at most {MOST_CONTACTS:,} "
            "are allowed: do bodies overlap?"
        )
    return data


def _refuse_immovable(model: mujoco.MjModel) -> None:
    if not moving_bodies(model):
        names = [repr(model.body(i).name) for i in range(1, model.nbody) if model.body(i).name]
        whom = f"give {', '.join(names)} a <freejoint/>" if names else "give one a <freejoint/>"
        raise RobotError(f"No body moves: {whom}.")


def _refuse_moved(model: mujoco.MjModel) -> None:
    moved = [
        called(model, "body", body) for body in np.flatnonzero(model.body_mocapid >= 0).tolist()
    ]
    if moved:
        raise RobotError(
            f"The MJCF has mocap bodies ({', '.join(moved)}), which something else moves; leave them out, or "
            'write mocap="false".'
        )


def _refuse_keyless(model: mujoco.MjModel, misfit: MjcfError | None) -> None:
    if misfit is not None:
        raise misfit
    if model.nkey == 0:
        raise RobotError(
            "The MJCF has no keyframe; give it one with qpos and act (the winches' rest "
            "lengths), the state after every reset."
        )


def _keyframe(model: mujoco.MjModel) -> State:
    """The first keyframe; without any the pose of the MJCF, with rest lengths that winches can have."""
    if model.nkey:
        return State(model.key_qpos[0].copy(), model.key_qvel[0].copy(), model.key_act[0].copy())
    act = np.zeros(model.na)
    for actuator in np.flatnonzero(model.actuator_actadr >= 0).tolist():
        limited = model.actuator_actlimited[actuator]
        limits = model.actuator_actrange if limited else model.actuator_ctrlrange
        act[model.actuator_actadr[actuator]] = limits[actuator].mean()
    return State(model.qpos0.copy(), np.zeros(model.nv), act)


def _characteristic_length(
    bodies: tuple[Body, ...], points: tuple[TrackedPoint, ...], cables: tuple[Cable, ...]
) -> float:
    """Longest distance between two tracked points of one body, else the longest rest length [m]."""
    longest = 0.0
    for body in bodies:
        offsets = np.array([points[i].offset for i in body.points])
        gaps = np.linalg.norm(offsets[:, None] - offsets, axis=-1)
        longest = max(longest, float(gaps.max()))
    length = longest or max(c.rest_length for c in cables)
    if length < SHORTEST:
        raise RobotError(
            f"The robot's length (the longest distance between two tracked points of one body, else the "
            f"longest rest length) is {length:g} m; at least {SHORTEST:g} m are needed."
        )
    return length
