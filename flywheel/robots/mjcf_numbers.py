"""Checks that every number of an MJCF is finite and within a sensible range.

MuJoCo accepts infinite time steps, springs that push and masses of 1e200 kg, and silently changes
some numbers. The checks are on the compiled model, where defaults, classes and units are resolved.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import mujoco
import numpy as np

from flywheel.errors import MjcfError
from flywheel.records import Floats
from flywheel.robots.problems import Problems

FAR = 1e4  # [m]; the cables of the largest cable-driven robot, a telescope, are 600 m long
HEAVY = 1e9  # [kg], [kg m^2]
STRONG = 1e12  # [N], [N/m], [N s/m]; a steel rope of 1 cm^2 has 2e7 N/m on a metre
FAST = 1e4  # [m/s], [rad/s], [m/s^2]
LONG = 1e4  # [s]
LARGE = 1e15  # of any other number, so that products of a few stay finite
OBJECTS = {
    "body": ("body", mujoco.mjtObj.mjOBJ_BODY),
    "jnt": ("joint", mujoco.mjtObj.mjOBJ_JOINT),
    "geom": ("geom", mujoco.mjtObj.mjOBJ_GEOM),
    "site": ("site", mujoco.mjtObj.mjOBJ_SITE),
    "cam": ("camera", mujoco.mjtObj.mjOBJ_CAMERA),
    "light": ("light", mujoco.mjtObj.mjOBJ_LIGHT),
    "mat": ("material", mujoco.mjtObj.mjOBJ_MATERIAL),
    "pair": ("contact pair", mujoco.mjtObj.mjOBJ_PAIR),
    "eq": ("equality", mujoco.mjtObj.mjOBJ_EQUALITY),
    "tendon": ("tendon", mujoco.mjtObj.mjOBJ_TENDON),
    "actuator": ("actuator", mujoco.mjtObj.mjOBJ_ACTUATOR),
    "sensor": ("sensor", mujoco.mjtObj.mjOBJ_SENSOR),
    "key": ("keyframe", mujoco.mjtObj.mjOBJ_KEY),
}
PARTS = {"opt": "option", "vis": "visual", "stat": "statistic"}


@dataclass(frozen=True)
class Allowed:
    """Allowed values of a number of MuJoCo's model.

    Attributes:
      field: of `mujoco.MjModel`.
      attribute: of the MJCF for it.
      low, high: the range.
      unit: of all three.
      remark: on a number outside; a sentence.
    """

    field: str
    attribute: str
    low: float
    high: float
    unit: str = ""
    remark: str = ""


ALLOWED = (
    # More steps than this in a control step of 10 ms take seconds; fewer miss all that moves.
    Allowed("opt.timestep", "timestep", 1e-5, 0.1, "s"),
    Allowed(
        "opt.gravity", "gravity", -1e3, 1e3, "m/s^2", "Lengths are in metres, not in millimetres."
    ),
    Allowed("opt.wind", "wind", -1e3, 1e3, "m/s"),
    Allowed("opt.density", "density", 0.0, 1e5, "kg/m^3"),
    Allowed("opt.viscosity", "viscosity", 0.0, 1e5, "Pa s"),
    Allowed("opt.impratio", "impratio", 1e-3, 1e6),
    Allowed("opt.tolerance", "tolerance", 0.0, 1.0),
    Allowed("opt.ls_tolerance", "ls_tolerance", 0.0, 1.0),
    Allowed("opt.noslip_tolerance", "noslip_tolerance", 0.0, 1.0),
    Allowed("opt.ccd_tolerance", "ccd_tolerance", 0.0, 1.0),
    # Of every step; MuJoCo's own numbers are 100 and less.
    Allowed("opt.iterations", "iterations", 1, 1000),
    Allowed("opt.ls_iterations", "ls_iterations", 1, 1000),
    Allowed("opt.noslip_iterations", "noslip_iterations", 0, 1000),
    Allowed("opt.ccd_iterations", "ccd_iterations", 1, 1000),
    Allowed("opt.sdf_iterations", "sdf_iterations", 1, 1000),
    Allowed("opt.sdf_initpoints", "sdf_initpoints", 1, 1000),
    Allowed("vis.global_.offwidth", "offwidth", 1, 8192, "pixels"),
    Allowed("vis.global_.offheight", "offheight", 1, 8192, "pixels"),
    Allowed("vis.quality.shadowsize", "shadowsize", 0, 16384, "pixels"),
    Allowed("vis.quality.offsamples", "offsamples", 0, 64),
    Allowed("jnt_pos", "pos", -FAR, FAR, "m"),
    Allowed("jnt_stiffness", "stiffness", 0.0, STRONG, "N/m"),
    Allowed("jnt_range", "range", -FAR, FAR, "m or rad"),
    Allowed("jnt_margin", "margin", 0.0, FAR, "m or rad"),
    Allowed("dof_damping", "damping", 0.0, STRONG, "N s/m"),
    Allowed("dof_armature", "armature", 0.0, HEAVY, "kg"),
    Allowed("dof_frictionloss", "frictionloss", 0.0, STRONG, "N"),
    Allowed("geom_pos", "pos", -FAR, FAR, "m"),
    Allowed("geom_size", "size", 0.0, FAR, "m"),
    Allowed("geom_friction", "friction", 0.0, 1e3),
    Allowed("geom_margin", "margin", 0.0, FAR, "m"),
    Allowed("geom_gap", "gap", 0.0, FAR, "m"),
    Allowed("site_pos", "pos", -FAR, FAR, "m"),
    Allowed("site_size", "size", 0.0, FAR, "m"),
    Allowed("pair_friction", "friction", 0.0, 1e3),
    Allowed("body_pos", "pos", -FAR, FAR, "m"),
    Allowed("body_ipos", "centre of mass", -FAR, FAR, "m"),
    Allowed("body_mass", "mass", 0.0, HEAVY, "kg"),
    Allowed("body_inertia", "inertia", 0.0, HEAVY * FAR, "kg m^2"),
    Allowed("body_gravcomp", "gravcomp", -1e3, 1e3),
    Allowed("tendon_stiffness", "stiffness", 0.0, STRONG, "N/m"),
    Allowed("tendon_damping", "damping", 0.0, STRONG, "N s/m"),
    Allowed("tendon_frictionloss", "frictionloss", 0.0, STRONG, "N"),
    Allowed("tendon_armature", "armature", 0.0, HEAVY, "kg"),
    Allowed("tendon_lengthspring", "springlength", 0.0, FAR, "m"),
    Allowed("tendon_range", "range", -FAR, FAR, "m"),
    Allowed("tendon_width", "width", 0.0, FAR, "m"),
    Allowed("actuator_gainprm", "gainprm", -STRONG, STRONG),
    Allowed("actuator_biasprm", "biasprm", -STRONG, STRONG),
    Allowed("actuator_dynprm", "dynprm", 0.0, LONG, "s"),
    Allowed("actuator_forcerange", "forcerange", -STRONG, STRONG, "N"),
    Allowed("actuator_ctrlrange", "ctrlrange", -FAST, FAST, "m/s or m"),
    Allowed("actuator_actrange", "actrange", -FAR, FAR, "m"),
    Allowed("sensor_noise", "noise", 0.0, FAR),
    Allowed("sensor_cutoff", "cutoff", 0.0, LARGE),
    Allowed("key_qpos", "qpos", -FAR, FAR, "m or rad"),
    Allowed("key_qvel", "qvel", -FAST, FAST, "m/s or rad/s"),
    Allowed("key_act", "act", -FAR, FAR, "m"),
    # Unless they are given, MuJoCo derives these from the ones above.
    Allowed("stat.extent", "extent", 1e-6, FAR, "m"),
    Allowed("stat.center", "center", -FAR, FAR, "m"),
    Allowed("stat.meansize", "meansize", 0.0, FAR, "m"),
    Allowed("stat.meanmass", "meanmass", 0.0, HEAVY, "kg"),
    Allowed("stat.meaninertia", "meaninertia", 0.0, HEAVY * FAR, "kg m^2"),
)
# Two formats in one: a time constant and a damping ratio, or minus a stiffness and minus a damping.
# With one of each MuJoCo takes its own numbers instead.
SOLREF = (
    "needs solref with two numbers above 0 (time constant, damping ratio) or two below (-stiffness, "
    "-damping)"
)
# Least and most impedance, width, midpoint, power. What is outside MuJoCo moves to the end.
SOLIMP = ((0.0, 1.0), (0.0, 1.0), (0.0, FAR), (0.0, 1.0), (1.0, 1e3))


def check_numbers(model: mujoco.MjModel, what: str) -> None:
    """Reject a number that is not finite, or outside its range.

    Args:
      model: compiled.
      what: its name, at the beginning of a sentence: "The MJCF".

    Raises:
      MjcfError: some are; the message names the elements, their attributes, and the allowed values.
    """
    problems = Problems()
    for allowed in ALLOWED:
        problems.attempt(partial(_refuse_outside, model, allowed, what))
    problems.check()
    fields = [name for name in dir(model) if not name.startswith("_")]
    arrays = {name: getattr(model, name) for name in fields}
    arrays = {n: a for n, a in arrays.items() if isinstance(a, np.ndarray) and a.dtype.kind == "f"}
    for name, array in (arrays | {"opt.o_solref": model.opt.o_solref}).items():
        if "_solref" in name:
            _check_solref(model, name, array.reshape(-1, 2), what)
    for name, array in (arrays | {"opt.o_solimp": model.opt.o_solimp}).items():
        if "_solimp" in name:
            _check_solimp(model, name, array.reshape(-1, 5), what)
    for name, array in arrays.items():
        wrong = ~(np.abs(array) <= LARGE)
        if wrong.any():
            row = np.argwhere(wrong)[0]
            raise MjcfError(
                f"{_element(model, name, int(row[0]), what)} has {name.partition('_')[2] or name} "
                f"{array[tuple(row)]:g}; numbers must be finite, and at most {LARGE:g}."
            )


def _refuse_outside(model: mujoco.MjModel, allowed: Allowed, what: str) -> None:
    values = np.atleast_1d(np.asarray(attrgetter(allowed.field)(model), float))
    wrong = ~((values >= allowed.low) & (values <= allowed.high))  # NaN, too
    if wrong.any():
        place = np.argwhere(wrong)[0]
        unit = f" {allowed.unit}" if allowed.unit else ""
        raise MjcfError(
            f"{_element(model, allowed.field, int(place[0]), what)} has {allowed.attribute} "
            f"{values[tuple(place)]:g}{unit}; allowed {allowed.low:g} to {allowed.high:g}{unit}. "
            f"{allowed.remark}".rstrip()
        )


def _check_solref(model: mujoco.MjModel, field: str, pairs: Floats, what: str) -> None:
    first, second = pairs.T
    right = np.where(first > 0, second >= 0, second <= 0) & (np.abs(pairs) <= LARGE).all(axis=1)
    if not right.all():
        row = int(np.flatnonzero(~right)[0])
        raise MjcfError(
            f"{_element(model, field, row, what)} {SOLREF}; got {first[row]:g} {second[row]:g}."
        )


def _check_solimp(model: mujoco.MjModel, field: str, rows: Floats, what: str) -> None:
    low, high = np.array(SOLIMP).T
    wrong = ~((rows >= low) & (rows <= high)).all(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        each = ", ".join(f"{a:g} to {b:g}" for a, b in SOLIMP)
        got = " ".join(f"{value:g}" for value in rows[row])
        raise MjcfError(
            f"{_element(model, field, row, what)} has solimp {got}; allowed are {each}."
        )


def _element(model: mujoco.MjModel, field: str, row: int, what: str) -> str:
    """Element of a row of a field, at the beginning of a sentence."""
    prefix = field.partition("_")[0]
    if prefix == "dof":
        prefix, row = "jnt", int(model.dof_jntid[row])
    if prefix not in OBJECTS:
        part = field.partition(".")[0]
        return f"{what}'s <{PARTS.get(part, prefix)}>"
    kind, number = OBJECTS[prefix]
    name = mujoco.mj_id2name(model, number, row)
    return f"The {kind} {name!r}" if name else f"The {kind} number {row} (counted from 0)"
