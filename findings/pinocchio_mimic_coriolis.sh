#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pin==4.1.0 numpy==2.4.6
echo "guess:     of a model with mimic joints, computeCoriolisMatrix and getFrameJacobianTimeVariation are right, or refuse it, as aba does"
echo "behaviour: they are wrong, without a word: C v is not the nonlinear effects less gravity, and the rate of the Jacobian not its derivative"
python - <<'PYTHON'
import numpy as np
import pinocchio as pin

BODY = '<inertial><origin xyz=".2 {y} 0"/><mass value="{mass}"/><inertia ixx=".01" iyy=".02" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="{axis}"/><limit effort="9" velocity="9" lower="-3" upper="3"/>{mimic}</joint>'
URDF = (
    '<robot name="arm"><link name="base"/>'
    + f'<link name="a">{BODY.format(y=0, mass=1)}</link><link name="b">{BODY.format(y=0.1, mass=2)}</link><link name="c">{BODY.format(y=0, mass=0.5)}</link>'
    + JOINT.format(name="j1", parent="base", child="a", x=0, axis="0 1 0", mimic="")
    + JOINT.format(name="j2", parent="a", child="b", x=0.4, axis="0 0 1", mimic="{}")
    + JOINT.format(name="j3", parent="b", child="c", x=0.4, axis="0 1 0", mimic="")
    + "</robot>"
)
MIMIC = '<mimic joint="j1" multiplier="2" offset="0.3"/>'


def seen(model, place, velocity, from_free):
    """C v, nonlinear effects less gravity, and J' v of the tip by getFrameJacobianTimeVariation and by differences."""
    data, tip, world = model.createData(), model.getFrameId("c"), pin.LOCAL_WORLD_ALIGNED
    coriolis = pin.computeCoriolisMatrix(model, data, place, velocity) @ velocity
    rest = pin.nonLinearEffects(model, data, place, velocity) - pin.computeGeneralizedGravity(model, data, place)
    pin.computeJointJacobiansTimeVariation(model, data, place, velocity)
    pin.updateFramePlacements(model, data)
    rate = pin.getFrameJacobianTimeVariation(model, data, tip, world) @ velocity
    after, before = (pin.computeFrameJacobian(model, data, place + way * velocity, tip, world) for way in (1e-6, -1e-6))
    return [(from_free @ each if len(each) < 6 else each).round(3).tolist() for each in (coriolis, rest, rate, (after - before) / 2e-6 @ velocity)]


mimic = pin.buildModelFromXML(URDF.format(MIMIC), mimic=True)
free = pin.buildModelFromXML(URDF.format(""))
place, velocity = np.array([0.4, -0.7]), np.array([0.5, 0.8])
coupled = np.array([[1, 0], [2, 0], [0, 1.0]])  # the three joints' velocities from those of j1 and j3
names = "C v", "nle - g", "J' v", "J' v by differences"
with_mimic = dict(zip(names, seen(mimic, place, velocity, np.eye(2)), strict=True))
without = dict(zip(names, seen(free, coupled @ place + [0, 0.3, 0], coupled @ velocity, coupled.T), strict=True))
print(f"seen:      with a mimic joint {with_mimic}")
print(f"           as three joints, projected {without}")
assert np.allclose(without["C v"], without["nle - g"], atol=0.002) and np.allclose(without["J' v"], without["J' v by differences"], atol=0.002)
assert np.allclose(with_mimic["nle - g"], without["nle - g"], atol=0.002), "this has changed"
assert np.allclose(with_mimic["J' v by differences"], without["J' v by differences"], atol=0.002), "this has changed"
assert not np.allclose(with_mimic["C v"], with_mimic["nle - g"], atol=0.01), "this has changed"
assert not np.allclose(with_mimic["J' v"], with_mimic["J' v by differences"], atol=0.002), "this has changed"
PYTHON
