#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a rangefinder measures the distance to what the robot would touch; colours are for pictures"
echo "behaviour: it looks through a geom whose alpha is 0, or its material's, which the robot touches as before"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><option gravity="0 0 0"/><asset><material name="glass" rgba="1 1 1 0"/></asset><worldbody>
<geom name="wall" type="box" size=".1 1 1" pos="2 0 0" {0}/>
<body name="probe"><joint type="slide" axis="1 0 0"/><geom size=".1"/><site name="eye" pos=".1 0 0" zaxis="1 0 0"/></body>
</worldbody><sensor><rangefinder site="eye"/></sensor></mujoco>"""


def measured(colour):
    """The distance at the start, and how far the probe comes within 5 s of flying at the wall."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(colour))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    distance = round(float(data.sensordata[0]), 3)
    data.qvel[0], furthest = 1.0, 0.0
    while data.time < 5.0:
        mujoco.mj_step(model, data)
        furthest = max(furthest, float(data.qpos[0]))
    return distance, round(furthest, 1)


found = {each or "none": measured(each) for each in ("", 'rgba="1 0 0 .01"', 'rgba="1 0 0 0"', 'material="glass"')}
print(f"seen:      (distance, furthest place) in metres by the wall's colour: {found}")
assert list(found.values()) == [(1.8, 1.8), (1.8, 1.8), (-1, 1.8), (-1, 1.8)], "this has changed"
PYTHON
