"""Ground that gives way more, or less, than the MJCF's."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot


class ContactSoftness(ModelEffect):
    """Stiffness of all contacts divided by one factor; the damping ratio stays."""

    name = "contact_softness"
    sizes = (Parameter("share", "-", lambda s: 1.0, low=-0.5, high=20.0),)
    equation = "k -> k / (1 + s)"
    source = "MuJoCo's soft contacts (solref)"
    shown_by = "drops and sudden strokes"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        factor = 1.0 / (1.0 + values["share"])
        for solref in (model.geom_solref, model.pair_solref, model.pair_solreffriction):
            direct = solref[:, 0] < 0  # (-stiffness, -damping); else (time, damping ratio)
            solref[direct] *= (factor, factor**0.5)
            solref[~direct] *= (factor**-0.5, 1.0)
