#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     solref=\"-10000 -200\" is a stiffness: a heavier ball sinks further, and 1000 N press each one as deep into the floor"
echo "behaviour: it is one per kilogram: each ball sinks as far by its own weight, and the lighter, the deeper it is pressed in"
python - <<'PYTHON'
import mujoco

MJCF = """<mujoco><worldbody><geom type="plane" size="5 5 1" solref="-10000 -200"/>
  <body pos="0 0 .1"><freejoint/><geom size=".1" mass="{}" solref="-10000 -200"/></body></worldbody></mujoco>"""


def depths(mass):
    """Millimetres in the floor by its own weight, and with 1000 N more."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(mass))
    data, found = mujoco.MjData(model), []
    for force in (0, 1000):
        data.xfrc_applied[1, 2] = -force
        for _ in range(4000):
            mujoco.mj_step(model, data)
        found.append(round(1000 * (0.1 - float(data.qpos[2])), 2))
    return found


seen = {mass: depths(mass) for mass in (1, 10, 100)}
print(f"seen:      kg: millimetres by its weight, with 1000 N: {seen}")
assert {own for own, _ in seen.values()} == {0.11} and seen[1][1] > 7 * seen[10][1] > 7 * seen[100][1], "this has changed"
PYTHON
