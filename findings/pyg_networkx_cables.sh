#!/usr/bin/env bash
. "$(dirname "$0")/environment.sh" torch==2.13.0 torch_geometric==2.8.1 networkx==3.6.1 numpy==2.4.6
echo "guess:     three cables, two of them between the same bodies, are three edges of an undirected networkx graph, and come back as three"
echo "behaviour: the last of parallel cables replaces the others; with to_multi there are all, but each twice, and twice as many with each return"
python -W ignore - <<'PYTHON'
import torch
from torch_geometric.data import Data
from torch_geometric.utils import from_networkx, to_networkx

stiffnesses = torch.tensor([100.0, 100.0, 7.0, 7.0, 5.0, 5.0])
robot = Data(edge_index=torch.tensor([[0, 1, 0, 1, 1, 2], [1, 0, 1, 0, 2, 1]]), stiffness=stiffnesses, num_nodes=3)


def cables(graph):
    """Stiffnesses [N/m] of a graph's edges."""
    return sorted(value for _, _, value in graph.edges(data="stiffness"))


simple = to_networkx(robot, edge_attrs=["stiffness"], to_undirected=True)
multi = to_networkx(robot, edge_attrs=["stiffness"], to_undirected=True, to_multi=True)
again = from_networkx(multi)
third = to_networkx(again, edge_attrs=["stiffness"], to_undirected=True, to_multi=True)
print(f"seen:      to_undirected {cables(simple)}; with to_multi {cables(multi)}; {robot.num_edges} directed edges became {again.num_edges}, then {from_networkx(third).num_edges}")
assert cables(simple) == [5, 7] and cables(multi) == [5, 5, 7, 7, 100, 100], "this has changed"
assert (robot.num_edges, again.num_edges, from_networkx(third).num_edges) == (6, 12, 24), "this has changed"
PYTHON
