#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a box whose friction is 0.1 slides on a floor whose friction is 1, pushed with half its weight"
echo "behaviour: of two geoms the larger friction counts: it stays; with priority=\"1\" its own counts, and it slides"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><worldbody><geom type="plane" size="9 9 1" friction="1"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1" friction=".1" {}/></body></worldbody></mujoco>"""


def moved(attribute):
    """Metres after 1 s of the push."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(attribute))
    data = mujoco.MjData(model)
    data.xfrc_applied[1, 0] = 0.5 * 9.81
    while data.time < 1:
        mujoco.mj_step(model, data)
    return float(data.qpos[0])


plain, first = moved(""), moved('priority="1"')
print(f"seen:      after 1 s it is at {plain:.3f} m, with priority=\"1\" at {first:.3f} m")
assert plain < 0.02 and first > 1.5, "this has changed"
PYTHON
