#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     angles given to an MjSpec in Python are radians, as in the MjModel that it compiles to"
echo "behaviour: ranges, springref and ref of hinges are degrees, as spec.compiler.degree is True: range=[-1, 1] allows 1/57 of it"
python - <<'PYTHON'
import mujoco
import numpy as np


def build(degree):
    spec = mujoco.MjSpec()
    if degree is not None:
        spec.compiler.degree = degree
    body = spec.worldbody.add_body()
    body.add_geom(size=[0.1, 0, 0])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, limited=True, range=[-1.0, 1.0], springref=0.5)
    model = spec.compile()
    return model.jnt_range[0].round(5).tolist(), round(float(model.qpos_spring[0]), 5)


plain, radians = build(None), build(False)
print(f"seen:      compiled range and springref of [-1, 1] and .5: {plain}; with spec.compiler.degree = False: {radians}")
assert radians == ([-1, 1], 0.5) and np.allclose(plain[0], [-0.01745, 0.01745]) and plain[1] == 0.00873, "this has changed"
PYTHON
