#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 torch_geometric==2.8.1 numpy==2.4.6
echo "guess:     ToUndirected leaves a graph alone that has each edge in both directions"
echo "behaviour: edges met twice are added up: lengths of 1 and 2 m become 2 and 4 m, and 4 and 8 m the next time"
python - <<'PYTHON'
import torch
from torch_geometric.data import Data
from torch_geometric.transforms import ToUndirected

half = Data(num_nodes=3, edge_index=torch.tensor([[0, 1], [1, 2]]), edge_attr=torch.tensor([1.0, 2.0]))
once = ToUndirected()(half)
lengths = [once.edge_attr.tolist()]
for _ in range(2):
    once = ToUndirected()(once)
    lengths.append(once.edge_attr.tolist())
kept = ToUndirected(reduce="mean")(once).edge_attr.tolist()
print(f"seen:      lengths after one, two, three times: {lengths}; once more with reduce='mean': {kept}")
assert lengths == [[1, 1, 2, 2], [2, 2, 4, 4], [4, 4, 8, 8]] and kept == lengths[2], "this has changed"
PYTHON
