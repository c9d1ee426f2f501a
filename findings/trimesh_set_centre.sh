#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" trimesh==5.2.0 numpy==2.4.6
echo "guess:     a mesh whose density, or measured centre of mass, is set keeps it, with moments of inertia of a body"
echo "behaviour: a centre of mass off the middle makes moments negative; joined or subdivided meshes weigh 1 kg/m3 again"
python - <<'PYTHON'
import numpy as np
import trimesh

box = trimesh.creation.box([1, 2, 3])
box.density = 500.0
other = box.copy()
other.apply_translation([5, 0, 0])
masses = {"copy": box.copy().mass, "+": (box + other).mass, "subdivide": box.subdivide().mass}
plain = np.diag(box.moment_inertia).round(6).tolist()
box.center_mass = [0.0, 0.0, 1.0]
moved = np.diag(box.moment_inertia).round(6).tolist()
print(f"seen:      masses of a box of 3000 kg {({key: float(mass.round(6)) for key, mass in masses.items()})};")
print(f"           its moments {plain}, with the centre of mass 1 m higher {moved}")
assert np.allclose(list(masses.values()), [3000, 12, 6]), "this has changed"
assert plain == [3250, 2500, 1250] and moved == [250, -500, 1250], "this has changed"
PYTHON
