"""Measurement, on training data, of the scales of the network's inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from flywheel.dynamics.gnn.batch import Batch
from flywheel.dynamics.gnn.features import GraphFeatures, MechanicalState
from flywheel.dynamics.gnn.network import ChunkNetwork, natural_scales
from flywheel.dynamics.gnn.prediction import Start
from flywheel.dynamics.gnn.simulator import Simulator
from flywheel.errors import DataError, ModelError

_LEAST = 1e-3  # least scale of an output, as a share of its natural size
_WIDER = 2.0  # growth of an output's size from which a trained network is rescaled


class _Moments:
    """Running mean and variance of the rows of arrays (F, ...), in float64; NaN is ignored."""

    def __init__(self) -> None:
        self._count: Tensor | float = 0.0
        self._sum: Tensor | float = 0.0
        self._squares: Tensor | float = 0.0

    def add(self, values: Tensor) -> None:
        flat = values.detach().double().flatten(1).cpu()
        present = torch.isfinite(flat)
        flat = torch.where(present, flat, torch.zeros_like(flat))
        self._count = self._count + present.sum(1)
        self._sum = self._sum + flat.sum(1)
        self._squares = self._squares + (flat * flat).sum(1)

    def mean_std(self) -> tuple[Tensor, Tensor]:
        count = torch.as_tensor(self._count).clamp(min=1)
        mean = self._sum / count
        return mean, (self._squares / count - mean * mean).clamp(min=0.0).sqrt()

    def size(self, natural: Tensor, without: float = 1.0) -> Tensor:
        """Root mean square, at least a small part of the natural size; without data `without` times
        that.
        """
        count = torch.as_tensor(self._count)
        size = (self._squares / count.clamp(min=1)).sqrt().to(natural)
        found = torch.maximum(size, _LEAST * natural)
        return torch.where(count.to(natural) > 0, found, without * natural)


@torch.no_grad()
def fit_normalisation(
    simulator: Simulator, network: ChunkNetwork, batches: Iterable[Batch]
) -> None:
    """Set the network's normalisation from training windows of at least one prediction chunk.

    Features get their mean and standard deviation at the windows' presents; outputs the root mean
    square of the changes that they predict.

    Args:
      simulator: of the network's robot.
      network: its buffers are set.
      batches: training windows.

    Raises:
      DataError: there is no window, or one shorter than a chunk.
      ModelError: the features are not finite.
    """
    features: dict[str, _Moments] = {name: _Moments() for name in network.normalisers}
    velocity, winch = _Moments(), _Moments()
    count = 0
    for batch in batches:
        count += len(batch.controls)
        start = simulator.start(
            batch.past_points, batch.past_controls, batch.past_winch, batch.ground
        )
        state = simulator.pushed(start.states[-1], start.origin)
        shown = _features(simulator, batch, start, state)
        for name, values in {**shown.nodes, **shown.edges}.items():
            features[name].add(values)
        analytic = (state.velocities - start.states[-1].velocities).permute(2, 1, 0)
        velocity.add(_velocity_changes(simulator, batch) - analytic)
        winch.add(_winch_changes(simulator, batch))
    if count == 0:
        raise DataError("There is no training window to fit the normalisation to.")
    for name, normaliser in network.normalisers.items():
        mean, std = features[name].mean_std()
        if not torch.isfinite(mean).all():
            raise ModelError(f"The training windows give {name} features that are not finite.")
        normaliser.fit(mean, std)
    natural = natural_scales(simulator.robot, network.config)
    network.velocity_scale.copy_(velocity.size(natural[0]))
    network.winch_scale.copy_(winch.size(natural[1]))


@torch.no_grad()
def widen_winches(simulator: Simulator, network: ChunkNetwork, batches: Iterable[Batch]) -> None:
    """Give a trained network larger units for its winches, if new data require it.

    Its predictions do not change. If winches had followed their commands, there was next to nothing
    to correct, and the cable decoder's units are equally small. A winch that slows down under load
    deviates by hundreds of these units, which fine-tuning cannot reach. Without winch truth nothing
    is changed.

    Args:
      simulator: of the network's robot.
      network: to be trained further.
      batches: training windows of at least one prediction chunk.
    """
    if network.cable_decoder is None:
        return
    winch = _Moments()
    for batch in batches:
        winch.add(_winch_changes(simulator, batch))
    _, natural = natural_scales(simulator.robot, network.config)
    before, wanted = network.winch_scale.clone(), winch.size(natural, without=0.0)
    network.winch_scale.copy_(torch.where(wanted > _WIDER * before, wanted, before))
    share, last = before / network.winch_scale, network.cable_decoder.linears[-1]
    last.weight.mul_(share[:, None])
    last.bias.mul_(share)


def _features(
    simulator: Simulator, batch: Batch, start: Start, state: MechanicalState
) -> GraphFeatures:
    parts, config = simulator.parts(batch.controls.device), simulator.config
    controls = batch.controls.new_zeros(
        len(simulator.robot.winches), len(batch.controls), config.control_history + config.chunk
    )  # controls are in units of their range already
    heading = parts.builder.heading(state)
    return parts.builder(state, start.origin, heading, controls, batch.dataset, start.ground)


def _velocity_changes(simulator: Simulator, batch: Batch) -> Tensor:
    """(n, ...) velocity changes of the nodes since the present, by backward differences [m/s]."""
    steps = simulator.config.chunk
    if batch.points.shape[1] < steps + 2:
        raise DataError(
            f"Normalisation needs windows of {steps} steps after the present, got "
            f"{batch.points.shape[1] - 2}."
        )
    nodes = simulator.node_positions(batch.points[:, : steps + 2])
    velocities = nodes.diff(dim=1) / simulator.dt
    return (velocities[:, 1:] - velocities[:, :1]).transpose(0, 1)


def _winch_changes(simulator: Simulator, batch: Batch) -> Tensor:
    """(n, ...) changes of the winch positions since the present, beyond the nominal if that is
    given [m].
    """
    steps = simulator.config.chunk
    winches = simulator.parts(batch.controls.device).winches
    commands = winches.clipped(batch.controls[:, :steps].permute(1, 2, 0))
    past = batch.past_winch.permute(1, 2, 0)
    present = winches.present(past, winches.clipped(batch.past_controls.permute(1, 2, 0)))
    reached = batch.winch[:, :steps].permute(1, 2, 0)
    if simulator.config.winch == "learned":
        return reached - present
    return reached - winches.nominal(present, commands)
