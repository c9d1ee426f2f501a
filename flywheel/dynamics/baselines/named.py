"""The baselines that need no fit, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from flywheel.dynamics.baselines.engine import EngineConfig, RigidBodyEngine
from flywheel.dynamics.baselines.persistence import Persistence
from flywheel.dynamics.plant import Plant, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.dynamics.rigid_bodies.guessed_attachments import AttachmentGuess
from flywheel.robots import Robot

Maker = Callable[[Robot, float, int], Dynamics]
"""Makes a model from a robot, a control step [s] and a number of threads."""


def persistence(robot: Robot, dt: float, threads: int = 1) -> Dynamics:
    """No motion: the last seen points are repeated."""
    return Persistence(robot, dt)


def floor(robot: Robot, dt: float, threads: int = 1) -> Dynamics:
    """MuJoCo restarted from the observed past, with the invisible roll of rods at random."""
    return replace(informed_floor(robot, dt, threads), roll="random")


def informed_floor(robot: Robot, dt: float, threads: int = 1) -> RestartedPlant:
    """MuJoCo restarted from the observed past, with the roll of rods computed from the cables."""
    return RestartedPlant.from_measurements(Plant(robot, dt, threads=threads))


def _engine(attachments: AttachmentGuess, of: str) -> Maker:
    def make(robot: Robot, dt: float, threads: int = 1) -> Dynamics:
        return RigidBodyEngine(robot, dt, EngineConfig(attachments=attachments))

    make.__doc__ = f"The rigid-body engine with the usual contact numbers and {of}."
    return make


BASELINES: dict[str, Maker] = {
    "persistence": persistence,
    "floor": floor,
    "informed_floor": informed_floor,
    "tdpe": _engine("mjcf", "the MJCF's attachments"),
    "tdpe_heuristic": _engine("heuristic", "attachments on the circles of the end caps"),
    "tdpe_uninformed": _engine("uninformed", "cables between the end caps' centres"),
}
