"""The forward pass of the default architecture on the processor, with its hand-written adjoint.

It computes what `FusedForward` computes, from the same packed weights: a few large matrix products, and
compiled kernels between them. Nothing but the activations is kept for the adjoint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.arithmetic import Precision
from flywheel.dynamics.gnn.features import GraphFeatures
from flywheel.dynamics.gnn.fused import FusedForward
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.gnn.kernels import network as kernels
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.packed import Encoder, Layer, Packed
from flywheel.dynamics.gnn.prediction import Forward, Memory, Prediction

Weights = dict[str, Tensor]
_NONE = np.zeros((0, 1, 1), np.float32)
# How the names of matrices end that act on latent vectors.
_HIDDEN = ("gates", "recurrent", "messages", "parts", "sums", "update", "decoder 0")


class _Products:
    """Matrix products of the hidden layers.

    Args:
      precision: of the factors and of the products; sums are taken in float32. "auto" is bfloat16 where
        the processor has instructions for it.
    """

    def __init__(self, precision: Precision) -> None:
        able = torch.cpu.get_capabilities()
        fast = able.get("avx512_bf16", False) or able.get("amx_bf16", False)
        self.rounds = precision == "bfloat16" or (precision == "auto" and bool(fast))

    def factor(self, x: Tensor) -> Tensor:
        """A factor in the precision of products."""
        return x.bfloat16() if self.rounds else x

    def __call__(self, a: Tensor, b: Tensor) -> Tensor:
        """The product of two matrices."""
        return torch.mm(self.factor(a), self.factor(b)).float()

    def plus(self, bias: Tensor, a: Tensor, b: Tensor) -> Tensor:
        """The product of two matrices and a bias."""
        return self(a, b).add_(bias) if self.rounds else torch.addmm(bias, a, b)

    def adjoint(
        self, grown: Weights, weights: Weights, name: str, rows: Tensor, g: Tensor
    ) -> Tensor:
        """Gradient of a layer's input `rows`, from that of its output; its weights' goes into `grown`."""
        if f"{name} bias" in weights:
            grown[f"{name} bias"] = g.sum(0)
        g = self.factor(g)
        grown[name] = self(rows.t(), g)
        return self(g, weights[name].t())


def prepared(network: ChunkNetwork, graph: RobotGraph, precision: Precision = "float32") -> Forward:
    """A network's forward pass: compiled for the default architecture on the processor.

    Args:
      network, graph: see `CompiledForward`.
      precision: of the compiled pass's products.
    """
    config = network.config
    lean = config.recurrent and config.mlp_layers == 2
    lean = lean and not config.edge_updates and not config.layer_norm
    if lean and graph.device.type == "cpu":
        return CompiledForward(network, graph, precision)
    return FusedForward(network, graph)


@dataclass(frozen=True)
class _Relation:
    """Constants of a relation's messages, see `kernels.pass_messages`.

    Attributes:
      receivers: (E,) the edges' receivers.
      which: (E,) winch whose controls an edge shows, -1 for none.
    """

    name: str
    starts: Any
    stops: Any
    senders: Any
    node: Any
    which: Any
    receivers: Tensor

    def upto(self, receivers: int) -> tuple[Any, ...]:
        """Arguments of `pass_messages` for the first receivers."""
        return self.starts[:receivers], self.stops[:receivers], self.senders, self.node


def _relations(graph: RobotGraph) -> tuple[_Relation, ...]:
    found = []
    for name, relation in graph.relations.items():
        to = relation.receivers
        here = [(to == m).nonzero()[:, 0] for m in range(graph.count)]
        winch = torch.where(graph.cable_winch < len(graph.robot.winches), graph.cable_winch, -1)
        none = torch.full_like(to, -1)
        found.append(
            _Relation(
                name=name,
                starts=np.array([int(e[0]) if len(e) else 0 for e in here]),
                stops=np.array([int(e[-1]) + 1 if len(e) else 0 for e in here]),
                senders=relation.senders.numpy(),
                node=(relation.origin % graph.contact_count if name == "contact" else none).numpy(),
                which=(winch if name == "cable" else none).numpy(),
                receivers=to,
            )
        )
    return tuple(found)


class CompiledForward:
    """Computes one network of the default architecture on one graph; see `FusedForward`.

    Args:
      network: the weights; packed here, so that later changes have no effect.
      graph: of the network's robot.
      precision: of the factors of matrix products, which are summed in float32. Encoders' first layers
        see lengths beside millimetres, and stay float32.
    """

    def __init__(
        self, network: ChunkNetwork, graph: RobotGraph, precision: Precision = "float32"
    ) -> None:
        self.products = _Products(precision)
        self._fused = FusedForward(network, graph)
        self.graph, self.config = graph, network.config
        self.relations = graph.cached("compiled relations", _relations)
        packed = self._fused.packed
        self._tail = packed.encoders["body_node"].tail
        self._shown, self._bias = _first(packed.encoders["body_node"])
        self._dataset: tuple[Tensor, Tensor] | None = None
        self._weights = _weights(packed, self.relations)
        self.factors: Weights = {}
        if self.products.rounds:
            hidden = {n: w for n, w in self._weights.items() if n.endswith(_HIDDEN)}
            self.factors = {n: w.detach().bfloat16() for n, w in hidden.items()}

    def warm_up(self, nodes: Tensor, dataset: Tensor, memory: Memory | None) -> Memory | None:
        """Run only the LSTM over features of the body nodes (F, N, K)."""
        return self._fused.warm_up(nodes, dataset, memory)

    def __call__(self, features: GraphFeatures, memory: Memory | None) -> Prediction:
        """Predict one chunk."""
        weights = {
            "nodes": self._shown,
            "nodes bias": self._node_bias(features.dataset),
            **self._weights,
        }
        hidden, cell = memory if memory is not None else (None, None)
        velocity, winch, *memory_after = _Chunk.apply(
            self,
            tuple(weights),
            features.touching,
            features.nodes["body_node"],
            self._fused.still(features),
            features.controls.contiguous(),
            hidden,
            cell,
            *(features.edges[relation.name] for relation in self.relations),
            *weights.values(),
        )
        return Prediction(velocity, winch, (memory_after[0], memory_after[1]))

    def _node_bias(self, dataset: Tensor) -> Tensor:
        """(N, K, H) or (N, 1, H): of the node encoder, with the data set's part; the same for all chunks."""
        known = self._dataset
        if known is None or known[0] is not dataset:
            bias = self._bias + self._tail[dataset]
            known = dataset, bias.expand(self.graph.body_count, -1, -1).contiguous()
            self._dataset = known
        return known[1]


