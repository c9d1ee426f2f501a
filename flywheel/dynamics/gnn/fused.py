"""The fast forward pass: node-major arrays [M, K, width], static indices, few large products.

It computes what `benchmarks.speed.reference` computes, from the same weights; a test holds the
two together. It is what trains, plans and is measured. K should be about 100, so that the arrays of
one round stay in the processor's cache.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from flywheel.dynamics.gnn.features import GraphFeatures
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.packed import Encoder, Layer, PackedRound, pack
from flywheel.dynamics.gnn.prediction import Memory, Prediction
from flywheel.dynamics.gnn.routes import Route, all_routes, gather


class FusedForward:
    """Computes one network on one graph.

    Args:
      network: the weights; packed here, so that later changes have no effect.
      graph: of the network's robot.

    Attributes:
      packed: the weights.
    """

    def __init__(self, network: ChunkNetwork, graph: RobotGraph) -> None:
        self._graph, self._config = graph, network.config
        self.packed = pack(network, graph)
        self._routes = graph.cached("routes", all_routes)
        self._group_sizes = {
            name: [group.size for group in relation.groups]
            for name, relation in graph.relations.items()
        }

    def warm_up(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """Run only the LSTM over features of the body nodes (F, N, K)."""
        if self.packed.gates is None:
            return None
        return self._remember(self._encode("body_node", nodes, dataset)[0], memory)

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """Predict one chunk."""
        samples = features.controls.shape[1]
        nodes, memory = self._encode_nodes(features, memory)
        edges = self._encode_edges(features)
        touching = features.touching.float()[None, :, :, None]
        messages: dict[str, Tensor] = {}
        for number, weights in enumerate(self.packed.rounds):
            final = number == len(self.packed.rounds) - 1
            nodes, edges, messages = self._round(weights, nodes, edges, touching, final)
        return Prediction(
            velocity=self._decode_nodes(nodes[: self._graph.body_count].flatten(0, 1), samples),
            winch=self._decode_cables(messages["cable"]) if self.packed.cable_decoder else None,
            memory=memory,
        )

    # --- encoders -------------------------------------------------------------------------------

    def _encode(self, name: str, features: Tensor, dataset: Tensor) -> tuple[Tensor, Encoder]:
        """(M K, width) of one kind of nodes, after the encoder's last ReLU."""
        encoder = self.packed.encoders[name]
        bias = encoder.first.bias
        if len(encoder.tail):
            bias = bias + encoder.tail[dataset]
            bias = (
                bias.expand(features.shape[1], -1, -1).flatten(0, 1)
                if len(dataset) > 1
                else bias[0]
            )
        return self._first(encoder, features, bias), encoder

    def _first(self, encoder: Encoder, features: Tensor, bias: Tensor) -> Tensor:
        if len(encoder.constants):
            constants = encoder.constants.expand(-1, -1, features.shape[-1])
            features = torch.cat([features, constants])
        hidden = torch.addmm(bias, features.flatten(1).t(), encoder.first.weight).relu_()
        for layer in encoder.middle:
            hidden = _linear(hidden, layer).relu_()
        return hidden

    def _encode_nodes(
        self, features: GraphFeatures, memory: Memory | None
    ) -> tuple[Tensor, Memory | None]:
        samples = features.controls.shape[1]
        hidden, encoder = self._encode("body_node", features.nodes["body_node"], features.dataset)
        if self.packed.gates is None:
            latent = _normed(_linear(hidden, encoder.last), encoder.norm)
        else:
            memory = self._remember(hidden, memory)
            latent = _normed(memory[0], self.packed.memory_norm)
        moving, still = latent.view(-1, samples, latent.shape[-1]), self.still(features)
        return moving if still is None else torch.cat([moving, still]), memory

    def still(self, features: GraphFeatures) -> Tensor | None:
        """(A + 1, K, width) latent vectors of the anchors and of the ground; None without any."""
        parts = []
        for name in ("anchor_node", "ground_node"):
            if name in features.nodes:
                shown = features.nodes[name]
                hidden, encoder = self._encode(name, shown, features.dataset)
                still = _normed(_linear(hidden, encoder.last), encoder.norm)
                parts.append(still.view(*shown.shape[1:], -1))
        return torch.cat(parts) if parts else None

    def _remember(self, hidden: Tensor, memory: Memory | None) -> Memory:
        packed, width = self.packed, self._config.width
        encoder = packed.encoders["body_node"]
        assert packed.gates is not None and packed.recurrent is not None
        if encoder.norm is not None:
            hidden = _normed(_linear(hidden, encoder.last), encoder.norm)
        gates = _linear(hidden, packed.gates)
        if memory is not None:
            gates = torch.addmm(gates, memory[0], packed.recurrent)
        gates = gates.sigmoid()
        write, keep, show, value = gates.split(width, dim=1)
        cell = write * (2.0 * value - 1.0)
        if memory is not None:
            cell = cell + keep * memory[1]
        return show * (2.0 * torch.sigmoid(2.0 * cell) - 1.0), cell

    def _encode_edges(self, features: GraphFeatures) -> dict[str, Tensor]:
        """(E, K, width) per relation: latent vectors, or the encoder's last ReLU where folded."""
        edges = {}
        for name, shown in features.edges.items():
            encoder = self.packed.encoders[name]
            bias = encoder.first.bias
            if name == "cable":
                bias = self._control_bias(encoder, features.controls)
            hidden = self._first(encoder, shown, bias)
            if self._config.edge_updates or encoder.norm is not None:
                hidden = _normed(_linear(hidden, encoder.last), encoder.norm)
            edges[name] = hidden.view(shown.shape[1], shown.shape[2], -1)
        return edges

    def _control_bias(self, encoder: Encoder, controls: Tensor) -> Tensor:
        """(E K, width) contribution of the winches' controls to the cable edges; zero for passive ones."""
        winches, samples, steps = controls.shape
        flat = controls.reshape(winches * samples, steps)
        driven = torch.addmm(encoder.first.bias, flat, encoder.tail).view(winches, samples, -1)
        passive = encoder.first.bias.expand(1, samples, -1)
        rows = torch.cat([driven, passive])
        graph = self._graph
        incidence = graph.cached("winch_rows", _winch_rows)
        return gather(rows, graph.cable_winch, incidence).flatten(0, 1)

    # --- processor ------------------------------------------------------------------------------

    def _round(
        self,
        weights: PackedRound,
        nodes: Tensor,
        edges: dict[str, Tensor],
        touching: Tensor,
        final: bool,
    ) -> tuple[Tensor, dict[str, Tensor], dict[str, Tensor]]:
        """One round of message passing; returns nodes, edges and messages."""
        count, samples, width = nodes.shape
        parts = _linear(nodes.view(-1, width), weights.nodes).view(count, samples, -1)
        split = [rows.split(width, dim=-1) for rows in parts.split(self._graph.family_sizes)]
        projected = [[rows[i] for rows in split] for i in range(len(split[0]))]
        grouped = {name: edges[name].split(sizes) for name, sizes in self._group_sizes.items()}
        families = [rows.view(-1, width) for rows in nodes.split(self._graph.family_sizes)]
        families = families[:1] if final else families
        sums = [_linear(rows, weights.self_part) for rows in families]
        latents: dict[str, list[Tensor]] = {name: [] for name in edges}
        for route in self._routes:
            name, ends = route.name, route.family >= len(families)
            if ends and name != "cable":
                continue  # nothing reads what anchors and ground would know after the last round
            message = self._message(weights, route, projected, grouped[name][route.part])
            latents[name].append(message.flatten(0, 1))
            if ends:
                continue
            if name == "contact":
                message = message * (touching if route.family else _by_node(touching, route.degree))
            summed = message.sum(1) if route.degree > 1 else message.squeeze(1)
            sums[route.family] = _add(sums[route.family], summed, weights.sum_parts[name], route)
        updated = [self._update(weights, s, r) for s, r in zip(sums, families, strict=True)]
        nodes = torch.cat(updated).view(-1, samples, width)
        messages = {n: torch.cat(m) if len(m) > 1 else m[0] for n, m in latents.items() if m}
        return nodes, messages if self._config.edge_updates else edges, messages

    def _message(
        self, weights: PackedRound, route: Route, projected: list[list[Tensor]], edges: Tensor
    ) -> Tensor:
        """(R, d, K, width) the messages of one group of edges."""
        base = route.senders(projected[2 * route.place])
        base = base + route.receivers(projected[2 * route.place + 1])
        edge = edges.flatten(0, 1)
        hidden = torch.addmm(base.flatten(0, 2), edge, weights.edges[route.name])
        deeper = weights.deeper[route.name]
        if not deeper:
            return hidden.relu_().view_as(base)
        for layer in deeper:
            hidden = _linear(hidden.relu_(), layer)
        return (edge + hidden).view_as(base)

    def _update(self, weights: PackedRound, hidden: Tensor, before: Tensor) -> Tensor:
        for layer in weights.update:
            hidden = _linear(hidden.relu_(), layer)
        return _normed(before + hidden, weights.norm)

    # --- decoders -------------------------------------------------------------------------------

    def _decode_nodes(self, nodes: Tensor, samples: int) -> Tensor:
        steps = self._config.chunk
        decoded = _decode(nodes, self.packed.node_decoder)
        return decoded.view(3, steps, -1, samples)

    def _decode_cables(self, latent: Tensor) -> Tensor:
        """(n, W, K): decoded per cable edge, averaged over the edges of a winch.

        The average is taken before the last layer, because averaging commutes with it.
        """
        first, *middle, last = self.packed.cable_decoder
        _, samples, width = latent.shape
        hidden = _linear(latent.view(-1, width), first).relu_()
        for layer in middle:
            hidden = _linear(hidden, layer).relu_()
        hidden = (self._graph.winch_average @ hidden.view(len(latent), -1)).view(-1, width)
        decoded = torch.addmm(last.bias, last.weight, hidden.t())
        return decoded.view(self._config.chunk, -1, samples)


