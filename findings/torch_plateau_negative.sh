#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     ReduceLROnPlateau lowers the rate where a loss no longer falls, also a negative one such as a log-likelihood"
echo "behaviour: never below zero: a constant loss counts as better each time, and so does one that rises slowly"
python - <<'PYTHON'
import torch
from torch.optim.lr_scheduler import ReduceLROnPlateau


def after(losses):
    """The rate, which begins with 1, and the loss that counts as the best, after these losses."""
    schedule = ReduceLROnPlateau(torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=1.0), patience=5)
    for loss in losses:
        schedule.step(loss)
    return float(f"{schedule.get_last_lr()[0]:.1g}"), round(schedule.best, 3)


constant = {loss: after([loss] * 50) for loss in (5.0, -5.0)}
rising = {loss: after([loss + 4e-4 * step for step in range(50)]) for loss in (5.0, -5.0)}
print(f"seen:      rate and best after 50 constant losses {constant}; after 50 that rise by 4e-4 each {rising}")
assert constant[5.0] == (1e-8, 5.0) and constant[-5.0] == (1.0, -5.0), "this has changed"
assert rising[5.0][1] == 5.0 and rising[-5.0] == (1.0, -4.98), "this has changed"
PYTHON
