"""Remarks on an MJCF that can be used, and may not be meant as it is."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from flywheel.robots.robot import Robot

HARDLY = 1e-9  # [m]; more than a limit may be exceeded by for how numbers are written


def remarks(robot: Robot) -> Iterator[str]:
    """Sentences on limits of tendons, slack cables and sensors; none for most robots."""
    model = mujoco.MjModel.from_xml_string(robot.xml)
    data = mujoco.MjData(model)
    data.qpos[:] = robot.keyframe.qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    yield from without_winches(robot)
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
    yield from _on_damping(model, robot)
    yield from _on_constraints(model)
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


def _on_damping(model: mujoco.MjModel, robot: Robot) -> Iterator[str]:
    pushing = [
        repr(cable.name)
        for tendon, cable in enumerate(robot.cables)
        if cable.winch >= 0 and model.tendon_damping[tendon] > 0
    ]
    if pushing:
        yield (
            f"The damping of the winched tendons {', '.join(pushing)} acts while they are slack, too, and "
            "pushes their ends apart; that in biasprm (its third number) only pulls."
        )


def _on_constraints(model: mujoco.MjModel) -> Iterator[str]:
    names = [model.eq(i).name or f"number {i}" for i in range(model.neq)]
    if names:
        yield (
            f"Equality constraints ({', '.join(names)}) act beside the cables: the plant has them, networks "
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
