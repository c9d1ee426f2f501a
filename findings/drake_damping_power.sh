#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" drake==1.51.1 numpy==2.4.6
echo "guess:     the nonconservative power of a MultibodyPlant is the rate at which its energy changes, damping of joints included"
echo "behaviour: damping of joints is left out: a joint that loses its energy has a power of 0; that of a LinearSpringDamper counts"
python - <<'PYTHON'
import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import LinearSpringDamper, PrismaticJoint, SpatialInertia


def powers(damped_by):
    """The power of `CalcNonConservativePower` [W], and the rate of the energy, by F v and by differences, of 1 kg at 0.7 m/s."""
    plant = MultibodyPlant(0.0)
    body = plant.AddRigidBody("load", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    joint_damping = 3.0 if damped_by == "joint" else 0.0
    plant.AddJoint(PrismaticJoint("slide", plant.world_frame(), body.body_frame(), [1, 0, 0], damping=joint_damping))
    if damped_by == "spring":
        plant.AddForceElement(LinearSpringDamper(plant.world_body(), [0, 0, 0], body, [0, 0, 0], 0.5, 100.0, 3.0))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [0.5])
    plant.SetVelocities(context, [0.7])
    power = plant.CalcNonConservativePower(context)

    def energy():
        return plant.CalcPotentialEnergy(context) + plant.CalcKineticEnergy(context)

    before, state = energy(), np.array([0.5, 0.7])
    rates = plant.EvalTimeDerivatives(context).CopyToVector()
    plant.SetPositionsAndVelocities(context, state + 1e-7 * rates)
    return [round(float(each), 3) for each in (power, -3 * 0.7**2, (energy() - before) / 1e-7)]


found = {damped_by: powers(damped_by) for damped_by in ("joint", "spring")}
print(f"seen:      CalcNonConservativePower, minus damping times speed squared, and the rate of the energy [W], by what damps: {found}")
assert found["joint"][0] == 0 and abs(found["joint"][2] - found["joint"][1]) < 0.01, "this has changed"
assert abs(found["spring"][0] - found["spring"][1]) < 0.01 and abs(found["spring"][2] - found["spring"][1]) < 0.01, "this has changed"
PYTHON
