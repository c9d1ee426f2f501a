"""Where episodes begin: dropped from above, in any orientation."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from flywheel.dynamics.plant import Plant
from flywheel.errors import RobotError
from flywheel.records import State

FREE_JOINT = 7  # position and quaternion
HEIGHT = (0.03, 0.4)  # of the lowest cap's surface above the ground [robot lengths]


def random_drop(plant: Plant, rng: np.random.Generator, n: int) -> State:
    """The robot at rest in its own shape, turned any way, above the ground.

    Args:
      plant: of a robot whose bodies are all free, and tied to each other only.
      rng: source of all chance.
      n: how many.

    Returns:
      (n,) states.

    Raises:
      RobotError: the robot cannot be turned, for it is tied to something fixed.
    """
    robot, rest = plant.robot, plant.rest(n)
    bodies = len(robot.bodies)
    if any(end.body < 0 for cable in robot.cables for end in cable.ends):
        raise RobotError(f"{robot.name} cannot be dropped: it hangs on cables from fixed points.")
    if rest.qpos.shape[1] != FREE_JOINT * bodies:
        raise RobotError(
            f"{robot.name} cannot be dropped: that needs all bodies free ({FREE_JOINT * bodies} "
            f"positions), its MJCF has {rest.qpos.shape[1]}."
        )
    pose = rest.qpos.reshape(n, bodies, FREE_JOINT).copy()
    masses = np.array([body.mass for body in robot.bodies])
    center = np.average(pose[..., :3], axis=1, weights=masses)[:, None]
    turn = Rotation.from_quat(_unit(rng.standard_normal((n, 4))).repeat(bodies, axis=0))
    own = Rotation.from_quat(pose[..., 3:].reshape(-1, 4), scalar_first=True)
    offsets = turn.apply((pose[..., :3] - center).reshape(-1, 3)).reshape(n, bodies, 3)
    pose[..., :3] = center + offsets
    pose[..., 3:] = (turn * own).as_quat(scalar_first=True).reshape(n, bodies, 4)
    turned = State(pose.reshape(n, -1), rest.qvel, rest.act)
    radii = np.array([point.radius for point in robot.points])
    lowest = (plant.observe(turned).points[..., 2] - radii).min(axis=1)
    pose[..., 2] += (rng.uniform(*HEIGHT, n) * robot.length - lowest)[:, None]
    return State(pose.reshape(n, -1), rest.qvel, rest.act)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
