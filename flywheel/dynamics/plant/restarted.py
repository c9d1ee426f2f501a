"""MuJoCo restarted from observations: exact physics with partial observation.

It knows the robot exactly and has the inputs of a learned model. It has to estimate the velocity,
and the rotation of each rod about its own axis. The estimate of the rotation determines the
accuracy, because cables end on the surface of the rods.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from flywheel.dynamics.plant.grounds import simulated_on
from flywheel.dynamics.plant.plant import Plant
from flywheel.dynamics.plant.poses import FREE_POSITIONS, at_points, seen_poses
from flywheel.dynamics.plant.roll import ON_A_LINE, relaxed, unseen_axes
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, Past, Rollout, State, Trajectory
from flywheel.robots import GRAVITY, Body, Robot
from flywheel.rotations import about_axis, conjugate, multiply, rotate
from flywheel.smoothing import causal_polynomial

FREE_VELOCITIES = 6
SAME_PLACE = 1e-9  # of a point on its body, but for rounding [m]
LOOK_BACK = 0.36  # of a plant that sees velocities through noise [sqrt(L / g)]


@dataclass(frozen=True)
class RestartedPlant:
    """MuJoCo started from a state estimated from the past observations.

    Each tracked point is fitted by a polynomial in time over the last steps; each body takes the
    pose and velocity that fit its points best. If those lie on one line, `roll` determines the
    rotation about it; its rate is zero.

    Attributes:
      plant: parameters and threads for the prediction; the past gives the terrain. All
        bodies must be free.
      window: past steps in the fit; 1 is the finite difference. More resists noise and missing
        points: if too few are known, a point is assumed to rest at its last known position.
      degree: of the polynomial: 1 or 2.
      roll: "random": any angle, drawn for each past by itself; "keyframe": the smallest rotation
        from the keyframe's pose; "relaxed": the one with the least elastic energy of the cables, at
        their nominal rest lengths.
      seed: of the random angles.
    """

    plant: Plant
    window: int = 1
    degree: int = 1
    roll: Literal["random", "keyframe", "relaxed"] = "random"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.window < 1 or self.degree not in (1, 2):
            raise ModelError(
                f"window must be at least 1 and degree 1 or 2, got {self.window}, {self.degree}."
            )
        self.robot.require_free("restarted from its points")

    @classmethod
    def from_measurements(cls, plant: Plant) -> RestartedPlant:
        """The plant, restarted with velocities that are robust against a real robot's noise."""
        look_back = LOOK_BACK * np.sqrt(plant.robot.length / GRAVITY)
        return cls(plant, window=max(2, round(look_back / plant.dt)), degree=2, roll="relaxed")

    @property
    def robot(self) -> Robot:
        return self.plant.robot

    @cached_property
    def _seen(self) -> Robot:
        """The robot with its tracked points where the plant has them: an effect may move markers."""
        robot, rest = self.robot, self.plant.rest()
        points = self.plant.observe(rest).points[0]
        poses = rest.qpos[0].reshape(-1, FREE_POSITIONS)[[point.body for point in robot.points]]
        offsets = rotate(conjugate(poses[:, 3:]), points - poses[:, :3])
        if np.allclose(
            offsets, [point.offset for point in robot.points], rtol=0.0, atol=SAME_PLACE
        ):
            return robot
        moved = zip(robot.points, offsets, strict=True)
        return replace(robot, points=tuple(replace(point, offset=there) for point, there in moved))

    @property
    def dt(self) -> float:
        return self.plant.dt

    @property
    def history(self) -> int:
        return self.window

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        """Predict the points under `controls` (B, H, W).

        Raises:
          ModelError: a point is missing in the whole past, shapes do not fit, or the simulation
            diverged.
        """
        seen = self.motion(past, controls).observations
        return Rollout(seen.points, seen.winch)

    def motion(self, past: Past, controls: Floats) -> Trajectory:
        """The same with full states; raises the same."""
        return simulated_on(past.terrains, self.plant, self.estimate(past), controls)

    def estimate(self, past: Past) -> State:
        """The state (B,) that fits the past best.

        Raises:
          ModelError: a point is missing in the whole past.
        """
        recent = past.observations.points[:, -(self.window + 1) :]
        points, speeds = causal_polynomial(recent, self.dt, self.degree)
        points = np.where(np.isfinite(points), points, _last_seen(past.observations.points))
        if not np.isfinite(points).all():
            raise ModelError(
                "A tracked point was not seen in the whole past; cannot restart there."
            )
        poses = self._poses(points, past.winch[:, -1])
        velocities = [
            self._velocity(
                body, poses[:, index], points[:, list(body.points)], speeds[:, list(body.points)]
            )
            for index, body in enumerate(self.robot.bodies)
        ]
        qpos = poses.reshape(len(poses), -1)
        act = self.plant.activation(past.winch[:, -1])
        return State(qpos, np.concatenate(velocities, axis=1), act)

    def _poses(self, points: Floats, winch: Floats) -> Floats:
        """(B, bodies, 7) positions and quaternions of the bodies whose points are at (B, P, 3)."""
        robot = self._seen
        stacked, axes = seen_poses(robot, points), unseen_axes(robot)
        if self.roll == "keyframe":
            return stacked
        if self.roll == "relaxed":
            turned = relaxed(robot, stacked, winch, axes)
        else:
            turned, angles = stacked.copy(), _angles(self.seed, points, len(robot.bodies))
            for i, axis in axes.items():
                turn = about_axis(axis, angles[:, i])
                turned[:, i, 3:] = multiply(stacked[:, i, 3:], turn)
        if robot is self.robot:
            return turned
        # A turn about the line of markers that do not sit on the axis of their rod moves them.
        return at_points(robot, turned[..., 3:], points)

    def _velocity(self, body: Body, pose: Floats, points: Floats, speeds: Floats) -> Floats:
        """(B, 6) velocity of the body frame [m/s] and turning rate in it [rad/s].

        The rate is the smallest that fits the points' velocities best: none about a line through
        all of them.
        """
        turn = pose[:, 3:]
        offsets = self._seen.offsets_of(body)
        arms = rotate(turn[:, None], offsets - offsets.mean(axis=0))
        mean = speeds.mean(axis=1)
        spread = np.cross(arms, speeds - mean[:, None]).sum(axis=1)
        square = (arms**2).sum(axis=(1, 2))[:, None, None] * np.eye(3)
        moment = square - np.swapaxes(arms, 1, 2) @ arms
        rate = (np.linalg.pinv(moment, rcond=ON_A_LINE, hermitian=True) @ spread[..., None])[..., 0]
        linear = mean + np.cross(rate, pose[:, :3] - points.mean(axis=1))
        return np.concatenate([linear, rotate(conjugate(turn), rate)], axis=1)