def _first(encoder: Encoder) -> tuple[Tensor, Tensor]:
    """Weights of an encoder's changing features, and (M, 1, H) or (1, 1, H) the bias with its constants."""
    changing = len(encoder.first.weight) - len(encoder.constants)
    bias = encoder.first.bias.view(1, 1, -1)
    if len(encoder.constants):
        fixed = encoder.constants[:, :, 0].t() @ encoder.first.weight[changing:]
        bias = bias + fixed[:, None]
    return encoder.first.weight[:changing], bias


def _weights(packed: Packed, relations: tuple[_Relation, ...]) -> Weights:
    """All weights that one chunk needs but the node encoder's, by name."""

    def both(name: str, layer: Layer | None) -> Weights:
        return {} if layer is None else {name: layer.weight, f"{name} bias": layer.bias}

    assert packed.recurrent is not None
    weights = {**both("gates", packed.gates), "recurrent": packed.recurrent}
    for relation in relations:
        name = relation.name
        shown, bias = _first(packed.encoders[name])
        bias = bias.expand(len(relation.senders), -1, -1).contiguous()
        edges = torch.cat([each.edges[name] for each in packed.rounds], dim=1)
        weights |= {name: shown, f"{name} bias": bias, f"{name} messages": edges}
    weights["controls"] = packed.encoders["cable"].tail
    for number, each in enumerate(packed.rounds):
        sums = [each.sum_parts[relation.name] for relation in relations]
        weights |= both(f"{number} parts", each.nodes)
        own = torch.cat([each.self_part.weight, *sums])
        weights |= both(f"{number} sums", Layer(own, each.self_part.bias))
        weights |= both(f"{number} update", each.update[0])
    for name, layers in (("node", packed.node_decoder), ("winch", packed.cable_decoder)):
        for i, layer in enumerate(layers):
            weights |= both(f"{name} decoder {i}", layer)
    return weights


