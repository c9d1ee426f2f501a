#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyransac3d==0.7.0 numpy==2.4.6
echo "guess:     Cylinder.fit of exact points on a rod finds its axis and radius, to the threshold"
echo "behaviour: three points on the surface are taken for a circle across the axis: axis and radius are those of random triangles, as a result"
python - <<'PYTHON'
import random

import numpy as np
import pyransac3d

draws = np.random.default_rng(0)
angle, along = draws.uniform(0, 2 * np.pi, 2000), draws.uniform(-0.5, 0.5, 2000)
rod = np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), along], axis=1)  # m; the axis is z
found = []
for seed in range(8):
    random.seed(seed)
    np.random.seed(seed)
    _, axis, radius, inliers = pyransac3d.Cylinder().fit(rod, thresh=0.002, maxIteration=1000)
    tilt = np.degrees(np.arccos(min(1.0, abs(axis[2]) / np.linalg.norm(axis))))
    found.append((round(float(tilt), 1), round(float(radius), 3), len(inliers)))
print(f"seen:      tilt of the axis [degrees], radius of 0.05 m, and inliers of 2000 points, in eight fits: {found}")
assert sum(tilt > 5 or abs(radius - 0.05) > 0.005 for tilt, radius, _ in found) >= 4, "this has changed"
assert max(count for *_, count in found) < 1000, "this has changed"
PYTHON
