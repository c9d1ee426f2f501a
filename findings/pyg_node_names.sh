#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch_geometric==2.8.1 torch==2.13.0 numpy==2.4.6
echo "guess:     a Data whose features are called state has as many nodes as these have rows, whatever else it holds"
echo "behaviour: if none is called x, pos or the like, one with 'node' in its name decides: target_node makes it one node, without a warning"
python - <<'PYTHON'
import warnings

import torch
from torch_geometric.data import Batch, Data

warnings.simplefilter("error")
ring = torch.tensor([[0, 1, 2, 3], [1, 2, 3, 0]])


data = Data(edge_index=ring, state=torch.zeros(4, 6), target_node=torch.tensor([3]))
batch = Batch.from_data_list([data, data])
edges = batch.edge_index.tolist()
print(f"seen:      {data.num_nodes} node in each of two rings of four, {batch.num_nodes} in their batch, whose edges share nodes: {edges}")
assert (data.num_nodes, batch.num_nodes) == (1, 2), "this has changed"
assert edges == [[0, 1, 2, 3, 1, 2, 3, 4], [1, 2, 3, 0, 2, 3, 4, 1]], "this has changed"
PYTHON
