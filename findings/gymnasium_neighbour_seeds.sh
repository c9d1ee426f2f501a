#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" gymnasium==1.4.0 numpy==2.4.6
echo "guess:     evaluations with the seeds 0, 1 and 2 are three samples: their episodes have nothing in common"
echo "behaviour: environment i gets the seed plus i: of eight episodes seven are those of the seed before, so three seeds are ten episodes"
python - <<'PYTHON'
import gymnasium
import numpy as np


def starts(seed, count=8):
    """The first observations of so many environments."""
    environments = gymnasium.make_vec("Pendulum-v1", num_envs=count)
    return environments.reset(seed=seed)[0]


seeds = [starts(seed) for seed in (0, 1, 2)]
shared = [int((one[1:] == other[:-1]).all(axis=1).sum()) for one, other in zip(seeds, seeds[1:])]
different = len(np.unique(np.concatenate(seeds), axis=0))
print(f"seen:      starts shared by the seeds 0 and 1, 1 and 2: {shared} of 8; different ones among 24: {different}; with seeds 0, 100, 200: "
      f"{len(np.unique(np.concatenate([starts(seed) for seed in (0, 100, 200)]), axis=0))}")
assert shared == [7, 7] and different == 10, "this has changed"
PYTHON
