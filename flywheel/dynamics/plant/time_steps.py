"""Time-step errors: how far off MuJoCo's integrators with some step are, and from which step on they fail."""

from __future__ import annotations

import time
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.linalg import eigh

from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.refined import with_steps
from flywheel.errors import ModelError
from flywheel.records import Floats, State

MOST = 0.9  # share of the distances that are below `StepError.most`
# Step times rate of decay from which on explicit damping feeds motion [-]. Other integrators are implicit in
# the damping of cables; Euler is so in that of joints only.
EXPLICIT = {"Euler": 2.0, "RK4": 2.785}


@dataclass(frozen=True)
class StepError:
    """How far off motions in some steps end.

    Attributes:
      integrator: by the MJCF's word for it.
      timestep: [s].
      median, most: distance of tracked points from where they should be, and what 90 % are below;
        infinite where a motion diverged [m].
      speed: simulated seconds for a second of one CPU; 0 where a motion diverged.
    """

    integrator: str
    timestep: float
    median: float
    most: float
    speed: float


class StepStudy:
    """The same motions in other steps.

    Args:
      plant: that moves.
      start: (B,) or (1,) states that the motions begin with.
      controls: (B, T, W) commands of the motions.
      integrator, timestep: steps of the motions that others are compared with [s].

    Raises:
      ModelError: these motions diverged.
    """

    def __init__(
        self, plant: Plant, start: State, controls: Floats, integrator: str, timestep: float
    ) -> None:
        self.plant, self._start, self._controls = plant, start, controls
        self._right = self._ends(with_steps(plant, integrator, timestep))

    def error(self, integrator: str, timestep: float) -> StepError:
        """The error of an integrator with some step [s].

        Raises:
          ModelError: the plant's control step is not a multiple of it.
        """
        plant = with_steps(self.plant, integrator, timestep)
        began = time.process_time()
        try:
            ends = self._ends(plant)
        except ModelError:
            return StepError(integrator, timestep, np.inf, np.inf, 0.0)
        taken = time.process_time() - began
        apart = np.linalg.norm(ends - self._right, axis=-1)
        median, most = (float(np.quantile(apart, share)) for share in (0.5, MOST))
        simulated = self._controls.shape[0] * self._controls.shape[1] * plant.dt
        return StepError(integrator, timestep, median, most, simulated / taken)

    def _ends(self, plant: Plant) -> Floats:
        """(B, P, 3) where tracked points end [m]."""
        return plant.simulate(self._start, self._controls).observations.points[:, -1]


@dataclass(frozen=True)
class CableDamping:
    """How fast the cables of a robot can take motion away, all of them taut.

    Attributes:
      rate: of decay of the fastest motion [1/s].
      cable: the one that is fastest by itself.
      own: rate of that one: its damping over the inertia along it [1/s].
    """

    rate: float
    cable: str
    own: float

    def limit(self, integrator: str) -> float:
        """The step from which on that integrator lets the motion grow instead [s]; infinite if none."""
        decay = EXPLICIT.get(integrator, np.inf)
        return decay / self.rate if self.rate else np.inf


def cable_damping(plant: Plant) -> CableDamping:
    """The damping of a plant's cables at the keyframe, by its inertia there."""
    robot, model = plant.robot, plant.model
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:] = robot.keyframe.qpos
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    along = np.empty((model.ntendon, model.nv))  # speeds of the cables for each speed by itself
    for column in range(model.nv):
        data.qvel[:] = 0.0
        data.qvel[column] = 1.0
        mujoco.mj_fwdVelocity(model, data)
        along[:, column] = data.ten_velocity
    damping = np.array([cable.damping for cable in robot.cables])
    own = damping * (along * np.linalg.solve(inertia, along.T).T).sum(axis=1)
    rates = eigh(along.T @ (damping[:, None] * along), inertia, eigvals_only=True)
    worst = int(own.argmax())
    return CableDamping(float(rates[-1]), robot.cables[worst].name, float(own[worst]))
