#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" "mujoco[sysid]==4.0.0" numpy==2.4.6
echo "guess:     a body's own inertia, applied to it again as InertiaType.Pseudo, compiles"
echo "behaviour: its quaternion becomes NaN, and the compiler complains of mass and inertia; with a quaternion it compiles"
python - <<'PYTHON'
import mujoco
import numpy as np
from mujoco import sysid

spec = mujoco.MjSpec.from_string(
    """<mujoco><worldbody><body name="b"><freejoint/><geom type="box" size=".1 .2 .3" mass="2"/></body></worldbody></mujoco>"""
)
parameter = sysid.body_inertia_param(spec, spec.compile(), "b", sysid.InertiaType.Pseudo)
sysid.apply_body_inertia(spec, "b", parameter)
turned = spec.body("b").iquat.copy()
try:
    spec.compile()
    said = ""
except ValueError as error:
    said = str(error).splitlines()[0]
spec.body("b").iquat[:] = 1, 0, 0, 0
model = spec.compile()
print(f"seen:      quaternion {turned}: {said!r}; with 1, 0, 0, 0 the inertia is {model.body_inertia[1].round(4)}")
assert np.isnan(turned).all() and said, "this has changed"
PYTHON
