#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" drake==1.51.1 numpy==2.4.6
echo "guess:     a discrete MultibodyPlant treats a LinearSpringDamper implicitly, as the damping of a joint: stiff ones stay bounded"
echo "behaviour: it is explicit: with steps of 10 ms the same damper that a joint has makes 1 kg fly away, without an error"
python - <<'PYTHON'
import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import LinearSpringDamper, PrismaticJoint, SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator


def speeds(joint_damping, stiffness, damping):
    """Of 1 kg on a slide, started with .1 m/s, after 0 to 4 steps [m/s]."""
    plant = MultibodyPlant(time_step=0.01)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    body = plant.AddRigidBody("load", SpatialInertia(1.0, np.zeros(3), UnitInertia(0.01, 0.01, 0.01)))
    joint = plant.AddJoint(PrismaticJoint("slide", plant.world_frame(), body.body_frame(), [1, 0, 0], damping=joint_damping))
    if stiffness or damping:
        plant.AddForceElement(LinearSpringDamper(plant.world_body(), np.array([-1.0, 0, 0]), body, np.zeros(3), 1.0, stiffness, damping))
    plant.Finalize()
    simulator = Simulator(plant)
    joint.set_translation_rate(simulator.get_mutable_context(), 0.1)
    found = []
    for step in range(5):
        simulator.AdvanceTo(0.01 * step)
        found.append(float(f"{joint.get_translation_rate(simulator.get_context()):.3g}"))
    return found


joint, damper, spring = speeds(1000.0, 0.0, 0.0), speeds(0.0, 0.0, 1000.0), speeds(0.0, 1e5, 0.0)
print(f"seen:      damping of the joint 1000 N s/m: {joint}; of a LinearSpringDamper: {damper}; its stiffness 1e5 N/m: {spring}")
assert abs(joint[-1]) < 1e-4 and abs(damper[-1]) > 100 and abs(spring[-1]) > 10, "this has changed"
PYTHON
