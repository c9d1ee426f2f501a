"""The training loss: deviations of predicted nodes and rest lengths from the measured ones.

The paper's loss is on the velocity changes within one prediction chunk. Here the same quantity, the
velocity of each node, and its position are compared at every step of several chunks, so that
gradients reach back through all chunks. Residuals are measured in units of the error of a
prediction without motion at that step of a chunk, times a factor that grows with the chunk's lead
time.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from flywheel.training.config import TrainingConfig


@dataclass(frozen=True)
class Truth:
    """Targets of a window's predictions. Missing values are NaN.

    Attributes:
      positions: (B, S, N, 3) of the nodes at the S = k n predicted steps [m].
      velocities: (B, S, N, 3) [m/s].
      winch: (B, S, W) winch positions [m].
    """

    positions: Tensor
    velocities: Tensor
    winch: Tensor


@dataclass(frozen=True)
class LossScales:
    """Standard deviations of the n steps of a prediction chunk from a constant-velocity guess.

    Attributes:
      velocity: (n,) of v[t + i] - v[t] [m/s].
      position: (n,) of p[t + i] - p[t] - i dt v[t] [m].
      winch: () of a winch's motion in one step [m].
    """

    velocity: Tensor
    position: Tensor
    winch: Tensor

    def to(self, device: str) -> LossScales:
        """A copy on another device."""
        return LossScales(self.velocity.to(device), self.position.to(device), self.winch.to(device))


@dataclass(frozen=True)
class Losses:
    """Scalar parts of the loss, and their weighted sum `total`."""

    velocity: Tensor
    position: Tensor
    rest: Tensor
    total: Tensor

    def __add__(self, other: Losses) -> Losses:
        return Losses(
            self.velocity + other.velocity,
            self.position + other.position,
            self.rest + other.rest,
            self.total + other.total,
        )

    def times(self, factor: float) -> Losses:
        """Every part multiplied by `factor`."""
        return Losses(
            factor * self.velocity, factor * self.position, factor * self.rest, factor * self.total
        )

    def detached(self) -> Losses:
        """The same numbers without their gradients."""
        return Losses(
            self.velocity.detach(), self.position.detach(), self.rest.detach(), self.total.detach()
        )


def residual_scales(positions: Tensor, winch: Tensor, dt: float) -> LossScales:
    """Measure the scales on windows of measured nodes.

    Args:
      positions: (B, n + 2, N, 3) [m]; the second entry is the present.
      winch: (B, n + 1, W) [m], NaN if not measured.
      dt: control step [s].
    """
    chunk = positions.shape[1] - 2
    present, ahead = positions[:, 1:2], positions[:, 2:]
    velocity = (present - positions[:, :1]) / dt
    ahead_velocity = (ahead - positions[:, 1:-1]) / dt
    lead = dt * torch.arange(1, chunk + 1, dtype=positions.dtype).view(1, -1, 1, 1)
    still = ahead - present - lead * velocity
    steps = winch.diff(dim=1)
    return LossScales(
        velocity=_spread(ahead_velocity - velocity, (0, 2, 3)).clamp(min=1e-6),
        position=_spread(still, (0, 2, 3)).clamp(min=1e-8),
        winch=_spread(steps, (0, 1, 2)).clamp(min=1e-6),
    )


def window_loss(
    positions: Tensor,
    velocities: Tensor,
    winch: Tensor,
    truth: Truth,
    scales: LossScales,
    config: TrainingConfig,
) -> Losses:
    """Compare a prediction of k chunks with the truth.

    Args:
      positions, velocities: (B, k n, N, 3) predicted nodes [m], [m/s].
      winch: (B, k n, W) predicted winch positions [m].
      truth: of the same shapes.
      scales: of the data.
      config: weights, Huber threshold and lead-time scaling.
    """
    chunk = len(scales.velocity)
    chunks = positions.shape[1] // chunk
    growth = (1.0 + torch.arange(chunks, device=positions.device)) ** config.lead_power
    speed_scale = torch.outer(growth, scales.velocity).reshape(1, -1, 1, 1)
    place_scale = torch.outer(growth**2, scales.position).reshape(1, -1, 1, 1)
    way_scale = (growth * scales.winch).repeat_interleave(chunk).reshape(1, -1, 1)
    velocity = _huber(velocities, truth.velocities, speed_scale, config.huber)
    position = _huber(positions, truth.positions, place_scale, config.huber)
    rest = _huber(winch, truth.winch, way_scale, config.huber)
    total = (
        config.velocity_weight * velocity
        + config.position_weight * position
        + config.rest_weight * rest
    )
    return Losses(velocity, position, rest, total)


def _huber(predicted: Tensor, truth: Tensor, scale: Tensor, threshold: float) -> Tensor:
    """Mean of r^2 over the present truth, linear beyond the threshold; 0 for none.

    A non-finite prediction is never hidden: it makes the loss non-finite.
    """
    present = torch.isfinite(truth)
    size = ((predicted - torch.where(present, truth, predicted)) / scale).abs()
    inside = size.clamp(max=threshold)
    return (inside * (2.0 * size - inside)).sum() / present.sum().clamp(min=1)


def _spread(values: Tensor, axes: tuple[int, ...]) -> Tensor:
    """Root mean square of present values; 0 for none."""
    present = torch.isfinite(values)
    squares = torch.where(present, values, 0.0).double() ** 2
    mean = squares.sum(dim=axes) / present.sum(dim=axes).clamp(min=1)
    return mean.sqrt().to(values.dtype)
