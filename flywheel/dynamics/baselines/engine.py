"""A rigid-body engine as dynamics model, whose few contact numbers are fitted by gradients (T-DPE)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
import torch
from torch import Tensor

from flywheel.dynamics.baselines.inputs import check_shapes
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.dynamics.rigid_bodies.ground import Ground, ground_of
from flywheel.dynamics.rigid_bodies.guessed_attachments import (
    AttachmentGuess,
    winch_offsets,
    with_attachments,
)
from flywheel.dynamics.rigid_bodies.mechanics import ContactNumbers, Mechanics, RigidState
from flywheel.dynamics.threads import one_thread_per_operation
from flywheel.errors import ModelError
from flywheel.records import Floats, Past, Rollout, State
from flywheel.robots import Robot
from flywheel.terrain import is_level
from flywheel.validation import Frozen

# Least, usual and largest value of each of `ContactNumbers`.
CONTACT = {
    "restitution": (-1.0, 0.0, 1.0),
    "depth_share": (0.0, 0.2, 1.0),
    "friction": (0.2, 0.8, 1.5),
    "sticking": (0.0, 0.95, 1.0),
    "rolling": (0.0, 0.95, 1.0),
}
LEAST, USUAL, LARGEST = np.array(list(CONTACT.values())).T


class EngineConfig(Frozen):
    """Settings of a `RigidBodyEngine`.

    Attributes:
      attachments: of the cables: the MJCF's ("mjcf"), places on the circles of the end caps
        ("heuristic"), or the tracked points ("uninformed").
      calibrated: rest lengths are shifted so that in the keyframe each cable is stretched as the MJCF's
        is; else they are the MJCF's, which belong to its own attachments.
    """

    attachments: AttachmentGuess = "uninformed"
    calibrated: bool = True


class RigidBodyEngine:
    """Rigid rods, cables and gravity by the MJCF's numbers, and one impulse for each touching end cap.

    It starts from a state estimated from the past, like `RestartedPlant`. Other parts of a rod touch
    nothing, nor do rods touch each other. Winches follow their commands.

    Args:
      robot: the robot; all bodies must be free.
      dt: control step [s].
      config: its settings.
      contact: (5,) the `ContactNumbers`; None for the usual ones.

    Attributes:
      start: estimates the state at the present.
      mechanics: one step, of `step` [s]; there are `substeps` in a control step.

    Raises:
      RobotError: the robot has joints.
    """

    kind: ClassVar[str] = "tdpe"
    Config: ClassVar[type[EngineConfig]] = EngineConfig

    def __init__(
        self,
        robot: Robot,
        dt: float,
        config: EngineConfig = EngineConfig(),
        contact: Floats | None = None,
    ) -> None:
        robot.require_free("simulated by the rigid-body engine")
        robot.require_even_winches("simulated by the rigid-body engine")
        self.robot, self.dt, self.config = robot, dt, config
        self.contact = USUAL if contact is None else np.asarray(contact, float)
        self._model = with_attachments(robot, config.attachments, config.calibrated)
        self.mechanics = Mechanics(self._model)
        self._offsets = winch_offsets(robot, self._model)
        self.substeps = math.ceil(dt / self.mechanics.longest_step(self._model) - 1e-9)

    @classmethod
    def shapes(cls, robot: Robot, config: EngineConfig) -> dict[str, tuple[int, ...]]:
        """Shapes of the arrays of such a model, by name."""
        return {"contact": (len(CONTACT),)}

    @property
    def arrays(self) -> dict[str, Floats]:
        """Its fitted numbers, by name."""
        return {"contact": self.contact}

    @classmethod
    def of(cls, robot: Robot, dt: float, config: EngineConfig, arrays: dict[str, Floats]) -> Self:
        """The model with given `arrays`."""
        return cls(robot, dt, config, arrays["contact"])

    @cached_property
    def start(self) -> RestartedPlant:
        return RestartedPlant.from_measurements(Plant(self._model, self.dt))

    @property
    def history(self) -> int:
        return self.start.history

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: shapes do not fit, a point is missing in the whole past, or the simulation
            diverged.
        """
        begun, winch = self.started(past, controls)
        with torch.inference_mode(), one_thread_per_operation():
            moved = self.simulate(
                begun, self.rest(winch), torch.tensor(self.contact), self.ground(past)
            )
        points = moved.permute(3, 0, 2, 1).numpy()
        if not np.isfinite(points).all():
            candidate, step = np.argwhere(~np.isfinite(points).all(axis=(2, 3)))[0]
            raise ModelError(
                f"The rigid-body engine diverges for candidate {candidate} after "
                f"{step * self.dt:.2f} s."
            )
        return Rollout(points, winch)

    def started(self, past: Past, controls: Floats) -> tuple[State, Floats]:
        """States at the present, and winch positions (B, H + 1, W) under the controls [m]."""
        check_shapes(self.robot, past, controls)
        past = past.latest(self.history, self.robot.holding(past.winch[:, 0]))
        batch, _, winches = controls.shape
        now = np.broadcast_to(past.winch[:, -1], (batch, winches))
        begun = self.start.estimate(replace(past, winch=past.winch + self._offsets))
        return begun, self.robot.dead_reckon(now, controls, self.dt)

    def ground(self, past: Past) -> Ground | None:
        """The ground of a past; None for none."""
        if not self.robot.grounded and all(map(is_level, past.terrains)):
            return None
        return ground_of(past.terrains)

    def rest(self, winch: Floats) -> Tensor:
        """(H, C, K) rest lengths in each step, from winch positions (K, H + 1, W) [m]."""
        between = (winch[:, 1:] + winch[:, :-1]) / 2.0
        lengths = rest_lengths(self._model, between + self._offsets)
        return torch.as_tensor(lengths).permute(1, 2, 0).contiguous()

    def simulate(
        self, begun: State, rest: Tensor, contact: Tensor, ground: Ground | None
    ) -> Tensor:
        """Points (H + 1, 3, P, K) of simulations [m], differentiable.

        Args:
          begun: states of batch size K, or 1 for all.
          rest: (H, C, K) rest lengths [m].
          contact: (5,) the `ContactNumbers`.
          ground: below the robot; None for none.
        """
        mechanics, count = self.mechanics, rest.shape[-1]
        state = RigidState.of(self._model, begun).expanded(count)
        numbers, h = (
            ContactNumbers(**dict(zip(CONTACT, contact.unbind(), strict=True))),
            self.dt / self.substeps,
        )
        points = [mechanics.seen(state)]
        for lengths in rest:
            for _ in range(self.substeps):
                state = mechanics.step(state, lengths, h, numbers, ground)
            points.append(mechanics.seen(state))
        return torch.stack(points)
