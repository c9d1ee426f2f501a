#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scikit-learn==1.9.1 scipy==1.17.1 numpy==2.4.6
echo "guess:     GaussianMixture finds the same two clusters in metres and in millimetres"
echo "behaviour: in metres 1 mm2 is added to each variance: clusters 2 mm apart, +- 0.3 mm, become one of +- 1.4 mm; converged"
python - <<'PYTHON'
import numpy as np
from sklearn.mixture import GaussianMixture

generator = np.random.default_rng(0)
points = np.r_[generator.normal(0, 0.3, 1000), generator.normal(2, 0.3, 1000)][:, None]  # [mm]


def found(unit):
    """Sorted means and deviations [mm] of the clusters, of points in this unit [mm]."""
    mixture = GaussianMixture(2, random_state=0).fit(points / unit)
    assert mixture.converged_
    means, deviations = mixture.means_.ravel() * unit, np.sqrt(mixture.covariances_.ravel()) * unit
    return [[round(float(number), 2) for number in numbers] for numbers in (np.sort(means), np.sort(deviations))]


metres, millimetres = found(1000.0), found(1.0)
print(f"seen:      means and deviations [mm]: of metres {metres}, of millimetres {millimetres}")
assert np.allclose(millimetres[0], [0, 2], atol=0.05) and np.allclose(millimetres[1], 0.3, atol=0.03), "this has changed"
assert metres[0][1] - metres[0][0] < 1 and min(metres[1]) > 1.3, "this has changed"
PYTHON
