"""Tensions of the robot's cables: springs and dampers of the MJCF."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from flywheel.errors import ModelError
from flywheel.records import Floats
from flywheel.robots import Robot
from flywheel.truth_simulator.cable_motion import CableMotion


@dataclass(frozen=True)
class CableLaw:
    """Numbers of C cables.

    A cable with an actuator (winched, or passive and clamped) has the tension k (L - l0) + c V plus
    that of effects, cut off at zero and at the actuator's strongest pull. A tendon's own spring
    pulls when stretched; a tendon's own damper always acts, and so can push.

    Attributes:
      stiffness: (C,) [N/m].
      damping: (C,) cut off together with the spring [N s/m].
      free_damping: (C,) of the tendon itself, never cut off [N s/m].
      clamped: (C,) bool, an actuator pulls.
      strongest: (C,) [N].
      rest: (C,) rest length at the keyframe [m].
    """

    stiffness: Floats
    damping: Floats
    free_damping: Floats
    clamped: np.ndarray
    strongest: Floats
    rest: Floats

    @classmethod
    def of(cls, robot: Robot) -> CableLaw:
        """Read the numbers from the MJCF.

        Raises:
          ModelError: springs or dampers are not linear.
        """
        model = mujoco.MjSpec.from_string(robot.xml).compile()
        if model.tendon_stiffnesspoly.any() or model.tendon_dampingpoly.any():
            raise ModelError(f"A tendon of {robot.name} has a spring or damper that is not linear.")
        count = len(robot.cables)
        damping, strongest = np.zeros(count), np.full(count, np.inf)
        clamped = np.zeros(count, bool)
        for actuator in range(model.nu):
            if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_TENDON:
                continue
            cable = model.actuator_trnid[actuator, 0]
            clamped[cable] = True
            damping[cable] = -model.actuator_biasprm[actuator, 2]
            strongest[cable] = -model.actuator_forcerange[actuator, 0]
        return cls(
            stiffness=np.array([cable.stiffness for cable in robot.cables]),
            damping=damping,
            free_damping=model.tendon_damping.copy(),
            clamped=clamped,
            strongest=strongest,
            rest=np.array([cable.rest_length for cable in robot.cables]),
        )

    def tension(self, cables: CableMotion, extra: Floats | float = 0.0) -> Floats:
        """Tensions (C,) [N] including effects: zero when slack, and effects never push.

        No winch exceeds its strongest pull, whatever is added.
        """
        extension, rate = cables.length - cables.rest, cables.rate
        pulled = np.maximum(self.stiffness * extension + self.damping * rate, 0.0)
        sprung = self.stiffness * np.maximum(extension, 0.0)
        free = self.free_damping * rate
        alone = np.where(self.clamped, pulled, sprung) + free
        added = alone + np.where(cables.taut, extra, 0.0)
        most = np.where(self.clamped, self.strongest + free, np.inf)
        return np.minimum(np.maximum(added, np.minimum(alone, 0.0)), most)
