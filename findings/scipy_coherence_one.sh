#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" scipy==1.17.1 numpy==2.4.6
echo "guess:     coherence of two signals that have nothing to do with each other is small"
echo "behaviour: up to 383 samples it averages over one piece only, and is exactly 1 at each frequency, without a warning"
python -W error - <<'PYTHON'
import numpy as np
from scipy.signal import coherence

random = np.random.default_rng(0)
for count in (256, 383, 384, 4000):
    _, shared = coherence(random.normal(size=count), random.normal(size=count), fs=100)
    print(f"seen:      {count} samples: mean {shared.mean():.3f}, least {shared.min():.3f}")
    assert np.allclose(shared, 1) == (count < 384), "this has changed"
PYTHON
