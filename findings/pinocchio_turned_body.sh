#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pin==4.1.0 mujoco==4.0.0 numpy==2.4.6
echo "guess:     at the keyframe of an MJCF, Pinocchio's forward kinematics puts a free body where MuJoCo does"
echo "behaviour: not if the body has a position and a rotation in the MJCF: it is elsewhere, by the same vector at any q"
python - <<'PYTHON'
import mujoco
import numpy as np
import pinocchio

MJCF = """<mujoco><worldbody><body name="rod" pos="0 0 1" {0}><freejoint/><geom type="capsule" size=".03 .4"/></body>
</worldbody><keyframe><key name="home" qpos="1 2 3 0 1 0 0"/></keyframe></mujoco>"""


def places(rotation):
    text = MJCF.format(rotation)
    with open("rod.xml", "w") as file:
        file.write(text)
    read, model = pinocchio.buildModelFromMJCF("rod.xml"), mujoco.MjModel.from_xml_string(text)
    computed, data = read.createData(), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    pinocchio.framesForwardKinematics(read, computed, read.referenceConfigurations["home"])
    frame = computed.oMf[read.getFrameId("rod")]
    assert np.allclose(frame.rotation, data.xmat[1].reshape(3, 3)), "this has changed"
    return frame.translation.round(6).tolist(), data.xpos[1].tolist()


straight, turned = places(""), places('euler="90 0 0"')
print(f"seen:      (Pinocchio, MuJoCo) {straight}; with euler='90 0 0' {turned}; rotations agree")
assert straight == ([1, 2, 3], [1, 2, 3]) and turned == ([1, 3, 4], [1, 2, 3]), "this has changed"
PYTHON
