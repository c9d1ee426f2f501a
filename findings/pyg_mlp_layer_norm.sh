#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch_geometric==2.8.1 torch==2.13.0 numpy==2.4.6
echo "guess:     what an MLP with norm=\"layer_norm\" makes of a row does not depend on the other rows, as torch's LayerNorm"
echo "behaviour: it is normalised over all rows: a node alone, or in a larger batch, gets other values; with norm_kwargs=dict(mode=\"node\") not"
python - <<'PYTHON'
import torch
from torch_geometric.nn import MLP

torch.manual_seed(0)
nodes = torch.randn(100, 4)
found = {}
for name, options in (("layer_norm", {}), ("layer_norm, mode node", {"norm_kwargs": {"mode": "node"}})):
    torch.manual_seed(1)
    network = MLP([4, 32, 32, 3], norm="layer_norm", **options).eval()
    with torch.no_grad():
        together = network(nodes)
        apart = {count: torch.cat([network(batch) for batch in nodes.split(count)]) for count in (1, 10, 100)}
        found[name] = {count: round(float((each - together).abs().max() / together.std()), 3) for count, each in apart.items()}
print(f"seen:      largest change of an output of 100 nodes when they are given 1, 10 and 100 at a time, in deviations of the outputs: {found}")
assert found["layer_norm"][1] > 0.3 and found["layer_norm"][10] > 0.05 and found["layer_norm"][100] == 0, "this has changed"
assert max(found["layer_norm, mode node"].values()) < 0.001, "this has changed"
PYTHON
