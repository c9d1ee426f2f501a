#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torchdiffeq==0.2.5 torch==2.13.0 numpy==2.4.6
echo "guess:     odeint with rk4 and a step_size is as accurate at requested times between steps as at steps"
echo "behaviour: between steps it draws straight lines: 150 times the error, whatever the order of the method; interp='cubic' does not"
python - <<'PYTHON'
import torch
from torchdiffeq import odeint

times = torch.linspace(0, 10, 401, dtype=torch.float64)


def errors(**options):
    """Largest errors of an oscillator at steps of .1 s, and at all times, each .025 s."""
    start = torch.tensor([0.0, 1.0], dtype=torch.float64)
    found = odeint(lambda t, y: torch.stack([y[1], -y[0]]), start, times, method="rk4", options={"step_size": 0.1, **options})
    off = (found[:, 0] - torch.sin(times)).abs()
    return off[::4].max().item(), off.max().item()


(at, between), (_, cubic) = errors(), errors(interp="cubic")
print(f"seen:      {at:.1e} at steps, {between:.1e} between them, {cubic:.1e} with interp='cubic'")
assert at < 1e-5 and between > 1e-3 and cubic < 1e-5, "this has changed"
PYTHON
