#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0
echo "guess:     a geom meets the ground alike, be it on a body or on a child without joints at the same place"
echo "behaviour: the contact's stiffness follows an inverse weight that the child has of its own, so the geom sinks in further"
python - <<'PYTHON'
import mujoco

GEOM = '<geom size=".05" pos="{} 0" mass="2"/>'


def depth(third):
    """How far the third of three balls of a rigid body sinks into the ground, at rest [mm]."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep=".001"/><worldbody><geom type="plane" size="5 5 1"/>
        <body pos="0 0 .05"><freejoint/>{GEOM.format("-.2 0")}{GEOM.format(".2 .2")}{third}</body></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    for _ in range(3000):
        mujoco.mj_step(model, data)
    return -1000 * data.contact[2].dist


own, child = depth(GEOM.format(".2 -.2")), depth(f'<body pos=".2 -.2 0">{GEOM.format("0 0")}</body>')
print(f"seen:      {own:.4f} mm on the body, {child:.4f} mm on its child")
assert child > 1.5 * own > 0, "this has changed"
PYTHON
