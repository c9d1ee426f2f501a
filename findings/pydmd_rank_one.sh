#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" pydmd==2025.8.1 numpy==2.4.6 scipy==1.17.1
echo "guess:     DMD() with its own choice of the rank finds the two modes of a swing without noise, and DMDc() a system's two states"
echo "behaviour: the threshold is a multiple of the median of two singular values: it keeps one, with a warning of noise, and the swing has no frequency"
python -W ignore - <<'PYTHON'
import numpy as np
from pydmd import DMD, DMDc

times = np.arange(0, 5, 0.1)
swing = np.exp(-0.1 * times) * np.array([np.cos(2 * times), np.sin(2 * times)])


def modes(rank):
    """Rates [1/s] of the modes, and the largest error of the reconstruction; the swing's amplitude is 1."""
    fitted = DMD(svd_rank=rank).fit(swing)
    return np.round(np.log(fitted.eigs.astype(complex)) / 0.1, 2).tolist(), round(float(abs(fitted.reconstructed_data - swing).max()), 3)


generator = np.random.default_rng(0)
system, gain, inputs = np.array([[0.9, 0.1], [-0.1, 0.95]]), np.array([[0.0], [0.1]]), generator.normal(size=(1, 99))
states = np.ones((2, 100))
for step in range(99):
    states[:, step + 1] = system @ states[:, step] + gain @ inputs[:, step]
driven = {rank: np.round(DMDc(svd_rank=rank).fit(states, inputs).eigs, 3).tolist() for rank in (0, -1)}

own, all_modes = modes(0), modes(-1)
print(f"seen:      of a swing with -0.1 +- 2i: DMD() {own}, svd_rank=-1 {all_modes}; DMDc by svd_rank {driven}, system {np.linalg.eigvals(system).round(3).tolist()}")
assert len(own[0]) == 1 and own[1] > 0.5 and sorted(all_modes[0], key=np.imag) == [-0.1 - 2j, -0.1 + 2j], "this has changed"
assert len(driven[0]) == 1 and len(driven[-1]) == 2, "this has changed"
PYTHON
