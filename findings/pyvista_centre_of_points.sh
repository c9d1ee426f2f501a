#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pyvista==0.49.1 vtk==9.7.2 numpy==2.4.6
echo "guess:     center_of_mass() of a closed mesh is that of the body, as its volume is the body's"
echo "behaviour: it is the mean of the vertices: of a cone 1 m high with 600 sides 2 mm above its base, instead of 25 cm"
python - <<'PYTHON'
import numpy as np
import pyvista


def solid_centre(mesh):
    """Centre of mass [m] of the body inside a closed mesh, by tetrahedra from the origin to its triangles."""
    corners = mesh.points[mesh.regular_faces].astype(float)
    volumes = np.linalg.det(corners) / 6
    return (volumes[:, None] * corners.sum(axis=1) / 4).sum(axis=0) / volumes.sum()


seen = {}
for sides in (6, 60, 600):
    cone = pyvista.Cone(center=(0, 0, 0.5), direction=(0, 0, 1), height=1.0, radius=0.3, resolution=sides).triangulate()
    seen[sides] = [round(float(value), 3) for value in (cone.center_of_mass()[2], solid_centre(cone)[2], cone.volume)]
print(f"seen:      height of center_of_mass() [m], the body's own, and volume [m3] of a cone from 0 to 1 m, by its number of sides: {seen}")
for sides, (points, body, _) in seen.items():
    assert abs(body - 0.25) < 2e-3 and abs(points - 1 / (sides + 1)) < 2e-3, "this has changed"
PYTHON
