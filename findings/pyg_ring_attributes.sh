#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 torch_geometric==2.8.1 numpy==2.4.6
echo "guess:     rest_length with one value per edge belongs to the edges in each graph of a data set"
echo "behaviour: in graphs with as many nodes as edges, such as rings, it belongs to the nodes: transforms keep other edges' lengths, or too few"
python - <<'PYTHON'
import torch
from torch_geometric.data import Data
from torch_geometric.transforms import ToUndirected


def ring(nodes, more):
    """A ring of `nodes`, with cable k from node k on being k + 1 metres long, and `more` nodes without cables."""
    start = torch.arange(nodes)
    edges = torch.stack([start, (start + 1) % nodes])
    return Data(num_nodes=nodes + more, edge_index=edges, rest_length=1.0 + start)


def kept(graph):
    """Cables and their rest lengths among the nodes 1, 2 and 3."""
    part = graph.subgraph(torch.tensor([1, 2, 3]))
    return (part.edge_index + 1).T.tolist(), part.rest_length.tolist()


plain, alone = kept(ring(4, 1)), kept(ring(4, 0))
both = [(graph.num_edges, len(graph.rest_length)) for graph in (ToUndirected()(ring(4, 1)), ToUndirected()(ring(4, 0)))]
print(f"seen:      of nodes 1 to 3 of a ring of 4 with another node {plain}, without it {alone};")
print(f"           (edges, lengths) when undirected {both}")
assert plain == ([[1, 2], [2, 3]], [2, 3]) and alone == ([[1, 2], [2, 3]], [2, 3, 4]), "this has changed"
assert both == [(8, 8), (8, 4)], "this has changed"
PYTHON
