"""The network's weights, shared by the fused and the plain forward pass."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

import torch
from torch import nn

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.features import Field, feature_fields
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.robots import GRAVITY, Robot

_DECODER_START = 0.1  # share of the usual size: an untrained network hardly changes a motion
_LEAST_SPREAD = 1e-3  # least scale of a feature, as a share of its natural size


class Perceptron(nn.Module):
    """Linear layers with ReLU between them.

    Args:
      inputs, width, outputs: sizes; hidden layers are `width` wide.
      layers: number of linear layers.
    """

    def __init__(self, inputs: int, width: int, outputs: int, layers: int) -> None:
        super().__init__()
        sizes = [inputs] + [width] * (layers - 1) + [outputs]
        linears = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.linears = cast("list[nn.Linear]", linears)


class Normaliser(nn.Module):
    """Mean and standard deviation of each changing feature of one kind of node or edge.

    Args:
      fields: the features.
    """

    mean: torch.Tensor
    std: torch.Tensor
    scale: torch.Tensor
    fitted: torch.Tensor

    def __init__(self, fields: tuple[Field, ...]) -> None:
        super().__init__()
        scale = torch.tensor([f.scale for f in fields for _ in range(f.width)])
        fitted = torch.tensor([f.fitted for f in fields for _ in range(f.width)])
        self.register_buffer("mean", torch.zeros_like(scale))
        self.register_buffer("std", scale.clone())
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("fitted", fitted, persistent=False)

    def fit(self, mean: torch.Tensor, std: torch.Tensor) -> None:
        """Store the measured values, except for unit vectors."""
        std = torch.maximum(std.to(self.scale), _LEAST_SPREAD * self.scale)
        self.mean.copy_(torch.where(self.fitted, mean.to(self.scale), torch.zeros_like(self.scale)))
        self.std.copy_(torch.where(self.fitted, std, self.scale))


class Round(nn.Module):
    """One round of message passing.

    With `edge_updates` the messages are perceptrons whose output is added to the edge's latent
    vector, which receivers sum. Without, a message is one linear layer and a ReLU; the layer that
    would follow it is linear and commutes with the sum, so that it is part of the update's first
    one.
    """

    def __init__(self, config: NetworkConfig, relations: list[str]) -> None:
        super().__init__()
        width = config.width
        layers = config.mlp_layers if config.edge_updates else 1
        messages = {name: Perceptron(3 * width, width, width, layers) for name in relations}
        self.messages = cast("dict[str, Perceptron]", nn.ModuleDict(messages))
        update_layers = max(config.mlp_layers, 2)
        inputs = (1 + len(relations)) * width
        self.update = Perceptron(inputs, width, width, update_layers)
        self.norm = nn.LayerNorm(width) if config.layer_norm else None


def natural_scales(robot: Robot, config: NetworkConfig) -> tuple[torch.Tensor, torch.Tensor]:
    """(n,) velocity [m/s] and winch position changes [m] since a chunk's start, before any data.

    Those of free fall, and of a winch that takes ten seconds for the length of the robot.
    """
    seconds = torch.arange(1, config.chunk + 1) * config.dt
    return GRAVITY * seconds, 0.1 * robot.length * seconds


class ChunkNetwork(nn.Module):
    """The weights of one network for one robot.

    Inputs of the encoders, in order: changing features (normalised by `normalisers`), constants of
    the graph, then the data sets' one-hot (body and anchor nodes) or controls (cable edges).

    Args:
      robot: robot of the graph.
      config: its shape.

    Attributes:
      velocity_scale: (n,) standard deviation of each step's velocity change since the chunk's
        start, the unit of the node decoder [m/s].
      winch_scale: (n,) likewise of the winch position's change [m].
    """

    velocity_scale: torch.Tensor
    winch_scale: torch.Tensor

    def __init__(self, robot: Robot, config: NetworkConfig) -> None:
        super().__init__()
        self.robot_digest, self.config = robot.digest, config
        graph = RobotGraph(robot, config)
        fields = feature_fields(robot, config)
        extra = {
            "body_node": graph.node_constants.shape[1] + config.datasets,
            "cable": graph.relations["cable"].constants.shape[1]
            + config.control_history
            + config.chunk,
        }
        if "body" in graph.relations:
            extra["body"] = graph.relations["body"].constants.shape[1]
        if graph.anchors.shape[1]:
            extra["anchor_node"] = config.datasets
        if graph.ground >= 0:
            extra |= {"ground_node": 0, "contact": 0}
        self._build(config, {name: fields[name] for name in extra}, extra, list(graph.relations))
        velocity, winch = natural_scales(robot, config)
        self.register_buffer("velocity_scale", velocity)
        self.register_buffer("winch_scale", winch)

    def _build(
        self,
        config: NetworkConfig,
        fields: dict[str, tuple[Field, ...]],
        extra: dict[str, int],
        relations: list[str],
    ) -> None:
        width, layers = config.width, config.mlp_layers
        normalisers = {name: Normaliser(f) for name, f in fields.items()}
        sizes = {name: sum(f.width for f in fs) + extra[name] for name, fs in fields.items()}
        encoders = {name: Perceptron(size, width, width, layers) for name, size in sizes.items()}
        norms = {name: nn.LayerNorm(width) for name in sizes if config.layer_norm}
        self.normalisers = cast("dict[str, Normaliser]", nn.ModuleDict(normalisers))
        self.encoders = cast("dict[str, Perceptron]", nn.ModuleDict(encoders))
        self.encoder_norms = cast("dict[str, nn.LayerNorm]", nn.ModuleDict(norms))
        self.memory = nn.LSTMCell(width, width) if config.recurrent else None
        self.memory_norm = nn.LayerNorm(width) if config.recurrent and config.layer_norm else None
        rounds = nn.ModuleList(Round(config, relations) for _ in range(config.rounds))
        self.rounds = cast("list[Round]", rounds)
        self.node_decoder = self._decoder(3 * config.chunk)
        self.cable_decoder = None if config.winch == "analytic" else self._decoder(config.chunk)

    def _decoder(self, outputs: int) -> Perceptron:
        config = self.config
        decoder = Perceptron(config.width, config.width, outputs, config.mlp_layers)
        with torch.no_grad():
            for parameter in decoder.linears[-1].parameters():
                parameter.mul_(_DECODER_START)
        return decoder

    def hidden_matrices(self) -> list[torch.Tensor]:
        """Weights (out, in) of the LSTM, of all rounds, and of the decoders but for their last layers."""
        found = [] if self.memory is None else [self.memory.weight_ih, self.memory.weight_hh]
        decoders = [self.node_decoder, self.cable_decoder]
        linears = [linear for each in decoders if each for linear in each.linears[:-1]]
        for each in self.rounds:
            for perceptron in (*each.messages.values(), each.update):
                linears += perceptron.linears
        return found + [linear.weight for linear in linears]

    @property
    def parameter_count(self) -> int:
        """Number of weights."""
        return sum(p.numel() for p in self.parameters())
