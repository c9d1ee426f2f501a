#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" trimesh==5.2.0 transforms3d==0.4.2 scipy==1.17.1 numpy==2.4.6
echo "guess:     axis times angle of a rotation by 10 microradians, as between frames of a log, is right to a per cent"
echo "behaviour: any of three axes is taken at 1e-4 rad and below (trimesh), or 1e-5 (transforms3d): a quarter is wrong, by up to 300 times the angle"
python - <<'PYTHON'
import numpy as np
import transforms3d
import trimesh
from scipy.spatial.transform import Rotation

rng = np.random.default_rng(0)
axes = rng.normal(size=(400, 3))
axes /= np.linalg.norm(axes, axis=1, keepdims=True)


def by_trimesh(matrix):
    whole = np.eye(4)
    whole[:3, :3] = matrix
    angle, axis, _ = trimesh.transformations.rotation_from_matrix(whole)
    return angle * axis


def by_transforms3d(matrix):
    axis, angle = transforms3d.axangles.mat2axangle(matrix)
    return angle * axis


def by_scipy(matrix):
    return Rotation.from_matrix(matrix).as_rotvec()


def wrong(read, angle):
    """Share of rotations off by more than 1 %, and the largest error over the angle."""
    vectors = angle * axes
    errors = np.array([np.linalg.norm(read(Rotation.from_rotvec(v).as_matrix()) - v) for v in vectors]) / angle
    return round(float((errors > 0.01).mean()), 2), round(float(errors.max()))


found = {read.__name__[3:]: {angle: wrong(read, angle) for angle in (1e-3, 1e-4, 1e-5)} for read in (by_trimesh, by_transforms3d, by_scipy)}
print(f"seen:      (share wrong, largest error over the angle) by angle: {found}")
assert all(shares[1e-3] == (0, 0) for shares in found.values()) and found["scipy"][1e-5] == (0, 0), "this has changed"
assert min(found["trimesh"][1e-4][0], found["trimesh"][1e-5][0], found["transforms3d"][1e-5][0]) > 0.1, "this has changed"
PYTHON
