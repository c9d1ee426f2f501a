"""A network's weights, rearranged once for the cheapest forward pass.

- Normalisation is folded into the first layers.
- Two linear layers without a nonlinearity between them are multiplied: the last layer of an encoder
  and the following one (the LSTM's input, or the edge part of every round's messages).
- The first layer of a message acts on [receiver, sender, edge]; it is split into its three parts,
  so that nodes are multiplied once per node and not once per edge, for all edge types in one
  product.
- The decoders' scales are folded into their last layers.

Gradients flow through the packing, so the same arrays serve training.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.network import ChunkNetwork, Normaliser, Perceptron, Round


@dataclass(frozen=True)
class Layer:
    """x -> x @ weight + bias, with weight (in, out) and bias (out,)."""

    weight: Tensor
    bias: Tensor

    def then(self, other: Layer) -> Layer:
        """The composition of this layer with `other`."""
        return Layer(self.weight @ other.weight, self.bias @ other.weight + other.bias)


@dataclass(frozen=True)
class Encoder:
    """An encoder of one kind of node or edge, up to its last ReLU; the last layer is `last`.

    Attributes:
      first: acts on [changing features, constants].
      constants: (S, M, 1) constants of the nodes or edges.
      tail: (C, width) weights of the inputs that differ by sample: the one-hot, or the controls.
      middle: layers between the first and the last.
      last: final layer.
      norm: LayerNorm after it, or None.
    """

    first: Layer
    constants: Tensor
    tail: Tensor
    middle: tuple[Layer, ...]
    last: Layer
    norm: nn.LayerNorm | None


@dataclass(frozen=True)
class PackedRound:
    """One round of message passing.

    Attributes:
      nodes: (width, 2 R width) sender and receiver parts of all R relations' messages.
      edges: per relation, weights of the edge's latent vector (or of its encoder's last ReLU).
      deeper: per relation, the message's further layers; empty without edge updates.
      self_part: part of the update's first layer that acts on the node itself.
      sum_parts: per relation, the part that acts on the summed messages.
      update: further layers of the update.
      norm: LayerNorm after it, or None.
    """

    nodes: Layer
    edges: dict[str, Tensor]
    deeper: dict[str, tuple[Layer, ...]]
    self_part: Layer
    sum_parts: dict[str, Tensor]
    update: tuple[Layer, ...]
    norm: nn.LayerNorm | None


@dataclass(frozen=True)
class Packed:
    """All of a network's weights, ready for use.

    Attributes:
      encoders: by kind.
      gates: of the LSTM, acting on the last ReLU of the encoder (or on its output if followed by a
        LayerNorm), in the order input, forget, output, cell; the cell's doubled. None without.
      recurrent: (width, 4 width) acting on the hidden state, likewise.
      rounds: of message passing.
      node_decoder, cable_decoder: layers; the last one is transposed, see `decode`.
    """

    encoders: dict[str, Encoder]
    gates: Layer | None
    recurrent: Tensor | None
    memory_norm: nn.LayerNorm | None
    rounds: tuple[PackedRound, ...]
    node_decoder: tuple[Layer, ...]
    cable_decoder: tuple[Layer, ...]


def pack(network: ChunkNetwork, graph: RobotGraph) -> Packed:
    """Rearrange a network's weights for its graph."""
    encoders = {name: _encoder(network, graph, name) for name in network.encoders}
    rounds = tuple(_round(r, encoders, network) for r in network.rounds)
    gates, recurrent = _gates(network, encoders["body_node"])
    steps = network.velocity_scale.repeat(3)
    cable = network.cable_decoder
    return Packed(
        encoders=encoders,
        gates=gates,
        recurrent=recurrent,
        memory_norm=network.memory_norm,
        rounds=rounds,
        node_decoder=_scaled(_layers(network.node_decoder), steps),
        cable_decoder=() if cable is None else _scaled(_layers(cable), network.winch_scale),
    )


def _layers(perceptron: Perceptron) -> tuple[Layer, ...]:
    return tuple(Layer(linear.weight.t(), linear.bias) for linear in perceptron.linears)


def _encoder(network: ChunkNetwork, graph: RobotGraph, name: str) -> Encoder:
    first, *middle, last = _layers(network.encoders[name])
    normaliser: Normaliser = network.normalisers[name]
    changing = len(normaliser.mean)
    constants = _constants(graph, name)
    weight = first.weight[:changing] / normaliser.std[:, None]
    bias = first.bias - normaliser.mean @ weight
    fixed = first.weight[changing : changing + len(constants)]
    return Encoder(
        first=Layer(torch.cat([weight, fixed]), bias),
        constants=constants,
        tail=first.weight[changing + len(constants) :],
        middle=tuple(middle),
        last=last,
        norm=network.encoder_norms[name] if network.config.layer_norm else None,
    )


def _constants(graph: RobotGraph, name: str) -> Tensor:
    """(S, M, 1) constants of one kind of node or edge."""
    if name == "body_node":
        return graph.node_constants.t()[:, :, None]
    if name in ("body", "cable"):
        return graph.relations[name].constants.t()[:, :, None]
    return graph.node_constants.new_zeros(0, 1, 1)


def _gates(network: ChunkNetwork, encoder: Encoder) -> tuple[Layer | None, Tensor | None]:
    if network.memory is None:
        return None, None
    cell = network.memory

    def order(rows: Tensor) -> Tensor:  # torch's order is input, forget, cell, output
        i, f, g, o = rows.chunk(4)
        return torch.cat([i, f, o, 2.0 * g])  # tanh(g) = 2 sigmoid(2 g) - 1

    gates = Layer(order(cell.weight_ih).t(), order(cell.bias_ih + cell.bias_hh))
    if encoder.norm is None:
        gates = encoder.last.then(gates)
    return gates, order(cell.weight_hh).t()


def _round(module: Round, encoders: dict[str, Encoder], network: ChunkNetwork) -> PackedRound:
    width, folded = network.config.width, _edges_fold(network)
    senders_receivers, biases, edges, deeper = [], [], {}, {}
    for name, message in module.messages.items():
        first, *rest = _layers(message)
        receiver, sender, edge = first.weight.split(width)
        bias = first.bias
        if folded:
            bias = bias + encoders[name].last.bias @ edge
            edge = encoders[name].last.weight @ edge
        senders_receivers += [sender, receiver]
        biases += [torch.zeros_like(bias), bias]
        edges[name], deeper[name] = edge, tuple(rest)
    first, *update = _layers(module.update)
    own, *sums = first.weight.split(width)
    return PackedRound(
        nodes=Layer(torch.cat(senders_receivers, dim=1), torch.cat(biases)),
        edges=edges,
        deeper=deeper,
        self_part=Layer(own, first.bias),
        sum_parts=dict(zip(module.messages, sums, strict=True)),
        update=tuple(update),
        norm=module.norm,
    )


def _edges_fold(network: ChunkNetwork) -> bool:
    """True if the last layer of the edge encoders can be multiplied into the messages."""
    return not network.config.edge_updates and not network.config.layer_norm


def _scaled(layers: tuple[Layer, ...], scale: Tensor) -> tuple[Layer, ...]:
    """Layers whose last one is (out, in) and (out, 1), its outputs multiplied by `scale` (out,)."""
    *hidden, last = layers
    return (*hidden, Layer(last.weight.t() * scale[:, None], (last.bias * scale)[:, None]))
