"""MuJoCo's integrators, by their names in an MJCF."""

import mujoco

INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
}
IMPLICIT = ("implicit", "implicitfast")  # their damping lasts to the step's end


def integrator_of(model: mujoco.MjModel) -> str:
    """The name of a model's integrator."""
    return next(word for word, number in INTEGRATORS.items() if number == model.opt.integrator)