def _winch_rows(graph: RobotGraph) -> Tensor:
    """(W + 1, E) incidence of cable edges on winches; the last row is of the passive cables."""
    rows = torch.zeros(len(graph.robot.winches) + 1, len(graph.cable_winch), device=graph.device)
    rows[graph.cable_winch, torch.arange(rows.shape[1])] = 1.0
    return rows


def _linear(rows: Tensor, layer: Layer) -> Tensor:
    return torch.addmm(layer.bias, rows, layer.weight)


def _normed(rows: Tensor, norm: nn.LayerNorm | None) -> Tensor:
    if norm is None:
        return rows
    return F.layer_norm(rows, norm.normalized_shape, norm.weight, norm.bias, norm.eps)


def _add(sums: Tensor, messages: Tensor, weight: Tensor, route: Route) -> Tensor:
    """Add (R, K, width) summed messages, through their part of the update, to the receivers' rows."""
    flat = messages.flatten(0, 1)
    if route.whole:
        return torch.addmm(sums, flat, weight)
    samples = messages.shape[1]
    spread = sums.view(-1, samples, sums.shape[-1])
    added = (flat @ weight).view(-1, samples, sums.shape[-1])
    return spread.index_add(0, route.within_family, added).view_as(sums)


def _by_node(touching: Tensor, degree: int) -> Tensor:
    """(N, d, K, 1) of possible contacts (1, d N, K, 1), which are ordered by surface."""
    return touching.unflatten(1, (degree, -1))[0].transpose(0, 1)


def _decode(rows: Tensor, layers: tuple[Layer, ...]) -> Tensor:
    """(out, M K): the last layer is transposed, so that its output is component-major."""
    *hidden, last = layers
    for layer in hidden:
        rows = _linear(rows, layer).relu_()
    return torch.addmm(last.bias, last.weight, rows.t())
