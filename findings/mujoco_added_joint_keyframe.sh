#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" mujoco==4.0.0 numpy==2.4.6
echo "guess:     a joint that is added to an MjSpec leaves the keyframe's values with their joints, as attaching or deleting one does"
echo "behaviour: the keyframe gets a 0 at its end, and every joint after the new one gets the value of another"
python - <<'PYTHON'
import mujoco

BODY = '<body name="b{0}" pos="{0} 0 0"><joint name="j{0}" type="slide"/><geom size=".1"/><site name="s{0}"/></body>'
MJCF = f"""<mujoco><worldbody>{"".join(BODY.format(i) for i in range(3))}</worldbody>
<keyframe><key name="home" qpos="1 2 3"/></keyframe></mujoco>"""
HAND = '<mujoco><worldbody><body name="hand"><joint name="new"/><geom size=".1"/></body></worldbody></mujoco>'


def home(spec):
    """The values of the keyframe by the names of their joints."""
    model = spec.compile()
    return {spec.joints[i].name: float(model.key_qpos[0, model.jnt_qposadr[i]]) for i in range(model.njnt)}


added = mujoco.MjSpec.from_string(MJCF)
added.body("b0").add_joint(name="new", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
added = home(added)
attached, hand = mujoco.MjSpec.from_string(MJCF), mujoco.MjSpec.from_string(HAND)
attached.attach(hand, site=attached.site("s0"))
attached = home(attached)
deleted = mujoco.MjSpec.from_string(MJCF)
deleted.compile()
deleted.delete(deleted.joint("j1"))
deleted = home(deleted)
print(f"seen:      added {added}, attached {attached}, deleted {deleted}")
assert added == {"j0": 1, "new": 2, "j1": 3, "j2": 0}, "this has changed"
assert attached == {"j0": 1, "/new": 0, "j1": 2, "j2": 3} and deleted == {"j0": 1, "j2": 3}, "this has changed"
PYTHON
