#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" simdkalman==1.0.4 numpy==2.4.6
echo "guess:     where one of two sensors is NaN the other one counts: a camera at each tenth step beside an encoder only helps"
echo "behaviour: a row with one NaN is dropped as a whole: with the camera the velocity is further off than without"
python - <<'PYTHON'
import numpy as np
import simdkalman

steps = np.arange(200)
position, velocity = 1 - np.cos(0.1 * steps), np.sin(0.1 * steps)
random = np.random.default_rng(0)
encoder = velocity + 0.01 * random.normal(size=200)
camera = np.where(steps % 10 == 0, position + 0.01 * random.normal(size=200), np.nan)


def off(rows, seen):
    """Root mean square error of the smoothed velocity in m/s, for steps of .1 s."""
    filtered = simdkalman.KalmanFilter(
        state_transition=np.array([[1, 0.1], [0, 1]]),
        process_noise=np.diag([1e-8, 0.01]),
        observation_model=seen,
        observation_noise=1e-4 * np.eye(len(seen)),
    )
    states = filtered.smooth(rows[None], initial_value=np.zeros(2), initial_covariance=np.eye(2)).states.mean[0]
    return float(np.sqrt(np.mean((states[:, 1] - velocity) ** 2)))


alone, both = off(encoder[:, None], np.array([[0.0, 1.0]])), off(np.stack([camera, encoder], axis=1), np.eye(2))
print(f"seen:      velocity off by {alone:.4f} m/s with the encoder, by {both:.4f} m/s with the encoder and the camera")
assert alone < 0.02 and both > 3 * alone, "this has changed"
PYTHON
