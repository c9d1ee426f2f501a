#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     seeds of 64 bits, as torch.manual_seed takes, give different random numbers"
echo "behaviour: only their last 32 bits count: (job << 32) + 7 is the seed 7 for each job"
python - <<'PYTHON'
import numpy as np
import torch


def drawn(seed):
    return torch.rand(3, generator=torch.Generator().manual_seed(seed))


jobs = [(job << 32) + 7 for job in (0, 1, 2, 2**20)]
torch.manual_seed(7)
module = torch.nn.Linear(2, 2).weight
torch.manual_seed(jobs[1])
same = bool((module == torch.nn.Linear(2, 2).weight).all())
numpy = [np.random.default_rng(job).random(2).round(3).tolist() for job in jobs[:2]]
print(f"seen:      of the seeds {jobs}: {[drawn(job).numpy().round(3).tolist() for job in jobs]};")
print(f"           the first two make the same layer: {same}; numpy draws {numpy} by them")
assert same and all((drawn(job) == drawn(7)).all() for job in jobs) and numpy[0] != numpy[1], "this has changed"
assert (drawn(8) != drawn(7)).all(), "this has changed"
PYTHON
