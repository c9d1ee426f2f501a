"""Effects of the ground and of the contacts with it."""

from __future__ import annotations

import mujoco
import numpy as np

from flywheel.effects.effect import ModelEffect, Numbers, Parameter
from flywheel.robots import Robot

ROLLING = 2  # column of MuJoCo's friction coefficients
PAIRED = slice(3, 5)  # the same of a pair of geoms, one for each direction
FULL = 6  # condim with sliding, turning and rolling friction


class GroundFriction(ModelEffect):
    """Ground with more, or less, friction than the MJCF's: one factor on all sliding friction."""

    name = "ground_friction"
    sizes = (Parameter("share", "-", lambda s: 0.25, low=-3.6, high=12.0),)
    equation = "mu -> (1 + f) mu"
    source = "Coulomb's law"
    shown_by = "strokes that make the caps slide"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        model.geom_friction[:, 0] *= 1.0 + values["share"]
        model.pair_friction[:, :2] *= 1.0 + values["share"]


class RollingResistance(ModelEffect):
    """Ground that resists rolling: a moment in proportion to the normal force."""

    name = "rolling_resistance"
    sizes = (Parameter("length", "m", lambda s: 0.1 * s.cap),)
    equation = "M = rho N"
    source = "MuJoCo's rolling friction"
    shown_by = "rolling over, and drops that roll out"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        model.geom_friction[:, ROLLING] += values["length"]
        model.geom_condim[model.geom_condim > 1] = FULL
        model.pair_friction[:, PAIRED] += values["length"]
        model.pair_dim[model.pair_dim > 1] = FULL


class Slope(ModelEffect):
    """Sloped ground: it is tilted about the x- and y-axis, and gravity is expressed relative to it."""

    name = "slope"
    sizes = (
        Parameter("about_x", "rad", lambda s: 0.03, low=-15.0, high=15.0),
        Parameter("about_y", "rad", lambda s: 0.03, low=-15.0, high=15.0),
    )
    equation = "g (sin ay, -sin ax, -sqrt(1 - sin^2 ax - sin^2 ay))"
    source = "geometry"
    shown_by = "rolling in two directions; lying still where friction is known"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        x, y = np.sin(values["about_y"]), -np.sin(values["about_x"])
        model.opt.gravity[:] = np.linalg.norm(model.opt.gravity) * np.array(
            [x, y, -np.sqrt(max(0.0, 1.0 - x**2 - y**2))]
        )


class ContactSoftness(ModelEffect):
    """Ground softer, or harder, than the MJCF's.

    The stiffness of all contacts is divided by one factor; the damping ratio stays.
    """

    name = "contact_softness"
    sizes = (Parameter("share", "-", lambda s: 1.0, low=-0.5, high=20.0),)
    equation = "k -> k / (1 + s)"
    source = "MuJoCo's soft contacts (solref)"
    shown_by = "drops and sudden strokes"

    def edit(self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Numbers) -> None:
        factor = 1.0 / (1.0 + values["share"])
        for solref in (model.geom_solref, model.pair_solref, model.pair_solreffriction):
            direct = solref[:, 0] < 0  # (-stiffness, -damping); else (time, damping ratio)
            solref[direct] *= (factor, factor**0.5)
            solref[~direct] *= (factor**-0.5, 1.0)
