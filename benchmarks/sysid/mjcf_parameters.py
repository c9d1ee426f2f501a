"""The numbers of a robot's MJCF, as parameters that `mujoco.sysid` can free.

Nearly all are relative to the MJCF's values, so that steps of one size suit them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import sysid

from flywheel.dynamics.plant.world import strip_visuals
from flywheel.records import Floats

INERTIA = (
    "mass", "stretch_x", "stretch_y", "stretch_z", "shear_xy", "shear_yz", "shear_xz",
    "centre_x", "centre_y", "centre_z",
)  # fmt: skip


# Bounds of a body's centre [m] and shear; sysid's own, 0.5 for both, let a slender rod become a plate.
CENTRE, SHEAR = 0.2, 0.05


@dataclass(frozen=True)
class Kind:
    """A number common to every element of a group.

    Attributes:
      name: of the number.
      unit: "1" if it is relative to the MJCF's.
      nominal: value in the MJCF.
      low, high: bounds.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float


# Offset: of the rest length; gain: of how far the winch turns, whatever it is told.
WINCH = (
    Kind("gain", "1", 1.0, 0.5, 1.5),
    Kind("offset", "m", 0.0, -0.2, 0.2),
    Kind("stiffness", "1", 1.0, 0.2, 5.0),
    Kind("damping", "1", 1.0, 0.0, 10.0),
)
CABLE = (
    Kind("stiffness", "1", 1.0, 0.2, 5.0),
    Kind("damping", "1", 1.0, 0.0, 10.0),
    Kind("rest_length", "1", 1.0, 0.8, 1.2),
)
FRICTION = (Kind("friction", "weights", 0.0, 0.0, 0.15),)
GROUND = (
    Kind("stiffness", "1", 1.0, 0.1, 10.0),
    Kind("damping", "1", 1.0, 0.1, 10.0),
    Kind("sliding", "1", 1.0, 0.3, 3.0),
    Kind("torsional", "m", 0.0, 0.0, 0.05),
    Kind("rolling", "m", 0.0, 0.0, 0.05),
)


@dataclass(frozen=True)
class Block:
    """One of sysid's parameters, and the meaning of its entries.

    Attributes:
      parameter: sysid's.
      labels: (name, unit) of each entry.
      shown: displayed values of all entries.
    """

    parameter: sysid.Parameter
    labels: tuple[tuple[str, str], ...]
    shown: Callable[[Floats], Floats]


def open_spec(xml: str) -> mujoco.MjSpec:
    """The MJCF with dry friction of tendons switched on, and without warm starts, as in `Plant`."""
    spec = mujoco.MjSpec.from_string(xml)
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
    return spec


def bare_spec(xml: str) -> mujoco.MjSpec:
    """An MJCF without textures and materials, which compiles ten times as fast."""
    spec = open_spec(xml)
    strip_visuals(spec)
    return spec


def blocks(spec: mujoco.MjSpec) -> list[Block]:
    """All numbers that a user would free in a robot of rods and cables.

    For each winch its gain, offset, stiffness and damping; for each passive cable stiffness, damping and
    rest length; for every cable dry friction; for each body all ten numbers of its inertia; stiffness,
    damping and friction of all contacts.
    """
    model = spec.compile()
    passive = [t.name for t in spec.tendons if t.stiffness[0] > 0]
    cables = [t.name for t in spec.tendons]
    winches = [a.name for a in spec.actuators]
    bodies = [b.name for b in spec.bodies[1:] if model.body_dofnum[b.id] > 0]
    found = [
        _block("winches", winches, WINCH, _write_winches(model, winches)),
        _block("cables", passive, CABLE, _write_cables(model, passive)),
        _block("friction", cables, FRICTION, _write_friction(model, cables)),
        _block("ground", ["ground"], GROUND, _write_ground(spec)),
        *(_inertia(spec, model, body) for body in bodies),
    ]
    return [block for block in found if block.labels]


def _block(
    name: str,
    places: Sequence[str],
    kinds: Sequence[Kind],
    write: Callable[[mujoco.MjSpec, Floats], None],
) -> Block:
    """Parameter of shape (places, kinds), written by `write`."""

    def column(pick: Callable[[Kind], float]) -> Floats:
        return np.tile([pick(kind) for kind in kinds], (len(places), 1))

    parameter = sysid.Parameter(
        name,
        column(lambda k: k.nominal),
        column(lambda k: k.low),
        column(lambda k: k.high),
        modifier=lambda spec, p: write(spec, p.value),
    )
    labels = tuple((f"{place}.{kind.name}", kind.unit) for place in places for kind in kinds)
    return Block(parameter, labels, lambda values: values)


