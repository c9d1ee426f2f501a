#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     with an implicit integrator a stiffer damper brings two bodies to rest sooner"
echo "behaviour: between two free bodies part of it is explicit: their relative velocity changes its sign at each step and"
echo "           hardly falls; between one body and the world it falls at once; 'discrete' has both right"
python - <<'PYTHON'
import mujoco

BODY = '<body pos="{x} 0 0">{joint}<geom size=".1" mass="1" contype="0" conaffinity="0"/><site name="{name}"/></body>'
FREE = "<freejoint/>"


def ratio(integrator, joint, damping=1e5):
    """Relative velocity after a step beside the one before it."""
    bodies = BODY.format(x=0, joint=joint, name="a") + BODY.format(x=1, joint=FREE, name="b")
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".005" gravity="0 0 0" integrator="{integrator}"/>
        <worldbody>{bodies}</worldbody>
        <tendon><spatial damping="{damping}"><site site="a"/><site site="b"/></spatial></tendon></mujoco>"""
    )
    data, apart = mujoco.MjData(model), []
    data.qvel[-6] = 0.1
    for _ in range(2):
        mujoco.mj_step(model, data)
        apart.append(data.qvel[-6] - (data.qvel[0] if joint else 0.0))
    return apart[1] / apart[0]


two, one, discrete = ratio("implicitfast", FREE), ratio("implicitfast", ""), ratio("discrete", FREE)
print(f"seen:      factor a step: two bodies {two:.3f}, one and the world {one:.4f}, discrete {discrete:.4f}")
assert -1 < two < -0.99 and 0 <= one < 0.01 and 0 <= discrete < 0.01, "this has changed"
PYTHON
