#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torchdiffeq==0.2.5 torch==2.13.0 numpy==2.4.6
echo "guess:     explicit_adams follows an oscillator with 600 steps to the swing, and finer steps are nearer"
echo "behaviour: it goes up to order 12, which is stable for tiny steps only: 1e74 after 10 s, and more the finer; max_order=4 is right"
python - <<'PYTHON'
import torch
from torchdiffeq import odeint

start = torch.tensor([0.0, 1.0], dtype=torch.float64)


def error(steps, method, **options):
    times = torch.linspace(0, 10, steps + 1, dtype=torch.float64)
    found = odeint(lambda t, y: torch.stack([y[1], -y[0]]), start, times, method=method, options=options)
    return (found[:, 0] - torch.sin(times)).abs().max().item()


adams = [error(steps, "explicit_adams") for steps in (100, 200, 400, 1000)]
fourth, runge = error(1000, "explicit_adams", max_order=4), error(1000, "rk4")
print(f"seen:      errors of 100, 200, 400, 1000 steps: {', '.join(f'{each:.0e}' for each in adams)};")
print(f"           of 1000 steps with max_order=4 {fourth:.0e}, of rk4 {runge:.0e}")
assert adams == sorted(adams) and adams[0] > 1e20 and fourth < 1e-5 and runge < 1e-8, "this has changed"
PYTHON
