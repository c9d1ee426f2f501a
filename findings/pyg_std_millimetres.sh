#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 torch_geometric==2.8.1 numpy==2.4.6
echo "guess:     the aggregation \"std\" is the standard deviation of the neighbours' features"
echo "behaviour: below 3.2 mm, in metres, it is 0; and 100 m from the origin also for 2 cm, in single precision"
python - <<'PYTHON'
import torch
from torch_geometric.nn.aggr import StdAggregation

aggregation = StdAggregation()


def found(spread, origin, dtype=torch.float32):
    """Deviation [m] of two neighbours, which are `spread` metres to each side of `origin`."""
    places = torch.tensor([[origin - spread], [origin + spread]], dtype=dtype)
    assert abs(places.std(unbiased=False).item() - spread) < 1e-4
    return round(aggregation(places, torch.tensor([0, 0])).item(), 5)


spreads = (0.001, 0.003, 0.0035, 0.02)
near, double = {spread: found(spread, 0.0) for spread in spreads}, {spread: found(spread, 0.0, torch.float64) for spread in spreads}
far = {origin: found(0.02, origin) for origin in (1.0, 10.0, 30.0, 100.0)}
print(f"seen:      by deviation at the origin {near}; in double precision {double}; of 0.02 by distance {far}")
assert near[0.003] == double[0.003] == 0.0 and near[0.0035] == 0.0035 and far[100.0] == 0.0 and abs(far[1.0] - 0.02) < 1e-4, "this has changed"
PYTHON
