"""Effects on the numbers of a robot as built: lengths, places, masses and drums, part by part."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from flywheel.effects.cable_effects import pulls_on
from flywheel.effects.effect import RESTS, CommandEffect, ModelEffect, Numbers, Parameter, Values
from flywheel.effects.winch_effects import wound_on
from flywheel.records import Floats
from flywheel.robots import Robot, moving_bodies, turn_of

AXES = ("x", "y", "z")
FIRST = 0.01  # of the robot's length: what somebody notices who measures it
OFFSET = tuple(
    Parameter(axis, "m", lambda s: FIRST * s.length, low=-10.0, high=10.0) for axis in AXES
)


class CableLength(ModelEffect):
    """A cable whose rest length differs from the MJCF, or from the winch position."""

    name = "cable_length"
    where = "cable"
    sizes = (Parameter("offset", "m", lambda s: FIRST * s.length, low=-10.0, high=10.0),)
    winch_kinds = RESTS
    equation = "l0 -> l0 + o"
    source = "geometry"
    shown_by = "slow strokes that load the cables one after the other"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        model.tendon_lengthspring[place] += values["offset"]
        pulls = pulls_on(model, [place])  # -k (length - act) becomes -k (length - act - offset)
        model.actuator_biasprm[pulls, 0] -= model.actuator_biasprm[pulls, 1] * values["offset"]


class CableLoss(ModelEffect):
    """A cable with more, or less, damping than in the MJCF."""

    name = "cable_loss"
    where = "cable"
    sizes = (Parameter("share", "-", lambda s: 0.3, low=-3.3, high=20.0),)
    equation = "c (1 + s) at one cable"
    source = "Kelvin-Voigt element"
    shown_by = "fast strokes that load the cables one after the other"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        factor = 1.0 + values["share"]
        model.tendon_damping[place] *= factor
        model.tendon_dampingpoly[place] *= factor
        model.actuator_biasprm[pulls_on(model, [place]), 2] *= factor


class CableEnd(ModelEffect):
    """An end of a cable, an attachment or an anchor, away from its place in the MJCF."""

    name = "cable_end"
    where = "end"
    sizes = OFFSET
    equation = "a -> a + (x, y, z), in the frame of its body"
    source = "geometry"
    shown_by = "large motions in all directions"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        assert place is not None
        cable, last = divmod(place, 2)
        steps = model.tendon_num[cable] - 1 if last else 0
        site = model.wrap_objid[model.tendon_adr[cable] + steps]
        turn = turn_of(model, int(model.site_bodyid[site]))
        model.site_pos[site] += turn.T @ [values[axis] for axis in AXES]


class MassOfBody(ModelEffect):
    """One body heavier or lighter than in the MJCF, with its inertia."""

    name = "mass_of_body"
    where = "body"
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-15.0, high=40.0),)
    equation = "m (1 + s), I (1 + s) of one body"
    source = "Newton's second law"
    shown_by = "drops and fast strokes"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        pieces = _pieces(model, place)
        model.body_mass[pieces] *= 1.0 + values["share"]
        model.body_inertia[pieces] *= 1.0 + values["share"]


class InertiaOfBody(ModelEffect):
    """One body with more, or less, inertia than in the MJCF."""

    name = "inertia_of_body"
    where = "body"
    sizes = (Parameter("share", "-", lambda s: 0.1, low=-8.0, high=40.0),)
    equation = "I (1 + s) of one body, or of each piece that is welded to it"
    source = "Euler's equations"
    shown_by = "turning fast"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        model.body_inertia[_pieces(model, place)] *= 1.0 + values["share"]


class InertiaByAxis(ModelEffect):
    """One body with other moments of inertia than in the MJCF, about each of its principal axes.

    Each is named after the axis of the body that is nearest to it: MuJoCo sorts them by size.
    """

    name = "inertia_by_axis"
    where = "body"
    sizes = tuple(replace(InertiaOfBody.sizes[0], name=axis) for axis in AXES)
    equation = "(Ix, Iy, Iz) -> ((1 + x) Ix, (1 + y) Iy, (1 + z) Iz), about its principal axes"
    source = "Euler's equations"
    shown_by = "turning fast about each axis"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        # Start-up time: as in flywheel.smoothing.
        from scipy.optimize import linear_sum_assignment
        from scipy.spatial.transform import Rotation

        factors = np.array([1.0 + values[axis] for axis in AXES])
        for piece in _pieces(model, place):
            axes = (
                turn_of(model, piece)
                @ Rotation.from_quat(model.body_iquat[piece], scalar_first=True).as_matrix()
            )
            _, nearest = linear_sum_assignment(-np.abs(axes.T))
            model.body_inertia[piece] *= factors[nearest]


class CentreOfMass(ModelEffect):
    """One body whose centre of mass differs from the MJCF."""

    name = "centre_of_mass"
    where = "body"
    moves_mass = True
    sizes = OFFSET
    equation = "c -> c + (x, y, z), in the frame of the body"
    source = "Newton's second law"
    shown_by = "lying and standing in different ways, slowly"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        offset = np.array([values[axis] for axis in AXES])
        for piece in _pieces(model, place):
            model.body_ipos[piece] += turn_of(model, piece).T @ offset


class DrumRadius(CommandEffect):
    """One winch with a larger or smaller drum, see `wound_on`."""

    name = "drum_radius"
    where = "winch"
    stage = 2
    sizes = (Parameter("share", "-", lambda s: 0.05, low=-10.0, high=10.0),)
    winch_kinds = RESTS
    equation = "r -> (1 + g) r, or l -> l_k + (1 + g) (l - l_k)"
    source = "kinematics of the drum"
    shown_by = "long strokes of one winch after the other"

    def command(self, controls: Floats, values: Values, robot: Robot, dt: float) -> Floats:
        return wound_on(controls, values["share"], robot)


def _pieces(model: mujoco.MjModel, place: int | None) -> list[int]:
    """MuJoCo's numbers of a body of the robot, and of all bodies welded to it."""
    assert place is not None
    root = moving_bodies(model)[place]
    return [piece for piece in range(model.nbody) if model.body_weldid[piece] == root]
