"""Remarks on an MJCF that can be used, and may not be meant as it is."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from flywheel.robots.cables import clamped_actuator
from flywheel.robots.robot import Robot

HARDLY = 1e-9  # [m]; more than a limit may be exceeded by for how numbers are written
HEAVY = 25.0  # [m/s^2]; more than on any planet
SLOW = 300.0  # [s] through all its positions: no episode shows a winch that takes longer


def remarks(robot: Robot) -> Iterator[str]:
    """Sentences on limits of tendons, slack cables, friction and sensors; none for most robots."""
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    data.qpos[:] = robot.keyframe.qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    yield from without_winches(robot)
    if (gravity := float(np.linalg.norm(model.opt.gravity))) > HEAVY:
        yield (
            f"Its gravity is {gravity:g} m/s^2: are its lengths in decimetres or centimetres? They are taken "
            "to be metres, and so are those of its recordings."
        )
    if robot.tension_driven:
        yield (
            "Its winches take tensions: recordings, compare, diagnose, power and design know them; networks, "
            "and runs, which train some, do not."
        )
    yield from _on_limits(model, data)
    rest = np.array([cable.rest_length for cable in robot.cables])
    if (data.ten_length <= rest).all() and not robot.tension_driven:
        yield (
            "No cable is taut at its keyframe: nothing holds it there, and it falls in. Rest lengths (act, "
            "springlength) shorter than the cables are there give tension."
        )
    yield from _on_slack(model, robot)
    yield from _on_slow_winches(robot)
    yield from _on_friction(model, robot)
    yield from _beside(model, robot)
    yield from _on_sensors(model, robot)


def without_winches(robot: Robot) -> Iterator[str]:
    """A sentence on a robot that nothing moves but its start; none for one with winches."""
    if not robot.winches:
        names = ", ".join(repr(cable.name) for cable in robot.cables)
        yield (
            "It has no winch: nothing can be commanded. recordings, compare and diagnose take logs of its "
            f"motion; runs and experiments need a winch. Passive cables ({names}) become winches by robot "
            "adapt --winch NAME."
        )


def _on_limits(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[str]:
    for tendon in range(model.ntendon):
        most, length = model.tendon_range[tendon, 1], data.ten_length[tendon]
        if model.tendon_limited[tendon] and length > most + HARDLY:
            yield (
                f"The tendon {model.tendon(tendon).name!r} may be {most:g} m long at most (its range), "
                f"and is {length:.4g} m at the keyframe: MuJoCo pulls it in at once, as a stiff limit. A "
                "rest length is springlength, or act of a winch."
            )


def _on_slack(model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    """Forces of winched cables that they have while they are slack, too."""
    found: dict[str, list[str]] = {}
    for winch in robot.winches:
        for tendon, actuator in zip(winch.cables, winch.actuators, strict=True):
            acting = {
                "damping": model.tendon_damping[tendon] + model.actuator_damping[actuator],
                "armature": model.tendon_armature[tendon] + model.actuator_armature[actuator],
                "frictionloss": model.tendon_frictionloss[tendon],
            }
            for word, value in acting.items():
                if value > 0:
                    found.setdefault(word, []).append(repr(robot.cables[tendon].name))
    for word, names in found.items():
        instead = "; that in biasprm (its third number) only pulls" * (word == "damping")
        yield (
            f"The {word} of the winched tendons {', '.join(names)} acts while they are slack, too, and "
            f"can push their ends apart{instead}."
        )


def _on_slow_winches(robot: Robot) -> Iterator[str]:
    slow = {
        repr(winch.name): (winch.rest_range[1] - winch.rest_range[0]) / max(winch.control_range)
        for winch in robot.winches
        if winch.kind == "rate" and max(winch.control_range) > 0
    }
    if slow and min(slow.values()) > SLOW:
        yield (
            f"The winches {', '.join(slow)} take at least {min(slow.values()):.3g} s from their shortest to "
            "their longest rest length: is their ctrlrange in m/s?"
        )


def _on_friction(model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    """A sentence on a pyramid as the cone of friction at a ground; none if no contact has friction."""
    pyramid = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    if robot.grounded and pyramid and model.geom_condim.max() > 1:
        yield (
            "Its friction depends on the direction: with MuJoCo's default cone, a pyramid, it is up to 30 % "
            'less between the axes of a contact than along them. <option cone="elliptic"/> makes it the same '
            "in all, as that of a real floor."
        )


def _beside(model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    """Forces that are no cable's: constraints, and passive actuators beside those that are cables."""
    own: set[int | None] = {actuator for winch in robot.winches for actuator in winch.actuators}
    own |= {clamped_actuator(model, t) for t, cable in enumerate(robot.cables) if cable.winch < 0}
    actuators = [model.actuator(i).name for i in range(model.nu) if i not in own]
    constraints = [model.eq(i).name or f"number {i}" for i in range(model.neq)]
    for kind, names in (("Equality constraints", constraints), ("Passive actuators", actuators)):
        if names:
            yield (
                f"{kind} ({', '.join(names)}) act beside the cables: the plant has them, networks "
                "do not see them."
            )


def _on_sensors(model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    used = {point.name for point in robot.points} | {winch.sensor for winch in robot.winches}
    names = [model.sensor(i).name for i in range(model.nsensor)]
    if over := [repr(name) for name in names if name not in used]:
        yield (
            f"Sensors that are passed over: {', '.join(over)}. Tracked points are framepos sensors of sites "
            "on bodies that move (objtype site, no reftype)."
        )
