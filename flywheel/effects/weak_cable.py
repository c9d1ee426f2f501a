"""One cable that is softer than the others of its kind."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot


class WeakCable(ModelEffect):
    """A share of the stiffness of one cable is missing."""

    name = "weak_cable"
    where = "cable"
    sizes = (Parameter("share", "-", lambda s: 0.2, low=-5.0, high=4.5),)
    equation = "dT = -s T at one cable"
    source = "Hooke's law"
    shown_by = "strokes that load the cables one after the other"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        assert place is not None
        left = 1.0 - values["share"]
        model.tendon_stiffness[place] *= left
        model.tendon_stiffnesspoly[place] *= left
        pulls = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (
            model.actuator_trnid[:, 0] == place
        )
        model.actuator_gainprm[pulls, 0] *= left
        model.actuator_biasprm[pulls, :2] *= left
