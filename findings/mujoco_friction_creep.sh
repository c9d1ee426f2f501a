#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     a joint or tendon whose frictionloss is twice the load holds it, as a brake does"
echo "behaviour: the load sinks by 10.4 mm/s, whatever its mass, the frictionloss and the time step; solimpfriction decides"
python - <<'PYTHON'
import mujoco

OPTION = '<mujoco><option timestep="{step}"/>'
JOINT = """<worldbody><body><joint type="slide" axis="0 0 1" frictionloss="{loss}" {more}/><geom size=".1" mass="{mass}"/></body></worldbody></mujoco>"""
TENDON = """<worldbody><site name="top" pos="0 0 2"/><body><freejoint/><geom size=".1" mass="{mass}"/><site name="load"/></body></worldbody>
<tendon><spatial frictionloss="{loss}" {more}><site site="top"/><site site="load"/></spatial></tendon></mujoco>"""


def creep(rest, mass, loss, step=0.002, more=""):
    """Speed between 2 and 4 s [mm/s]."""
    model = mujoco.MjModel.from_xml_string(OPTION.format(step=step) + rest.format(mass=mass, loss=loss, more=more))
    data, height = mujoco.MjData(model), []
    for _ in range(2):
        mujoco.mj_step(model, data, round(2 / step))
        height.append(data.xpos[1, 2])
    return round(500 * float(height[0] - height[1]), 1)


found = {creep(rest, mass, loss, step) for rest in (JOINT, TENDON) for mass, loss in ((0.5, 20), (1, 20), (1, 1000), (10, 200)) for step in (0.002, 0.01)}
hard = creep(JOINT, 1, 20, more='solimpfriction=".9999 .9999 .001"')
print(f"seen:      mm/s of joints and tendons with .5 to 10 kg, 20 to 1000 N, 2 and 10 ms: {sorted(found)}; with solimpfriction .9999: {hard}")
assert found == {10.4} and 0 <= hard < 0.1, "this has changed"
PYTHON
