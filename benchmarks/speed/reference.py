"""The network as plain PyTorch Geometric: slow, short, and the definition of the network.

`flywheel.dynamics.gnn.fused` computes the same from the same weights; a test compares the two to
1e-5 relative in float32. Read this one.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch_geometric.data import Batch, Data
from torch_geometric.nn import MessagePassing

from flywheel.dynamics.gnn.features import GraphFeatures
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.network import ChunkNetwork, Perceptron
from flywheel.dynamics.gnn.prediction import Memory, Prediction


def perceptron(layers: Perceptron, rows: Tensor) -> Tensor:
    """Linear layers with ReLU between them."""
    for linear in layers.linears[:-1]:
        rows = torch.relu(linear(rows))
    return layers.linears[-1](rows)


class Messages(MessagePassing):
    """Messages along the edges of one relation, summed at their receivers.

    Args:
      weights: the message's perceptron, on [receiver, sender, edge].
      edge_updates: its output is added to the edge's latent vector, which is the message; else the
        message is the perceptron's output after a ReLU.
    """

    def __init__(self, weights: Perceptron, edge_updates: bool) -> None:
        super().__init__(aggr="add")
        self.weights, self.edge_updates = weights, edge_updates

    def forward(
        self, nodes: Tensor, edge_index: Tensor, edges: Tensor, present: Tensor
    ) -> tuple[Tensor, Tensor]:
        """(M, width) sums at the receivers, and (E, width) messages.

        Args:
          nodes: (M, width) latent vectors.
          edge_index: (2, E) senders and receivers.
          edges: (E, width) latent vectors.
          present: (E, 1) 1 for an existing edge, else 0.
        """
        messages = self.edge_updater(edge_index, nodes=nodes, edges=edges)
        size = (len(nodes), len(nodes))
        return self.propagate(edge_index, size=size, messages=messages * present), messages

    def edge_update(self, nodes_i: Tensor, nodes_j: Tensor, edges: Tensor) -> Tensor:
        """The message of each edge from node j to node i."""
        output = perceptron(self.weights, torch.cat([nodes_i, nodes_j, edges], dim=1))
        return edges + output if self.edge_updates else torch.relu(output)

    def message(self, messages: Tensor) -> Tensor:
        """The summed message at the receiver."""
        return messages


class PlainForward:
    """Computes one network on one graph, as written in the paper.

    Samples are the graphs of a PyG batch. Nodes and edges are sample-major here.

    Args:
      network: the weights.
      graph: of the network's robot.
    """

    def __init__(self, network: ChunkNetwork, graph: RobotGraph) -> None:
        self.network, self.graph = network, graph

    def warm_up(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """Run only the LSTM over features of the body nodes (F, N, K)."""
        if self.network.memory is None:
            return None
        samples = nodes.shape[-1]
        encoded = self._encode("body_node", nodes, self._one_hot(dataset, samples))
        return self._to_node_major(self._run_memory(encoded, memory, samples), samples)

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """Predict one chunk."""
        samples = features.controls.shape[1]
        nodes, memory = self._encode_nodes(features, memory, samples)
        edges = self._encode_edges(features, samples)
        batch = self._batch(samples)
        for weights in self.network.rounds:
            sums = [nodes]
            for name in self.graph.relations:
                message = Messages(weights.messages[name], self.network.config.edge_updates)
                present = self._present(name, features.touching, edges[name])
                index = batch[f"{name}_edge_index"]
                summed, messages = message(nodes, index, edges[name], present)
                sums.append(summed)
                if self.network.config.edge_updates:
                    edges[name] = messages
                if name == "cable":
                    cables = messages
            nodes = nodes + perceptron(weights.update, torch.cat(sums, dim=1))
            if weights.norm is not None:
                nodes = weights.norm(nodes)
        bodies = nodes.view(samples, self.graph.count, -1)[:, : self.graph.body_count]
        winch = None if self.network.cable_decoder is None else self._winch(cables, samples)
        return Prediction(self._velocity(bodies), winch, memory)

    def _batch(self, samples: int) -> Batch:
        def build(graph: RobotGraph) -> Batch:
            edges = {
                f"{name}_edge_index": torch.stack([r.senders, r.receivers])
                for name, r in graph.relations.items()
            }
            return Batch.from_data_list([Data(num_nodes=graph.count, **edges)] * samples)

        return self.graph.cached(f"batch of {samples}", build)

    # --- encoders -------------------------------------------------------------------------------

    def _encode(self, name: str, changing: Tensor, *rest: Tensor) -> Tensor:
        """(K M, width) from changing features (F, M, K) and further ones (K M, ...)."""
        normaliser = self.network.normalisers[name]
        rows = changing.permute(2, 1, 0).flatten(0, 1)
        rows = torch.cat([(rows - normaliser.mean) / normaliser.std, *rest], dim=1)
        encoded = perceptron(self.network.encoders[name], rows)
        norms = self.network.encoder_norms
        return norms[name](encoded) if name in norms else encoded

    def _one_hot(self, dataset: Tensor, samples: int) -> Tensor:
        """(K N, constants and one-hot) of the body nodes."""
        hot = self._data_sets(dataset, samples).repeat_interleave(self.graph.body_count, dim=0)
        return torch.cat([self.graph.node_constants.repeat(samples, 1), hot], dim=1)

    def _data_sets(self, dataset: Tensor, samples: int) -> Tensor:
        classes = self.network.config.datasets
        return torch.nn.functional.one_hot(dataset.expand(samples), classes).float()

    def _encode_nodes(
        self, features: GraphFeatures, memory: Memory | None, samples: int
    ) -> tuple[Tensor, Memory | None]:
        rest = self._one_hot(features.dataset, samples)
        latent = self._encode("body_node", features.nodes["body_node"], rest)
        if self.network.memory is not None:
            latent, cell = self._run_memory(latent, memory, samples)
            memory = self._to_node_major((latent, cell), samples)
            if self.network.memory_norm is not None:
                latent = self.network.memory_norm(latent)
        parts = [latent]
        if "anchor_node" in features.nodes:
            shown = features.nodes["anchor_node"]
            hot = self._data_sets(features.dataset, samples)
            hot = hot.repeat_interleave(shown.shape[1], dim=0)
            parts.append(self._encode("anchor_node", shown, hot))
        if "ground_node" in features.nodes:
            parts.append(self._encode("ground_node", features.nodes["ground_node"]))
        by_sample = [part.view(samples, -1, part.shape[-1]) for part in parts]
        return torch.cat(by_sample, dim=1).flatten(0, 1), memory

    def _run_memory(self, encoded: Tensor, memory: Memory | None, samples: int) -> Memory:
        assert self.network.memory is not None
        before = None
        if memory is not None:
            before = tuple(
                m.view(-1, samples, m.shape[-1]).transpose(0, 1).flatten(0, 1) for m in memory
            )
        hidden, cell = self.network.memory(encoded, before)
        return hidden, cell

    def _to_node_major(self, memory: Memory, samples: int) -> Memory:
        hidden, cell = (
            m.view(samples, -1, m.shape[-1]).transpose(0, 1).flatten(0, 1) for m in memory
        )
        return hidden, cell

    def _encode_edges(self, features: GraphFeatures, samples: int) -> dict[str, Tensor]:
        edges = {}
        for name, shown in features.edges.items():
            rest = [] if name == "contact" else [self._constants(name, samples)]
            if name == "cable":
                rest.append(self._controls(features.controls))
            edges[name] = self._encode(name, shown, *rest)
        return edges

    def _constants(self, name: str, samples: int) -> Tensor:
        return self.graph.relations[name].constants.repeat(samples, 1)

    def _controls(self, controls: Tensor) -> Tensor:
        """(K E, h + n) of each cable edge's winch; 0 for a passive cable."""
        rows = torch.cat([controls, torch.zeros_like(controls[:1])])[self.graph.cable_winch]
        return rows.transpose(0, 1).flatten(0, 1)

    def _present(self, name: str, touching: Tensor, edges: Tensor) -> Tensor:
        if name != "contact":
            return edges.new_ones(len(edges), 1)
        contact = self.graph.relations[name].origin % self.graph.contact_count
        return touching[contact].t().reshape(-1, 1)

    # --- decoders -------------------------------------------------------------------------------

    def _velocity(self, bodies: Tensor) -> Tensor:
        """(3, n, N, K) from latent vectors (K, N, width)."""
        decoded = perceptron(self.network.node_decoder, bodies).unflatten(-1, (3, -1))
        return (decoded * self.network.velocity_scale).permute(2, 3, 1, 0)

    def _winch(self, cables: Tensor, samples: int) -> Tensor:
        """(n, W, K): decoded per cable edge, averaged over the edges of a winch."""
        assert self.network.cable_decoder is not None
        decoded = perceptron(self.network.cable_decoder, cables) * self.network.winch_scale
        by_sample = decoded.view(samples, -1, decoded.shape[-1])
        return torch.einsum("we,ken->nwk", self.graph.winch_average, by_sample)
