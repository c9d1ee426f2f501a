#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" trimesh==5.2.0 scipy==1.17.1 numpy==2.4.6
echo "guess:     icp and procrustes of two recordings of one rigid body give a rigid motion"
echo "behaviour: icp may shrink the body, to 0.6 of its size, and procrustes mirror markers in a plane, unless told scale=False, reflection=False"
python - <<'PYTHON'
import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

generator = np.random.default_rng(0)
body = generator.normal(size=(200, 3)) * [1, 0.5, 0.2]
turn = np.array([1, 2, 3]) / np.sqrt(14)


def scales(**options):
    """Factor on lengths of the motion that icp finds, for turns of 10 and 60 degrees."""
    found = []
    for degrees in (10, 60):
        moved = Rotation.from_rotvec(np.radians(degrees) * turn).apply(body)
        matrix, _, _ = trimesh.registration.icp(body, moved, **options)
        found.append(round(float(abs(np.linalg.det(matrix[:3, :3])) ** (1 / 3)), 2))
    return found


flat = np.c_[generator.normal(size=(6, 2)), np.zeros(6)]
turned = [Rotation.random(rng=np.random.default_rng(seed)).apply(flat) for seed in range(20)]
mirrored = sum(bool(np.linalg.det(trimesh.registration.procrustes(flat, to)[0][:3, :3]) < 0) for to in turned)
own, rigid = scales(), scales(scale=False, reflection=False)
print(f"seen:      factors on lengths {own}, with scale=False {rigid}; of 20 rotations of six markers in a plane {mirrored} are mirror images")
assert own[0] == 1 and own[1] < 0.7 and rigid == [1, 1] and 0 < mirrored < 20, "this has changed"
PYTHON