# --- one chunk ----------------------------------------------------------------------------------


@dataclass
class _Tape:
    """Values of one chunk that its adjoint needs.

    Attributes:
      touching, shown, controls, edges: inputs.
      hidden, cell: memory before.
      encoded: (N K, H) activated node encoder.
      gates, tanh: of the LSTM.
      messages: per relation (E, K, L, H).
      edge_codes: per relation (E K, H) activated edge encoder; `edge_factors` in products' precision.
      nodes: (M, K, H) latent vectors before each round, and after the last one.
      factors: the nodes (M K, H) in products' precision.
      gathered, updated: per round (m K, (1 + R) H) and (m K, H).
      decoded, wound, averaged: activations of the decoders.
    """

    touching: Tensor
    shown: Tensor
    controls: Tensor
    edges: tuple[Tensor, ...]
    hidden: Tensor | None
    cell: Tensor
    encoded: Tensor
    gates: Tensor
    tanh: Tensor
    nodes: list[Tensor]
    edge_codes: list[Tensor]
    edge_factors: list[Tensor]
    messages: list[Tensor]
    factors: list[Tensor]
    gathered: list[Tensor]
    updated: list[Tensor]
    decoded: Tensor | None = None
    wound: Tensor | None = None
    averaged: Tensor | None = None


class _Chunk(torch.autograd.Function):
    """Velocity changes, winch changes and memory after one chunk, from features, memory and weights."""

    @staticmethod
    def forward(
        ctx: Any,
        net: CompiledForward,
        names: tuple[str, ...],
        touching: Tensor,
        shown: Tensor,
        still: Tensor | None,
        controls: Tensor,
        hidden: Tensor | None,
        cell: Tensor | None,
        *rest: Tensor,
    ) -> tuple[Tensor | None, ...]:
        count = len(net.relations)
        edges, weights = rest[:count], dict(zip(names, rest[count:], strict=True)) | net.factors
        (_, nodes, samples), width = shown.shape, net.config.width
        encoded = torch.mm(shown.flatten(1).t(), weights["nodes"])
        _activate(encoded.view(nodes, samples, width), weights["nodes bias"])
        gates = net.products.plus(weights["gates bias"], encoded, weights["gates"])
        if hidden is not None:
            gates = net.products.plus(gates, hidden, weights["recurrent"])
        gates.sigmoid_()
        before = torch.zeros_like(encoded) if cell is None else cell
        after = torch.empty_like(encoded)
        kernels.remember(gates.numpy(), before.numpy(), after.numpy())
        tanh = after.tanh()
        said = gates[:, 2 * width : 3 * width] * tanh
        latent = said.view(nodes, samples, width)
        latent = latent if still is None else torch.cat([latent, still])
        tape = _Tape(
            touching,
            shown,
            controls,
            edges,
            hidden,
            before,
            encoded,
            gates,
            tanh,
            [latent],
            [],
            [],
            [],
            [],
            [],
            [],
        )
        _encode_edges(net, tape, weights)
        for number in range(net.config.rounds):
            _pass(net, tape, weights, number)
        velocity, winch = _decode(net, tape, weights)
        ctx.net, ctx.names, ctx.weights, ctx.tape = net, names, weights, tape
        ctx.remembers, ctx.stands = cell is not None, still is not None
        ctx.set_materialize_grads(False)
        return velocity, winch, said, after

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        net, weights, tape = ctx.net, ctx.weights, ctx.tape
        ctx.tape = None  # the messages are overwritten here
        g_velocity, g_winch, g_said, g_after = gradients
        rows, width = tape.encoded.shape
        grown: Weights = {}
        g_nodes, g_messages = _decode_adjoint(net, tape, weights, g_velocity, g_winch, grown)
        for number in reversed(range(net.config.rounds)):
            g_nodes = _pass_adjoint(net, tape, weights, number, g_nodes, g_messages, grown)
        g_hidden = g_nodes[:rows] if g_said is None else g_nodes[:rows] + g_said
        g_after = torch.zeros_like(tape.cell) if g_after is None else g_after.contiguous()
        g_gates, g_cell = torch.empty_like(tape.gates), torch.empty_like(tape.cell)
        kernels.remember_adjoint(
            *(
                x.numpy()
                for x in (tape.gates, tape.cell, tape.tanh, g_hidden.contiguous(), g_after)
            ),
            g_gates.numpy(),
            g_cell.numpy(),
        )
        g_before, adjoint = None, net.products.adjoint
        if tape.hidden is not None:
            g_before = adjoint(grown, weights, "recurrent", tape.hidden, g_gates)
        nodes, samples = tape.shown.shape[1:]
        g_encoded = adjoint(grown, weights, "gates", tape.encoded, g_gates)
        g_encoded = g_encoded.view(nodes, samples, width)
        g_shown = _encoder_adjoint(grown, "nodes", weights, tape.shown, tape.encoded, g_encoded)
        g_still = g_nodes[rows:].view(-1, samples, width) if ctx.stands else None
        g_controls, g_edges = _edges_adjoint(net, tape, weights, grown)
        g_weights = (grown.get(name) for name in ctx.names)
        g_memory = g_before, g_cell if ctx.remembers else None
        return None, None, None, g_shown, g_still, g_controls, *g_memory, *g_edges, *g_weights


