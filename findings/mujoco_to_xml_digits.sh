#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     MjSpec.to_xml() writes a robot that moves as the one it was given"
echo "behaviour: numbers get six digits, and a rest length that was left out becomes a rounded number"
python - <<'PYTHON'
import mujoco
import numpy as np

MJCF = """<mujoco>
  <worldbody>
    <site name="a" pos="0.1234567 0 2"/>
    <body pos="0.3 0.1 1"><freejoint/><geom type="capsule" fromto="0 0 0 0.4321987 0 0" size=".03" mass="1.2345678"/>
      <site name="b" pos="0.4321987 0 0"/></body>
  </worldbody>
  <tendon><spatial name="c" stiffness="333.3333"><site site="a"/><site site="b"/></spatial></tendon>
</mujoco>"""


def end(model, seconds=2.0):
    data = mujoco.MjData(model)
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
    return data.qpos[:3].copy()


spec = mujoco.MjSpec.from_string(MJCF)
given = spec.compile()
text = spec.to_xml()
written = mujoco.MjModel.from_xml_string(text)
apart = np.linalg.norm(end(given) - end(written))
masses = given.body_mass[1], written.body_mass[1]
print(f"seen:      mass {masses[0]:.8g} kg became {masses[1]:.8g}; after 2 s the bodies are {apart:.1e} m apart;")
print(f"           springlength is {'' if 'springlength' in text else 'not '}in the text")
assert masses[1] == 1.23457 and apart > 1e-8 and "springlength" in text, "this has changed"
PYTHON
