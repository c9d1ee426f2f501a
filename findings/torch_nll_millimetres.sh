#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 numpy==2.4.6
echo "guess:     GaussianNLLLoss is least where a predicted variance is that of the errors, or at its eps, 1e-6 m2"
echo "behaviour: for errors below 1 mm, in metres, it pushes the variance on towards zero: predicted deviations are ever smaller"
python - <<'PYTHON'
import torch

torch.set_default_dtype(torch.float64)


def deviations(spread, metre=1.0):
    """Predicted deviations [m] after 500, 1000 and 2000 steps, from 3 mm on, for errors with this one [m]."""
    logarithm = torch.tensor(2 * torch.log(torch.tensor(0.003 * metre)).item(), requires_grad=True)
    optimizer, found = torch.optim.Adam([logarithm], lr=0.02), []
    errors = spread * metre * torch.randn(1000, generator=torch.Generator().manual_seed(0))
    for step in range(2000):
        optimizer.zero_grad()
        torch.nn.GaussianNLLLoss()(errors, torch.zeros(1000), logarithm.exp().expand(1000)).backward()
        optimizer.step()
        if step + 1 in (500, 1000, 2000):
            found.append(float(f"{(logarithm / 2).exp().item() / metre:.2g}"))
    return found


metres = {spread: deviations(spread) for spread in (0.002, 0.0005)}
millimetres = deviations(0.0005, metre=1000.0)
print(f"seen:      deviations [m] after 500, 1000, 2000 steps, by that of the errors: {metres}; the latter in millimetres: {millimetres}")
assert abs(metres[0.002][-1] - 0.002) < 1e-4 and abs(millimetres[-1] - 0.0005) < 5e-5, "this has changed"
first, second, last = metres[0.0005]
assert first > 1.5 * second > 2 * last and last < 0.0005 / 4, "this has changed"
PYTHON