def _write_winches(
    model: mujoco.MjModel, names: Sequence[str]
) -> Callable[[mujoco.MjSpec, Floats], None]:
    elements = [model.actuator(name) for name in names]
    held = [model.key_act[0, int(element.actadr[0])] for element in elements]
    stiffness = [element.gainprm[0] for element in elements]
    damping = [element.biasprm[2] for element in elements]

    def write(spec: mujoco.MjSpec, values: Floats) -> None:
        for name, act, k, c, (gain, offset, by_k, by_c) in zip(
            names, held, stiffness, damping, values, strict=True
        ):
            winch = spec.actuator(name)
            winch.gainprm[0] = gain * by_k * k
            winch.biasprm[:3] = [by_k * k * ((1.0 - gain) * act + offset), -by_k * k, by_c * c]

    return write


def _write_cables(
    model: mujoco.MjModel, names: Sequence[str]
) -> Callable[[mujoco.MjSpec, Floats], None]:
    ids = [model.tendon(name).id for name in names]
    nominal = np.stack(
        [model.tendon_stiffness[ids], model.tendon_damping[ids], model.tendon_lengthspring[ids, 1]],
        axis=1,
    )

    def write(spec: mujoco.MjSpec, values: Floats) -> None:
        for name, (stiffness, damping, rest) in zip(names, values * nominal, strict=True):
            cable = spec.tendon(name)
            cable.stiffness[0], cable.damping[0], cable.springlength[1] = stiffness, damping, rest

    return write


def _write_friction(
    model: mujoco.MjModel, names: Sequence[str]
) -> Callable[[mujoco.MjSpec, Floats], None]:
    weight = float(np.linalg.norm(model.opt.gravity) * model.body_mass.sum())

    def write(spec: mujoco.MjSpec, values: Floats) -> None:
        for name, share in zip(names, values[:, 0], strict=True):
            spec.tendon(name).frictionloss = share * weight

    return write


def _write_ground(spec: mujoco.MjSpec) -> Callable[[mujoco.MjSpec, Floats], None]:
    nominal = [(np.array(geom.solref), float(geom.friction[0])) for geom in spec.geoms]
    paired = [(np.array(pair.solref), np.array(pair.friction[:2])) for pair in spec.pairs]

    def write(spec: mujoco.MjSpec, values: Floats) -> None:
        (stiffness, damping, sliding, torsional, rolling) = values[0]
        for geom, (solref, friction) in zip(spec.geoms, nominal, strict=True):
            geom.solref[:] = solref * [stiffness, damping]
            geom.friction[:] = [sliding * friction, torsional, rolling]
        for pair, (solref, along) in zip(spec.pairs, paired, strict=True):
            pair.solref[:] = solref * [stiffness, damping]
            pair.friction[:] = [*(sliding * along), torsional, rolling, rolling]

    return write


def _inertia(spec: mujoco.MjSpec, model: mujoco.MjModel, body: str) -> Block:
    """All ten numbers of a body's inertia, in sysid's logarithmic way, shown in plain units."""

    def write(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        sysid.apply_body_inertia(spec, body, parameter)
        spec.body(body).iquat[:] = [
            1,
            0,
            0,
            0,
        ]  # MuJoCo 4.0.0 does not compile the NaN that sysid leaves

    parameter = sysid.body_inertia_param(
        spec,
        model,
        body,
        sysid.InertiaType.Pseudo,
        ipos_bound_off=np.array([-CENTRE, CENTRE]),
        shear_bound_off=np.array([-SHEAR, SHEAR]),
        modifier=write,
    )
    nominal = parameter.as_nominal_vector()

    def shown(values: Floats) -> Floats:
        mass, stretch = np.exp(2 * values[:1]), np.exp(2 * (values[1:4] - nominal[1:4]))
        return np.concatenate([mass, stretch, values[4:]])

    units = ("kg", *("1",) * 6, *("m",) * 3)
    labels = tuple((f"{body}.{name}", unit) for name, unit in zip(INERTIA, units, strict=True))
    return Block(parameter, labels, shown)
