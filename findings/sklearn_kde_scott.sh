#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scikit-learn==1.9.1 scipy==1.17.1 numpy==2.4.6
echo "guess:     KernelDensity(bandwidth=\"scott\") is Scott's rule, as in gaussian_kde: in proportion to the data's spread"
echo "behaviour: the spread is left out: 1000 errors of 1 cm, in metres, get a bandwidth of 25 cm, and a peak 25 times too low"
python - <<'PYTHON'
import numpy as np
from scipy.stats import gaussian_kde
from sklearn.neighbors import KernelDensity

errors = np.random.default_rng(0).normal(0.0, 0.01, 1000)


def peaks(unit):
    """Bandwidth, and density at 0 by both libraries, of the errors in this unit [m], back in metres."""
    density = KernelDensity(bandwidth="scott").fit(errors[:, None] / unit)
    ours = np.exp(density.score_samples([[0.0]]))[0] / unit
    return [float(f"{number:.3g}") for number in (density.bandwidth_ * unit, ours, gaussian_kde(errors / unit, "scott")(0.0)[0] / unit)]


exact = 1 / (0.01 * np.sqrt(2 * np.pi))
units = {unit: peaks(unit) for unit in (1.0, 0.01, 0.001)}
print(f"seen:      bandwidth [m], peak [1/m] of scikit-learn, and of scipy, by unit [m]: {units}; exact peak {exact:.3g}")
assert units[1.0][0] > 0.2 and units[1.0][1] < exact / 20 and abs(units[0.01][1] / exact - 1) < 0.1, "this has changed"
assert all(abs(of[2] / exact - 1) < 0.1 for of in units.values()), "this has changed"
PYTHON