def _activate(x: Tensor, bias: Tensor, driven: Tensor | None = None, which: Any = None) -> None:
    """`kernels.activate`, in place of x (M, K, H)."""
    which = np.full(len(x), -1) if which is None else which
    kernels.activate(bias.numpy(), _NONE if driven is None else driven.numpy(), which, x.numpy())


def _through(activated: Tensor, gradient: Tensor) -> Tensor:
    """The gradient (R, H) before an activation, in place."""
    kernels.activate_adjoint(activated[None].numpy(), gradient[None].numpy())
    return gradient


def _encoder_adjoint(
    grown: Weights,
    name: str,
    weights: Weights,
    shown: Tensor,
    code: Tensor,
    gradient: Tensor,
) -> Tensor:
    """Gradient of features (F, M, K), from that of the activated (M, K, H), which is overwritten."""
    kernels.activate_adjoint(code.view_as(gradient).numpy(), gradient.numpy())
    alike = weights[f"{name} bias"].shape[1] == 1
    grown[f"{name} bias"] = gradient.sum(1, keepdim=True) if alike else gradient
    flat = gradient.view(-1, gradient.shape[-1])
    grown[name] = shown.flatten(1) @ flat
    return (weights[name] @ flat.t()).view_as(shown)


def _encode_edges(net: CompiledForward, tape: _Tape, weights: Weights) -> None:
    samples, width = tape.touching.shape[1], net.config.width
    for relation, shown in zip(net.relations, tape.edges, strict=True):
        name, driven = relation.name, None
        code = torch.mm(shown.flatten(1).t(), weights[name])
        if name == "cable":
            driven = torch.mm(tape.controls.flatten(0, 1), weights["controls"])
            driven = driven.view(-1, samples, width)
        _activate(code.view(-1, samples, width), weights[f"{name} bias"], driven, relation.which)
        tape.edge_codes.append(code)
        factor = net.products.factor(code)
        tape.edge_factors.append(factor)
        messages = net.products(factor, weights[f"{name} messages"])
        tape.messages.append(messages.view(-1, samples, net.config.rounds, width))