def states_of(robot: Robot, dt: float, points: Floats, winch: Floats) -> State:
    """States (T,) of a robot with given points.

    Args:
      robot: to be drawn.
      dt: control step [s].
      points: (T, P, 3) of its tracked points [m].
      winch: (T, W) positions of its winches [m].
    """
    past = Past(
        Observation(points[:, None], winch[:, None]),
        np.zeros((len(points), 0, winch.shape[-1])),
        winch[:, None],
    )
    return RestartedPlant(Plant(robot, dt), roll="relaxed").estimate(past)


def _angles(seed: int, points: Floats, bodies: int) -> Floats:
    """(B, bodies) random angles [rad]; those of a row depend on its own points, not on its batch."""
    streams = [np.random.default_rng([seed, zlib.crc32(row.tobytes())]) for row in points]
    return np.array([stream.uniform(0, 2 * np.pi, bodies) for stream in streams])


def _last_seen(points: Floats) -> Floats:
    """(B, P, 3) the newest known position of each point of (B, h + 1, P, 3); NaN if there is none."""
    known = np.asarray(np.isfinite(points).all(axis=-1))
    newest = points.shape[1] - 1 - np.flip(known, axis=1).argmax(axis=1)
    return np.take_along_axis(points, newest[:, None, :, None], axis=1)[:, 0]
