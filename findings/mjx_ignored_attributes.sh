#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco-mjx==3.17.0 mujoco==4.0.0 jax==0.10.2 numpy==2.4.6
echo "guess:     MJX, installed beside MuJoCo 4.0.0 by its own requirements, simulates a model alike or refuses it"
echo "behaviour: it ignores delays, damping of actuators, plastic springs and stiffness polynomials, without a word"
JAX_PLATFORMS=cpu python - <<'PYTHON'
import jax
import mujoco
from mujoco import mjx

jax.config.update("jax_enable_x64", True)
MJCF = """<mujoco><option timestep=".005" integrator="Euler"/>
  <worldbody><site name="a"/><body pos="0 0 -1"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="1"/><site name="b"/></body></worldbody>
  <tendon><spatial name="cable" {}><site site="a"/><site site="b"/></spatial></tendon>
  <actuator><motor tendon="cable" {}/></actuator></mujoco>"""
SPRING = 'springlength="0 1" damping="5" stiffness='
CASES = {
    "a spring": (SPRING + '"100"', ""),
    "with a polynomial": (SPRING + '"100 2000"', ""),
    "with springyield": (SPRING + '"100" springyield=".05"', ""),
    "a motor": ("", ""),
    "with delay": ("", 'delay=".0475" nsample="20"'),
    "with damping": ("", 'damping="20"'),
}


def heights(cable, motor):
    """Where the weight is [m] after .2 s of -20 N on a motor alone, in MuJoCo and in MJX."""
    model = mujoco.MjModel.from_xml_string(MJCF.format(cable, motor))
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.0 if cable else -20.0
    there, state, step = mjx.put_model(model), mjx.put_data(model, data), jax.jit(mjx.step)
    for _ in range(40):
        mujoco.mj_step(model, data)
        state = step(there, state)
    return round(float(data.qpos[0]), 4), round(float(state.qpos[0]), 4)


seen = {name: heights(*case) for name, case in CASES.items()}
print("seen:      [m] in MuJoCo and MJX: " + ", ".join(f"{name} {here} and {there}" for name, (here, there) in seen.items()))
for name, (here, there) in seen.items():
    plain = seen["a spring" if name in list(seen)[:3] else "a motor"]
    assert there == plain[1] and (here == there) == name.startswith("a "), "this has changed"
PYTHON
