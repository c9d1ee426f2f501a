"""Initial states from a measured past: missing points filled in, bodies made rigid, velocities fitted.

Arrays are component-major with time first: (3, T, P, K).
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.features import MechanicalState
from flywheel.dynamics.gnn.rigid import Frames
from flywheel.errors import ModelError
from flywheel.robots import Robot

CARRIED = 4  # steps for which the motion of a hidden body is extrapolated; more would amplify noise


class PastReader:
    """Computes states from measured pasts of h + 1 observations.

    The LSTM is run over the starts of `warmup_chunks` past prediction chunks, placed so that the
    last of them ends at the present; the present itself follows.

    Args:
      robot: the robot.
      config: history, window of the velocity fit, LSTM warm-up.
      frames: layout of its rigid frames.
    """

    def __init__(self, robot: Robot, config: NetworkConfig, frames: Frames) -> None:
        self._robot, self._frames = robot, frames
        chunks = config.warmup_chunks if config.recurrent else 0
        last = config.history
        starts = [last - config.chunk * k for k in range(chunks, -1, -1)]
        slopes, ends = np.zeros((2, len(starts), last + 1))
        window = config.velocity_window
        times = np.arange(-window, 1) * config.dt
        line = np.linalg.pinv(np.stack([np.ones(window + 1), times], axis=1))
        for row, start in enumerate(starts):
            slopes[row, start - window : start + 1] = line[1]
            ends[row, start - window : start + 1] = line[0] if config.smooth_present else 0.0
            ends[row, start] += 0.0 if config.smooth_present else 1.0
        device = frames.to_nodes.device
        self._slopes = torch.as_tensor(slopes, dtype=torch.float32, device=device)
        self._ends = torch.as_tensor(ends, dtype=torch.float32, device=device)
        self._smooth = config.smooth_present
        self._starts = starts

    def states(self, points: Tensor, winch: Tensor) -> list[MechanicalState]:
        """The states for the warm-up, oldest first, and last the present one.

        Args:
          points: (3, h + 1, P, K) [m]; NaN where missing.
          winch: (W, K) present winch positions [m]; used in all states (the LSTM does not see
            them).

        Raises:
          ModelError: a point is missing in the whole past.
        """
        frames = self._frames.of_points(self._filled(points))
        nodes = torch.matmul(self._frames.to_nodes, frames)
        flat = nodes.flatten(2)
        shape = (3, len(self._starts), *nodes.shape[2:])
        velocities = torch.matmul(self._slopes, flat).view(shape)
        if self._smooth:
            chosen = self._frames.of_nodes(torch.matmul(self._ends, flat).view(shape))
        else:
            chosen = frames[:, self._starts]
        return [
            MechanicalState(chosen[:, i], velocities[:, i], winch) for i in range(len(self._starts))
        ]

    def _filled(self, points: Tensor) -> Tensor:
        """Missing points, moved along with the visible points of their body.

        Without any, they are interpolated linearly, as in the empty rows of a slower log; after the
        last observation the body continues its motion for a few steps.
        """
        seen = torch.isfinite(points).all(0)
        if bool(seen.all()):
            return points
        never = ~seen.any(0)
        if bool(never.any()):
            name = self._robot.points[int(never.any(1).nonzero()[0])].name
            raise ModelError(
                f"Tracked point {name!r} was not seen in the {points.shape[1]} observations of the "
                "past; a prediction needs each point at least once."
            )
        points = torch.where(seen, points, torch.zeros_like(points))
        upcoming = _upcoming(points, seen)
        filled = [upcoming[0][0]]  # missing from the start: where it is first seen
        motion, blind = torch.zeros_like(filled[0]), torch.zeros_like(points[0, 0])
        for t in range(1, points.shape[1]):
            where, steps = upcoming[t]
            together, count = self._motion(filled[-1], points[:, t], seen[t])
            blind = torch.where(count > 0, 0.0, blind + 1.0)
            alone = torch.where(blind <= CARRIED, motion, 0.0)
            alone = torch.where(torch.isinf(steps), alone, (where - filled[-1]) / (steps + 1.0))
            moved = filled[-1] + torch.where(count > 0, together, alone)
            filled.append(torch.where(seen[t], points[:, t], moved))
            motion = filled[-1] - filled[-2]
        return torch.stack(filled, dim=1)

    def _motion(self, before: Tensor, now: Tensor, seen: Tensor) -> tuple[Tensor, Tensor]:
        """(3, P, K) mean motion of the visible points of each point's body, and (P, K) their number."""
        body = self._frames.body_of_point
        same = (body[:, None] == body[None]).to(now.dtype)
        weight = seen.to(now.dtype)
        count = torch.matmul(same, weight)
        return torch.matmul(same, (now - before) * weight) / count.clamp(min=1.0), count


def _upcoming(points: Tensor, seen: Tensor) -> list[tuple[Tensor, Tensor]]:
    """At each time, the next known position of each point (3, P, K), and the steps until then (P, K).

    A point visible at that time has 0 steps, one that is never seen again infinitely many.
    """
    where, steps = points[:, -1], torch.full_like(points[0, 0], torch.inf)
    found = []
    for t in range(points.shape[1] - 1, -1, -1):
        where = torch.where(seen[t], points[:, t], where)
        steps = torch.where(seen[t], 0.0, steps + 1.0)
        found.append((where, steps))
    return found[::-1]
