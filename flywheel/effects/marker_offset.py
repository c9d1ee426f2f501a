"""A marker that does not sit where the MJCF says."""

from collections.abc import Mapping

import mujoco

from flywheel.effects.effect import ModelEffect, Parameter
from flywheel.robots import Robot, tracked_site


class MarkerOffset(ModelEffect):
    """The tracked point is seen at an offset that is fixed on its body."""

    name = "marker_offset"
    where = "point"
    sizes = (
        Parameter("x", "m", lambda s: 0.01 * s.length, low=-20.0),
        Parameter("y", "m", lambda s: 0.01 * s.length, low=-20.0),
        Parameter("z", "m", lambda s: 0.01 * s.length, low=-20.0),
    )
    equation = "y = p + R (x, y, z)"
    source = "rigid-body kinematics"
    shown_by = "turning the body about all its axes"

    def edit(
        self, model: mujoco.MjModel, robot: Robot, place: int | None, values: Mapping[str, float]
    ) -> None:
        assert place is not None
        site, turn = tracked_site(model, robot.points[place])
        model.site_pos[site] += turn.T @ [values["x"], values["y"], values["z"]]
