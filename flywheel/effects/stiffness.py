"""Change the stiffness of cables in MuJoCo's model, and of the winches that pull on them."""

import mujoco
import numpy as np


def scale_stiffness(model: mujoco.MjModel, cables: np.ndarray, factor: float) -> None:
    """Multiply the stiffness of some cables.

    Args:
      cables: their indices.
    """
    model.tendon_stiffness[cables] *= factor
    model.tendon_stiffnesspoly[cables] *= factor
    pulls = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & np.isin(
        model.actuator_trnid[:, 0], cables
    )
    model.actuator_gainprm[pulls, 0] *= factor
    model.actuator_biasprm[pulls, :2] *= factor
