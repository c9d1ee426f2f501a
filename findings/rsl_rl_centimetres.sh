#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" rsl-rl-lib==5.5.1 torch==2.13.0 numpy==2.4.6
echo "guess:     observations that EmpiricalNormalization has normalised have a deviation of 1, in whatever unit they come"
echo "behaviour: 0.01 is added to the deviation: places that vary by 1 cm, in metres, get one of 0.5, by 1 mm of 0.09; in millimetres they are right"
python -W ignore - <<'PYTHON'
import torch
from rsl_rl.modules import EmpiricalNormalization


def deviation(spread):
    """Deviation of 100 batches of 64 places of a given spread, after they were normalised."""
    places = spread * torch.randn(6400, 3, generator=torch.Generator().manual_seed(0))
    normalisation = EmpiricalNormalization(3).train()
    for batch in places.split(64):
        normalisation.update(batch)
    return round(float(normalisation.eval()(places).std()), 3)


metres, millimetres = {spread: deviation(spread) for spread in (1.0, 0.01, 0.001)}, {spread: deviation(1000 * spread) for spread in (0.01, 0.001)}
print(f"seen:      normalised deviations by those in metres: {metres}; the same in millimetres: {millimetres}")
assert abs(metres[0.01] - 0.5) < 0.01 and metres[0.001] < 0.1 and min(millimetres.values()) > 0.98, "this has changed"
PYTHON
