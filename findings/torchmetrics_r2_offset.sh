#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torchmetrics==1.9.0 torch==2.13.0 numpy==2.4.6
echo "guess:     R2Score and ExplainedVariance of positions +- 1 cm do not depend on how far from the origin they are, as long as single precision resolves them"
echo "behaviour: they subtract sums of squares: 100 m away they say anything from 0 to 1.03, where 0.75 is right"
python -W ignore - <<'PYTHON'
import torch
from torchmetrics import ExplainedVariance, R2Score



def scored(offset, seed):
    """R2 in double precision, R2Score and ExplainedVariance of a thousand positions [m]."""
    generator = torch.Generator().manual_seed(seed)
    truth = offset + 0.01 * torch.randn(1000, generator=generator)
    predicted = truth + 0.005 * torch.randn(1000, generator=generator)
    wide, error = truth.double(), truth.double() - predicted.double()
    own = 1 - (error**2).sum() / ((wide - wide.mean()) ** 2).sum()
    return [value.item() for value in (own, R2Score()(predicted, truth), ExplainedVariance()(predicted, truth))]


values = {offset: torch.tensor([scored(offset, seed) for seed in range(20)]) for offset in (0.0, 10.0, 100.0)}
seen = {offset: [(round(low, 2), round(high, 2)) for low, high in zip(*(ends.tolist() for ends in found.aminmax(dim=0)))] for offset, found in values.items()}
print(f"seen:      least and largest R2 in double precision, R2Score and ExplainedVariance of 20 recordings, by the offset [m]: {seen}")
for found in values.values():
    assert (found[:, 0] - 0.75).abs().max() < 0.05, "this has changed"
assert (values[0.0][:, 1:] - values[0.0][:, :1]).abs().max() < 5e-3, "this has changed"
for column in (1, 2):
    assert values[100.0][:, column].max() > 0.95 and values[100.0][:, column].min() < 0.65, "this has changed"
PYTHON
