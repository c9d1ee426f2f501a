#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" odrpack==0.7.0 numpy==2.4.6 scipy==1.17.1
echo "guess:     sd_beta holds the roots of the diagonal of cov_beta"
echo "behaviour: sd_beta is scaled by the residuals, cov_beta is not: without weights, in metres, they differ by a factor of 100, as in scipy.odr"
python - <<'PYTHON'
import numpy as np
from odrpack import odr_fit

rng = np.random.default_rng(0)
true = np.linspace(0, 1, 50)


def fitted(noise, **weights):
    """Deviations of slope and offset by sd_beta and by cov_beta, of a line through points [m] with this noise [m] in both coordinates."""
    x, y = true + rng.normal(0, noise, 50), 2 * true + 1 + rng.normal(0, noise, 50)
    fit = odr_fit(lambda places, beta: beta[0] * places + beta[1], x, y, np.array([1.0, 0.0]), **weights)
    return fit.beta, fit.sd_beta, np.sqrt(np.diag(fit.cov_beta))


repeated = np.std([fitted(0.01)[0] for _ in range(200)], axis=0)
_, stated, rooted = fitted(0.01)
_, weighted, rooted_weighted = fitted(0.01, weight_x=1e4, weight_y=1e4)
print(f"seen:      deviations of slope and offset in 200 repetitions {repeated.round(4)}; sd_beta {stated.round(4)}, by cov_beta {rooted.round(4)};")
print(f"           with weights of 1 / 0.01**2: sd_beta {weighted.round(4)}, by cov_beta {rooted_weighted.round(4)}")
assert np.all(np.abs(stated / repeated - 1) < 0.3) and np.all(rooted > 50 * stated), "this has changed"
assert np.all(np.abs(rooted_weighted / repeated - 1) < 0.3), "this has changed"
PYTHON
