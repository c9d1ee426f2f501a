#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a <pid> with slewmax whose joint is at 1 m, as commanded, holds it there from the start"
echo "behaviour: its set point begins at 0, and slews to the command from there: the joint is thrown to the origin; a keyframe with act does not"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><option timestep=".002" gravity="0 0 0"/><worldbody><body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><pid joint="lift" kp="100" kv="20" {slew}/></actuator><keyframe><key qpos="1" ctrl="1" {act}/></keyframe></mujoco>"""


def lowest(slew, act):
    """Lowest place [m] in 4 s after the keyframe, and the force [N] of the first step."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(slew=slew, act=act))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    force, least = float(data.actuator_force[0]), 1.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
        least = min(least, float(data.qpos[0]))
    return round(least, 3), round(force, 3)


bare, slewed, kept = lowest("", ""), lowest('slewmax=".5"', ""), lowest('slewmax=".5"', 'act="1"')
print(f"seen:      lowest place [m] and first force [N] of a joint commanded to stay at 1 m: without slewmax {bare}, with 0.5 m/s {slewed}, with act=1 in the keyframe {kept}")
assert bare == kept == (1, 0) and slewed[0] < 0.3 and slewed[1] < -99, "this has changed"
PYTHON
