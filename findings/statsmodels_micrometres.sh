#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" statsmodels==0.15.0 pandas==3.1.1 numpy==2.4.6 scipy==1.17.1
echo "guess:     UnobservedComponents finds the same noise and the same level in metres, in millimetres and in micrometres"
echo "behaviour: it begins at zero with the variance 1e6 in whatever unit: in micrometres the noise all but vanishes, and the level starts elsewhere"
python -W ignore - <<'PYTHON'
import numpy as np
import statsmodels.api as sm

rng = np.random.default_rng(0)
metres = 1.0 + np.cumsum(rng.normal(0, 1e-4, 300)) + rng.normal(0, 1e-3, 300)


def fitted(unit, **options):
    """Deviations of the noise and of the level's steps, and the first level, all in mm, from data in this unit [m]."""
    fit = sm.tsa.UnobservedComponents(metres / unit, "local level", **options).fit(disp=False)
    values = *np.sqrt(fit.params), fit.smoothed_state[0, 0]
    return *(round(float(value * unit * 1e3), 2) for value in values), fit.mle_retvals["converged"]


units = {"m": 1.0, "mm": 1e-3, "10 um": 1e-5, "um": 1e-6}
seen = {name: fitted(unit) for name, unit in units.items()}
exact = {name: fitted(unit, use_exact_diffuse=True) for name, unit in units.items()}
print(f"seen:      noise, steps of the level and first level [mm], and whether it converged, where 1, 0.1 and {1e3 * metres[0]:.1f} were to be found: {seen};")
print(f"           with use_exact_diffuse {exact}")
for name in units:
    assert abs(exact[name][0] - 1) < 0.05, "this has changed"
assert abs(seen["mm"][0] - 1) < 0.05 and seen["um"][0] < 0.2 and seen["um"][1] > 1, "this has changed"
PYTHON
