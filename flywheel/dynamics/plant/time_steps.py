"""Time-step errors: how far off MuJoCo's integrators with some step are, and from which step on they fail."""

from __future__ import annotations

import time
from dataclasses import dataclass

import mujoco
import numpy as np

from flywheel.dynamics.plant.parameters import PlantParameters
from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.refined import with_steps
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.errors import ModelError
from flywheel.records import Floats, State
from flywheel.robots import GRAVITY

MOST = 0.9  # share of the distances that are below `StepError.most`
# Step times rate of decay from which on explicit damping feeds motion [-]. Other integrators are implicit in
# the damping of cables; Euler is so in that of joints only.
EXPLICIT = {"Euler": 2.0, "RK4": 2.785}


@dataclass(frozen=True)
class StepError:
    """Errors at the end of motions in some steps.

    Attributes:
      integrator: by the MJCF's word for it.
      timestep: [s].
      median, most: distance of tracked points from where they should be, and what 90 % are below;
        infinite where a motion diverged [m].
      energy: median error of the mechanical energy; NaN where a motion diverged [J].
      speed: simulated seconds for a second of one CPU; 0 where a motion diverged.
    """

    integrator: str
    timestep: float
    median: float
    most: float
    energy: float
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
        self._points, self._energy = self._ends(with_steps(plant, integrator, timestep))

    def error(self, integrator: str, timestep: float) -> StepError:
        """The error of an integrator with some step [s].

        Raises:
          ModelError: the plant's control step is not a multiple of it.
        """
        plant = with_steps(self.plant, integrator, timestep)
        began = time.process_time()
        try:
            points, held = self._ends(plant)
        except ModelError:
            return StepError(integrator, timestep, np.inf, np.inf, np.nan, 0.0)
        taken = time.process_time() - began
        apart = np.linalg.norm(points - self._points, axis=-1)
        median, most = (float(np.quantile(apart, share)) for share in (0.5, MOST))
        simulated = self._controls.shape[0] * self._controls.shape[1] * plant.dt
        lost = float(np.median(np.abs(held - self._energy)))
        return StepError(integrator, timestep, median, most, lost, simulated / taken)

    def _ends(self, plant: Plant) -> tuple[Floats, Floats]:
        """(B, P, 3) where tracked points end [m], and with which energies (B,) [J]."""
        moved = plant.simulate(self._start, self._controls)
        assert moved.states is not None
        return moved.observations.points[:, -1], energy(plant, moved.states[:, -1])


def energy(plant: Plant, states: State) -> Floats:
    """(B,) kinetic energy, of height and of the cables' springs in states (B,) [J].

    Args:
      plant: with one set of parameters.
      states: its states.
    """
    model, robot, parameters = plant.model, plant.robot, plant.parameters
    assert isinstance(parameters, PlantParameters)
    data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
    stiffness = np.array([cable.stiffness for cable in robot.cables])
    stiffness *= parameters.cable_stiffness
    rest, found = rest_lengths(robot, plant.winch(states)), np.empty(len(states.qpos))
    for row in range(len(found)):
        data.qpos[:], data.qvel[:] = states.qpos[row], states.qvel[row]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        stretch = np.maximum(data.ten_length - rest[row], 0.0)
        moving = data.qvel @ inertia @ data.qvel / 2
        height = GRAVITY * (model.body_mass * data.xipos[:, 2]).sum()
        found[row] = moving + height + (stiffness * stretch**2).sum() / 2
    return found


@dataclass(frozen=True)
class CableDamping:
    """Damping rates of a robot by its cables, all of them taut.

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
    eased = np.linalg.solve(inertia, along.T)  # what a newton along a cable does to each speed
    own = damping * (along.T * eased).sum(axis=0)
    rates = np.linalg.eigvals((eased * damping) @ along).real
    worst = int(own.argmax())
    return CableDamping(float(rates.max()), robot.cables[worst].name, float(own[worst]))