def _edges_adjoint(
    net: CompiledForward, tape: _Tape, weights: Weights, grown: Weights
) -> tuple[Tensor, list[Tensor]]:
    """Gradients of the controls, and of each relation's features."""
    samples, width = tape.touching.shape[1], net.config.width
    found = []
    for i, relation in enumerate(net.relations):
        name, code = relation.name, tape.edge_codes[i]
        g_messages = tape.messages[i].view(len(code), -1)
        rows = tape.edge_factors[i]
        g_code = net.products.adjoint(grown, weights, f"{name} messages", rows, g_messages)
        g_code = g_code.view(-1, samples, width)
        found.append(_encoder_adjoint(grown, name, weights, tape.edges[i], code, g_code))
        if name == "cable":
            driven = torch.zeros(len(tape.controls) + 1, samples, width)
            driven.index_add_(0, net.graph.cable_winch, g_code)
            flat = driven[:-1].reshape(-1, width)
            grown["controls"] = tape.controls.flatten(0, 1).t() @ flat
            g_controls = (flat @ weights["controls"].t()).view_as(tape.controls)
    return g_controls, found


def _receivers(net: CompiledForward, relation: _Relation, final: bool) -> int:
    """Number of nodes that need a relation's messages; after the last round, only cables end elsewhere."""
    return net.graph.body_count if final and relation.name != "cable" else net.graph.count


def _pass(net: CompiledForward, tape: _Tape, weights: Weights, number: int) -> None:
    """One round of message passing."""
    before, width, count = tape.nodes[-1], net.config.width, len(net.relations)
    samples, final = before.shape[1], number == net.config.rounds - 1
    updated = net.graph.body_count if final else net.graph.count
    tape.factors.append(net.products.factor(before.view(-1, width)))
    parts = _linear(net, tape.factors[-1], weights, f"{number} parts")
    parts = parts.view(len(before), samples, 2 * count, width)
    gathered = torch.empty(updated, samples, 1 + count, width)
    gathered[:, :, 0] = before[:updated]
    for i, relation in enumerate(net.relations):
        kernels.pass_messages(
            *relation.upto(_receivers(net, relation, final)),
            tape.touching.numpy(),
            parts.numpy(),
            2 * i,
            tape.messages[i].numpy(),
            number,
            gathered.numpy(),
            1 + i,
        )
    gathered = net.products.factor(gathered.view(updated * samples, -1))
    activated = _linear(net, gathered, weights, f"{number} sums").relu_()
    after = _linear(net, activated, weights, f"{number} update")
    after += before[:updated].view(-1, width)
    tape.nodes.append(after.view(updated, samples, width))
    tape.gathered.append(gathered)
    tape.updated.append(activated)


def _pass_adjoint(
    net: CompiledForward,
    tape: _Tape,
    weights: Weights,
    number: int,
    g_after: Tensor,
    g_messages: Any,
    grown: Weights,
) -> Tensor:
    """(M K, H) gradient of the nodes before a round; the messages become their edges' gradients."""
    before, width, count = tape.nodes[number], net.config.width, len(net.relations)
    samples, final = before.shape[1], number == net.config.rounds - 1
    rows = len(g_after)
    activated, gathered = tape.updated[number], tape.gathered[number]
    adjoint = net.products.adjoint
    g_sums = _through(activated, adjoint(grown, weights, f"{number} update", activated, g_after))
    g_gathered = adjoint(grown, weights, f"{number} sums", gathered, g_sums)
    g_gathered = g_gathered.view(-1, samples, 1 + count, width)
    g_parts = torch.zeros(len(before), samples, 2 * count, width)
    for i, relation in enumerate(net.relations):
        needed = _receivers(net, relation, final)
        if needed < len(before):
            tape.messages[i][relation.receivers >= needed, :, number] = 0.0
        kernels.pass_messages_adjoint(
            *relation.upto(needed),
            tape.touching.numpy(),
            g_messages if final and relation.name == "cable" else _NONE,
            2 * i,
            tape.messages[i].numpy(),
            number,
            g_gathered.numpy(),
            1 + i,
            g_parts.numpy(),
        )
    flat = g_parts.view(len(before) * samples, -1)
    g_before = adjoint(grown, weights, f"{number} parts", tape.factors[number], flat)
    g_before[:rows] += g_after
    g_before[:rows].view(-1, samples, width).add_(g_gathered[:, :, 0])
    return g_before


