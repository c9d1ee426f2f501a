#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" opensim==4.6 numpy==2.4.6
echo "guess:     the tension of OpenSim's PathSpring, a spring along a cable, is never negative"
echo "behaviour: stretched by 1 m it pushes its ends apart where it shortens faster than 1 / dissipation"
python - <<'PYTHON'
import opensim

model = opensim.Model()
body = opensim.Body("load", 1.0, opensim.Vec3(0), opensim.Inertia(0.1))
model.addBody(body)
joint = opensim.SliderJoint("slide", model.getGround(), body)
model.addJoint(joint)
spring = opensim.PathSpring("cable", 1.0, 100.0, 0.5)  # 1 m, 100 N/m, .5 s/m
path = spring.updGeometryPath()
path.appendNewPathPoint("anchor", model.getGround(), opensim.Vec3(2, 0, 0))
path.appendNewPathPoint("end", body, opensim.Vec3(0))
model.addForce(spring)
state = model.initSystem()
coordinate, tensions = joint.updCoordinate(), {}
for speed in (-1.0, 0.0, 1.0, 3.0):
    coordinate.setSpeedValue(state, speed)
    model.realizeDynamics(state)
    tensions[speed] = round(spring.getTension(state), 6)
print(f"seen:      tension [N] by the speed of shortening [m/s]: {tensions}")
assert tensions == {-1.0: 150, 0.0: 100, 1.0: 50, 3.0: -50}, "this has changed"
PYTHON
