#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" manifold3d==3.5.4 numpy==2.4.6
echo "guess:     a cylinder and a sphere are as round in metres as in millimetres"
echo "behaviour: edges are 1 long or more: a rod of 2 cm, in metres, has four sides and 64 % of its volume, a ball is an octahedron with 32 %"
python - <<'PYTHON'
import math

from manifold3d import Manifold

found = {}
for unit, scale in (("mm", 1000.0), ("m", 1.0)):
    rod, ball = Manifold.cylinder(1 * scale, 0.02 * scale), Manifold.sphere(0.02 * scale)
    volumes = rod.volume() / (math.pi * 0.02**2 * scale**3), ball.volume() / (4 / 3 * math.pi * (0.02 * scale) ** 3)
    found[unit] = {"sides of a rod": rod.num_vert() // 2, "volumes, as shares": [round(each, 3) for each in volumes]}
print(f"seen:      a rod of 1 m and a ball, both with a radius of 2 cm, by unit: {found}")
assert found["m"] == {"sides of a rod": 4, "volumes, as shares": [0.637, 0.318]}, "this has changed"
assert found["mm"]["sides of a rod"] >= 32 and min(found["mm"]["volumes, as shares"]) > 0.95, "this has changed"
PYTHON
