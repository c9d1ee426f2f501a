#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     after an instability the states of mujoco.rollout are not finite, or it raises an error"
echo "behaviour: they are finite: each later row is the reset model after one step, and its time stands still"
python - 2> mujoco.log <<'PYTHON'
import mujoco
import numpy as np
from mujoco import rollout

BODY = '<body pos="{x} 0 0"><freejoint/><geom size=".1" mass="1" contype="0" conaffinity="0"/><site name="{name}"/></body>'
model = mujoco.MjModel.from_xml_string(
    f"""<mujoco><option timestep=".01" gravity="0 0 0"/>
    <worldbody>{BODY.format(x=0, name="a")}{BODY.format(x=1, name="b")}</worldbody>
    <tendon><spatial damping="400"><site site="a"/><site site="b"/></spatial></tendon></mujoco>"""
)
data, kind = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
data.qvel[6] = 0.1
start = np.zeros(mujoco.mj_stateSize(model, kind))
mujoco.mj_getState(model, data, start, kind)
(states,), _ = rollout.rollout(model, [data], start[None], nstep=40)

fastest = np.abs(states[:, 15:]).max(axis=1)
diverges = int(fastest.argmax())
print(f"seen:      {fastest[diverges]:.0e} m/s in row {diverges}, then {fastest[-1]:g}; all finite: {np.isfinite(states).all()};")
print(f"           time of the last row {states[-1, 0]:g} s of {40 * model.opt.timestep:g} s; counters of warnings tell it:")
print(f"           {[int(w.number) for w in data.warning]}")
assert np.isfinite(states).all() and states[-1, 0] == model.opt.timestep, "this has changed"
assert sum(w.number for w in data.warning) > 0, "this has changed"
PYTHON
