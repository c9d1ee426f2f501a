#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     a training that goes on with CosineAnnealingLR(T_max=200) and the state of one with T_max=100 falls to zero at step 200"
echo "behaviour: the state brings its T_max along: from step 100 on the rate climbs, to its largest at step 200"
python - <<'PYTHON'
import torch
from torch.optim.lr_scheduler import CosineAnnealingLR


def made(length):
    optimizer = torch.optim.SGD([torch.nn.Parameter(torch.zeros(1))], lr=1.0)
    return optimizer, CosineAnnealingLR(optimizer, T_max=length)


def stepped(optimizer, schedule, count):
    rates = []
    for _ in range(count):
        optimizer.step()
        schedule.step()
        rates.append(schedule.get_last_lr()[0])
    return rates


first, schedule = made(100)
stepped(first, schedule, 80)
second, longer = made(200)
second.load_state_dict(first.state_dict())
longer.load_state_dict(schedule.state_dict())
rates = stepped(second, longer, 120)
shown = {step: round(rates[step - 81], 3) for step in (100, 120, 150, 180, 200)}
whole = stepped(*made(200), 200)
print(f"seen:      T_max {longer.T_max}; rates by step {shown}; of a training with 200 from its start {[round(whole[step - 1], 3) for step in shown]}")
assert longer.T_max == 100 and shown[100] < 1e-3 and shown[200] > 0.99 and whole[-1] < 1e-3, "this has changed"
PYTHON
