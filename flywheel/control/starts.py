"""Initial states of episodes: dropped or thrown in any orientation, perturbed, standing, by a box."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, RobotError
from flywheel.records import Floats, State
from flywheel.robots import GRAVITY, Robot
from flywheel.rotations import conjugate, rotate
from flywheel.terrain import is_level

FREE_JOINT = 7  # position and quaternion
HEIGHT = (0.03, 0.4)  # height of the lowest cap's surface above the ground [robot lengths]
# Tilt of a perturbed start, at most: half of that at which prism3 tips over [rad].
TILT = np.radians(10.0)
FLIGHT, SPIN = (
    0.5,
    1.0,
)  # of throws, standard deviation in each direction [sqrt(g L)], [sqrt(g / L)]

ATTEMPTS = 200  # draws of a place beside a box
NEAR = 0.5  # largest distance of such a place from the box, seen from above [robot lengths]
LIFTS = np.linspace(0.0, 1.0, 21)  # tried in turn, until a robot touches no box [robot lengths]
BETWEEN = np.linspace(0.0, 1.0, 16)  # places between two tracked points that touch no box


def random_drop(plant: Plant, rng: np.random.Generator, n: int) -> State:
    """The robot at rest in its own shape, in a random orientation above the ground.

    Args:
      plant: of a robot whose bodies are all free, and connected to each other only.
      rng: source of randomness.
      n: number of states.

    Returns:
      (n,) states.

    Raises:
      RobotError: the robot is attached to something fixed.
    """
    turn = Rotation.from_quat(_unit(rng.standard_normal((n, 4))))
    return _dropped(plant, turn, rng.uniform(*HEIGHT, n))


def perturbed(plant: Plant, rng: np.random.Generator, n: int) -> State:
    """The keyframe, tilted by up to `TILT`, turned about the vertical by any angle, just above the ground.

    Arguments and errors as of `random_drop`.
    """
    angles = rng.uniform([-np.pi, 0.0, -np.pi], [np.pi, TILT, np.pi], (n, 3))
    return _dropped(plant, Rotation.from_euler("ZXZ", angles), np.full(n, HEIGHT[0]))


def _dropped(plant: Plant, turn: Rotation, height: Floats) -> State:
    """Keyframes (n,) rotated about their centres of mass, their lowest caps (n,) above ground [lengths]."""
    n, robot = len(height), plant.robot
    rest = plant.rest(n)
    pose, center = _turned(robot, rest, turn)
    pose[..., :3] += center
    turned = State(pose.reshape(n, -1), rest.qvel, rest.act)
    radii = np.array([point.radius for point in robot.points])
    lowest = (plant.observe(turned).points[..., 2] - radii).min(axis=1)
    pose[..., 2] += (height * robot.length - lowest)[:, None]
    return above_ground(plant, State(pose.reshape(n, -1), rest.qvel, rest.act))


def thrown(plant: Plant, rng: np.random.Generator, n: int) -> State:
    """Dropped robots (n,) that fly and turn as a whole, with random velocities.

    Arguments and errors as of `random_drop`.
    """
    state, robot = random_drop(plant, rng, n), plant.robot
    poses, _ = _turned(robot, state, Rotation.identity(n))
    flight = rng.normal(scale=FLIGHT * np.sqrt(GRAVITY * robot.length), size=(n, 1, 3))
    spin = rng.normal(scale=SPIN * np.sqrt(GRAVITY / robot.length), size=(n, 1, 3))
    linear = flight + np.cross(spin, poses[..., :3])  # relative to the centres of mass
    velocity = np.concatenate([linear, rotate(conjugate(poses[..., 3:]), spin)], axis=-1)
    return State(state.qpos, velocity.reshape(n, -1), state.act)


def above_ground(plant: Plant, state: State) -> State:
    """Standing or hanging robots (n,), raised by the height of the highest ground below them.

    Raises:
      RobotError: the robot has joints, and the ground is not level.
    """
    if plant.terrain is None or is_level(plant.terrain):
        return state
    plant.robot.require_free("put on ground that is not level")
    robot, points = plant.robot, plant.observe(state).points
    reach = max(point.radius for point in robot.points)
    pose = state.qpos.reshape(len(points), len(robot.bodies), FREE_JOINT).copy()
    for row, places in enumerate(points[..., :2]):
        pose[row, :, 2] += plant.terrain.highest(places.min(0) - reach, places.max(0) + reach)
    return State(pose.reshape(len(points), -1), state.qvel, state.act)


def standing(plant: Plant, state: State, place: Floats, turn: float) -> State:
    """A resting robot (1,), moved to a place (2,) [m] and turned about the vertical [rad].

    Raises:
      RobotError: it is attached to something fixed.
    """
    pose, center = _turned(plant.robot, state, Rotation.from_rotvec([[0.0, 0.0, turn]]))
    pose[..., :2] += place
    pose[..., 2] += center[..., 2]
    return State(pose.reshape(1, -1), np.zeros_like(state.qvel), state.act)


def by_a_box(plant: Plant, state: State, rng: np.random.Generator) -> State:
    """A robot (1,) at rest, moved beside, below or onto a random box, and turned about the vertical.

    It is lifted until it touches no box: its tracked points, and the lines between them.

    Raises:
      ConfigError: no place was found, or there is no box.
      RobotError: the robot is attached to something fixed.
    """
    robot, boxes = plant.robot, () if plant.terrain is None else plant.terrain.boxes
    pairs = np.array(list(combinations(range(len(robot.points)), 2))).T
    radius = max(point.radius for point in robot.points)
    for _ in range(ATTEMPTS if boxes else 0):
        corners = boxes[rng.integers(len(boxes))].corners[:, :2]
        margin = NEAR * robot.length
        place = rng.uniform(corners.min(axis=0) - margin, corners.max(axis=0) + margin)
        put = above_ground(plant, standing(plant, state, place, rng.uniform(-np.pi, np.pi)))
        first, second = plant.observe(put).points[0][pairs]
        lines = first + BETWEEN[:, None, None] * (second - first)
        for lift in LIFTS * robot.length:
            gaps = [np.maximum(box.beyond(lines + [0, 0, lift]), 0.0) for box in boxes]
            if np.linalg.norm(gaps, axis=-1).min() > radius:
                pose = put.qpos.reshape(1, len(robot.bodies), FREE_JOINT).copy()
                pose[..., 2] += lift
                return State(pose.reshape(1, -1), put.qvel, put.act)
    raise ConfigError(
        f"{robot.name} could not be placed by one of {len(boxes)} boxes in {ATTEMPTS} attempts."
    )


def refuse_fixed(robot: Robot) -> None:
    """Check that a robot can be placed anywhere.

    Raises:
      RobotError: it is attached to something fixed, or has joints.
    """
    if robot.tethered:
        raise RobotError(
            f"{robot.name} cannot be dropped or carried: it hangs on cables from fixed points."
        )
    robot.require_free("dropped or carried")


def _turned(robot: Robot, state: State, turn: Rotation) -> tuple[Floats, Floats]:
    """Poses (n, bodies, 7) rotated by (n,) about their centres of mass, relative to these, and the
    centres.

    Returns:
      The poses, and the centres (n, 1, 3) [m].
    """
    n, bodies = len(state.qpos), len(robot.bodies)
    refuse_fixed(robot)
    pose = state.qpos.reshape(n, bodies, FREE_JOINT).copy()
    masses = np.array([body.mass for body in robot.bodies])
    center = np.average(pose[..., :3], axis=1, weights=masses)[:, None]
    each = turn[np.repeat(np.arange(n), bodies)]
    own = Rotation.from_quat(pose[..., 3:].reshape(-1, 4), scalar_first=True)
    pose[..., :3] = each.apply((pose[..., :3] - center).reshape(-1, 3)).reshape(n, bodies, 3)
    pose[..., 3:] = (each * own).as_quat(scalar_first=True).reshape(n, bodies, 4)
    return pose, center


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