def _linear(net: CompiledForward, rows: Tensor, weights: Weights, name: str) -> Tensor:
    return net.products.plus(weights[f"{name} bias"], rows, weights[name])


def _decode(net: CompiledForward, tape: _Tape, weights: Weights) -> tuple[Tensor, Tensor | None]:
    """(3, n, N, K) velocity changes [m/s], and (n, W, K) winch changes [m] if they are learned."""
    steps, nodes, samples = net.config.chunk, *tape.shown.shape[1:]
    width = net.config.width
    tape.decoded = _linear(net, tape.nodes[-1].view(-1, width), weights, "node decoder 0").relu_()
    velocity = _across(tape.decoded, weights, "node decoder 1").view(3, steps, nodes, samples)
    if "winch decoder 0" not in weights:
        return velocity, None
    tape.wound = _linear(net, _last_messages(net, tape), weights, "winch decoder 0").relu_()
    average = net.graph.winch_average
    tape.averaged = (average @ tape.wound.view(average.shape[1], -1)).view(-1, width)
    winch = _across(tape.averaged, weights, "winch decoder 1")
    return velocity, winch.view(steps, -1, samples)


def _across(rows: Tensor, weights: Weights, name: str) -> Tensor:
    """(out, rows): a last layer, which is transposed."""
    return torch.addmm(weights[f"{name} bias"], weights[name], rows.t())


def _last_messages(net: CompiledForward, tape: _Tape) -> Tensor:
    """(E K, H) messages of the cables in the last round."""
    place = next(i for i, relation in enumerate(net.relations) if relation.name == "cable")
    return tape.messages[place][:, :, -1].reshape(-1, net.config.width)


def _decode_adjoint(
    net: CompiledForward,
    tape: _Tape,
    weights: Weights,
    g_velocity: Tensor | None,
    g_winch: Tensor | None,
    grown: Weights,
) -> tuple[Tensor, Any]:
    """(N K, H) gradient of the decoded nodes, and (E, K, H) of the cables' last messages."""
    samples, width = tape.touching.shape[1], net.config.width
    g_nodes, g_messages = torch.zeros_like(tape.encoded), _NONE
    if g_velocity is not None:
        assert tape.decoded is not None
        g = _across_adjoint(grown, "node decoder 1", weights, tape.decoded, g_velocity)
        g = _through(tape.decoded, g)
        rows = tape.nodes[-1].view(-1, width)
        g_nodes = net.products.adjoint(grown, weights, "node decoder 0", rows, g)
    if g_winch is not None:
        assert tape.wound is not None and tape.averaged is not None
        g = _across_adjoint(grown, "winch decoder 1", weights, tape.averaged, g_winch)
        average = net.graph.winch_average
        g = (average.t() @ g.view(len(average), -1)).view(-1, width)
        g = _through(tape.wound, g)
        rows = _last_messages(net, tape)
        g = net.products.adjoint(grown, weights, "winch decoder 0", rows, g)
        g_messages = g.view(-1, samples, width).numpy()
    return g_nodes, g_messages


def _across_adjoint(
    grown: Weights,
    name: str,
    weights: Weights,
    rows: Tensor,
    gradient: Tensor,
) -> Tensor:
    """Gradient of the rows that a last layer was given."""
    flat = gradient.reshape(len(weights[name]), -1)
    grown[name], grown[f"{name} bias"] = flat @ rows, flat.sum(1, keepdim=True)
    return flat.t() @ weights[name]
