#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" optimistix==0.1.0 equinox==0.13.8 jax==0.10.2 numpy==2.4.6
echo "guess:     LevenbergMarquardt with tolerances of 1e-8 finds a stiffness in N/m from stretches in m without noise, or fails"
echo "behaviour: its first damping is 1 in whatever unit: the first steps are tiny, which counts as converged, at the start; GaussNewton finds it, and so does it in kN/m or um"
python -W ignore - <<'PYTHON'
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import optimistix as optx

forces = jnp.linspace(10.0, 100.0, 20)
stretches = forces / 5000.0


def fitted(solver, metre=1.0, newton=1.0):
    """Stiffness [N/m] that a solver finds from 4000 N/m on, with stretches and stiffness in these units."""

    def residuals(stiffness, _):
        return (forces / (stiffness * newton) - stretches) * metre

    solution = optx.least_squares(residuals, solver(rtol=1e-8, atol=1e-8), jnp.array(4000.0 / newton), throw=True)
    assert solution.result == optx.RESULTS.successful
    return round(float(solution.value) * newton, 3), int(solution.stats["num_steps"])


damped, plain = fitted(optx.LevenbergMarquardt), fitted(optx.GaussNewton)
scaled = fitted(optx.LevenbergMarquardt, metre=1e6), fitted(optx.LevenbergMarquardt, newton=1e3)
print(f"seen:      N/m and steps from 4000, where 5000 is true: LevenbergMarquardt {damped}, GaussNewton {plain}; LevenbergMarquardt with um {scaled[0]}, with kN/m {scaled[1]}")
assert abs(damped[0] - 4000) < 1 and all(abs(found[0] - 5000) < 1 for found in (plain, *scaled)), "this has changed"
PYTHON
