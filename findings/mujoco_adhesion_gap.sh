#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a contact with adhesion=\"20\" holds a ball of 1 kg until 20 N more than its weight pull at it"
echo "behaviour: it lets go at the weight: where it pulls, the surfaces are apart, and without a gap that is no contact; with a gap of 1 mm it holds"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/><body pos="0 0 .0996"><freejoint/>
<geom size=".1" mass="1" adhesion="20" gap="{gap}"/></body></worldbody></mujoco>"""


def released(gap):
    """The pull [N], which grows by 5 N/s, at which the ball is 1 cm above the floor."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(gap=gap))
    data = mujoco.MjData(model)
    for _ in range(250):
        mujoco.mj_step(model, data)
    assert data.contact.adhesion[0] == 20
    while data.qpos[2] < 0.11:
        data.xfrc_applied[1, 2] += 0.01
        mujoco.mj_step(model, data)
    return round(float(data.xfrc_applied[1, 2]), 1)


found = {gap: released(gap) for gap in (0, 1e-4, 3e-4, 1e-3, 1e-2)}
print(f"seen:      pull [N] at which the ball, of 9.81 N, is off the floor, by gap [m]: {found}")
assert found[0] < 11.1 and found[3e-4] < 20 and found[1e-3] > 29.8, "this has changed"
PYTHON
