"""A plant and its correcting network, as one dynamics model."""

from __future__ import annotations

import copy
import dataclasses
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import torch

from flywheel.dynamics.plant import RestartedPlant
from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.motion import Knots, Units, knots_of
from flywheel.dynamics.residual.network import ResidualNetwork, displaced
from flywheel.dynamics.threads import one_thread_per_operation, shares
from flywheel.effects import Scales
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, Past, Rollout, Trajectory
from flywheel.robots import Robot
from flywheel.rotations import rotate

BLOCK = 64  # motions that are corrected at a time, so that a block's arrays stay in the cache


@dataclass(frozen=True)
class Sight:
    """Inputs of the network.

    Attributes:
      past: the plant's motion up to the present, with the measurements; None for none.
      ahead: the plant's motion from the present on.
    """

    past: Knots | None
    ahead: Knots

    def __getitem__(self, rows: slice | torch.Tensor) -> Sight:
        """Some of the motions; a past common to all stays so."""
        past = self.past
        if past is not None and len(past) == len(self.ahead):
            past = past[rows]
        return Sight(past, self.ahead[rows])


@dataclass(frozen=True)
class Lookout:
    """Simulates the plant, and prepares the network's inputs.

    Attributes:
      plant: corrected plant.
      config: of the inputs.
    """

    plant: RestartedPlant
    config: ResidualConfig

    @property
    def robot(self) -> Robot:
        return self.plant.robot

    @cached_property
    def every(self) -> int:
        """Control steps between two knots."""
        return self.config.every(self.robot, self.plant.dt)

    @property
    def back(self) -> int:
        """Control steps in the past."""
        return self.config.past_knots() * self.every

    @property
    def history(self) -> int:
        """Past steps that a prediction needs."""
        return self.back + self.plant.history

    @cached_property
    def units(self) -> Units:
        """The robot's."""
        return Units(self.robot.length, Scales.of(self.robot).time)

    def look(self, past: Past, controls: Floats) -> tuple[Sight, Trajectory]:
        """The plant's motion (B, T) under controls (B, T, W), with T a multiple of `every`.

        Raises:
          ModelError: see `RestartedPlant.rollout`.
        """
        past = past.latest(self.history, self.robot.holding(past.winch[:, 0]))
        motion = self.plant.motion(past, controls)
        show = partial(knots_of, self.robot, self.units, every=self.every, terrains=past.terrains)
        return Sight(self._behind(past, show) if self.back else None, show(motion=motion)), motion

    def _behind(self, past: Past, show: partial[Knots]) -> Knots:
        """The plant, started before the present, with the measurements from there on."""
        cut = past.history - self.back
        seen = past.observations
        points = _sighted(seen.points)
        earlier = dataclasses.replace(
            past,
            observations=Observation(points[:, : cut + 1], seen.winch[:, : cut + 1]),
            controls=past.controls[:, :cut],
            winch=past.winch[:, : cut + 1],
            state=None,
        )
        motion = self.plant.motion(earlier, past.controls[:, cut:])
        return show(motion=motion, measured=seen.points[:, cut:])


class ResidualDynamics:
    """A plant whose predicted motion a network corrects; implements
    `flywheel.dynamics.protocol.Dynamics`.

    The bodies of the plant are shifted and rotated, so they stay rigid. Winch positions are the
    plant's. With an untrained network, or a share of 0, the points equal the plant's, bit by bit.

    Args:
      plant: corrected plant.
      network: its weights; copied, later changes have no effect.
      share: applied fraction of the correction, from 0 to 1.
      threads: Python threads that share the batch in the network's part.

    Attributes:
      plant, network, share: as given, with a copy of the network.

    Raises:
      ModelError: the network was made for another robot.
    """

    def __init__(
        self, plant: RestartedPlant, network: ResidualNetwork, share: float = 1.0, threads: int = 1
    ) -> None:
        if network.robot_digest != plant.robot.digest:
            raise ModelError(
                f"The network corrects the plant of robot {network.robot_digest[:12]}, not that of "
                f"{plant.robot.name} ({plant.robot.digest[:12]})."
            )
        self.plant, self.share, self._threads = plant, share, threads
        self.network = copy.deepcopy(network).requires_grad_(False)
        self._lookout = Lookout(plant, network.config)

    @property
    def robot(self) -> Robot:
        return self.plant.robot

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def history(self) -> int:
        return self._lookout.history

    @cached_property
    def _pool(self) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(self._threads, "residual", torch.set_num_threads, (1,))

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: a point is missing in the whole past, shapes do not fit, or a prediction is
            not finite.
        """
        controls = np.asarray(controls, float)
        steps, every = controls.shape[1] if controls.ndim == 3 else 0, self._lookout.every
        if steps and steps % every:
            rest = np.repeat(controls[:, -1:], -steps % every, axis=1)
            controls = np.concatenate([controls, rest], axis=1)
        sight, motion = self._lookout.look(past, controls)
        batch = len(motion.controls)
        with one_thread_per_operation():
            blocks = shares(batch, BLOCK, self._threads)
            run = partial(self._correction, sight, motion)
            alone = self._threads == 1 or len(blocks) == 1
            parts = list(map(run, blocks) if alone else self._pool.map(run, blocks))
        seen = motion.observations
        points = seen.points + np.concatenate(parts)
        if not np.isfinite(points).all():
            raise ModelError("The network's correction of the plant is not finite.")
        return Rollout(points[:, : steps + 1], seen.winch[:, : steps + 1])

    @torch.inference_mode()
    def _correction(self, sight: Sight, motion: Trajectory, rows: slice) -> Floats:
        """(b, T + 1, P, 3) displacements of the points of some motions [m]."""
        some, every, length = sight[rows], self._lookout.every, self.robot.length
        shift, turn = self.network(some.past, some.ahead)
        states = motion.states
        assert states is not None
        bodies = [point.body for point in self.robot.points]
        points = motion.observations.points[rows]
        qpos = states.qpos[rows].reshape(*points.shape[:2], len(self.robot.bodies), -1)
        com = np.array([body.com for body in self.robot.bodies])
        centers = qpos[..., :3] + rotate(qpos[..., 3:], com)
        arms = torch.from_numpy(points - centers[:, :, bodies])
        moved = displaced(
            arms,
            self.share * length * between(shift, every)[:, :, bodies],
            self.share * between(turn, every)[:, :, bodies],
        )
        return moved.numpy()


def between(knots: torch.Tensor, every: int) -> torch.Tensor:
    """(B, T + 1, ...) in double precision, linear between knots (B, K, ...)."""
    values = knots.double()
    share = torch.arange(every, dtype=torch.float64) / every
    share = share.view(1, 1, every, *(1,) * (values.ndim - 2))
    lines = values[:, :-1, None] + share * (values[:, 1:] - values[:, :-1])[:, :, None]
    return torch.cat([lines.flatten(1, 2), values[:, -1:]], dim=1)


def _sighted(points: Floats) -> Floats:
    """Points (B, h + 1, P, 3); before its first observation, a point is at that position."""
    points = points.copy()
    for step in range(points.shape[1] - 2, -1, -1):
        points[:, step] = np.where(
            np.isfinite(points[:, step]) | np.isfinite(points[:, : step + 1]).any(axis=1),
            points[:, step],
            points[:, step + 1],
        )
    return points
