"""The plant's motion at a few instants, the knots: input of the correcting network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from torch import Tensor

from flywheel.records import Floats, Trajectory
from flywheel.robots import Robot
from flywheel.terrain import Terrain, is_level

FREE_POSITIONS, FREE_VELOCITIES = 7, 6


@dataclass(frozen=True)
class Knots:
    """B motions of a plant at K knots; lengths in L, times in sqrt(L / g), single precision.

    Attributes:
      place: (B, K, bodies, 3) of the bodies' frames, from a point below the robot's present.
      origin: (B, 3) that point in the world.
      turn: (B, K, bodies, 3, 3) rotation matrices, body to world.
      velocity: (B, K, bodies, 3) of the frames, in the world.
      rate: (B, K, bodies, 3) of turning, in the body.
      winch: (B, K, W) positions.
      command: (B, K, W) mean command since the previous knot, as a fraction of the winch's range.
      height: (B, K, P) of the contact place of the tracked points, above the ground.
      off: (B, K, P, 3) measured errors of the points; zero if not measured.
      seen: (B, K, P) fraction of the steps around the knot with a measurement of the point.
    """

    place: Tensor
    origin: Tensor
    turn: Tensor
    velocity: Tensor
    rate: Tensor
    winch: Tensor
    command: Tensor
    height: Tensor
    off: Tensor
    seen: Tensor

    def __getitem__(self, rows: slice | Tensor) -> Knots:
        """Some of the motions."""
        return Knots(*(getattr(self, f.name)[rows] for f in fields(self)))

    def __len__(self) -> int:
        return len(self.place)


@dataclass(frozen=True)
class Units:
    """A robot's own units.

    Attributes:
      length: L [m].
      time: sqrt(L / g) [s].
    """

    length: float
    time: float

    @property
    def speed(self) -> float:
        """sqrt(L g) [m/s]."""
        return self.length / self.time


def knots_of(
    robot: Robot,
    units: Units,
    motion: Trajectory,
    every: int,
    terrains: Sequence[Terrain | None] = (None,),
    measured: Floats | None = None,
) -> Knots:
    """A plant's motion at every so many control steps, the first one among them.

    Args:
      robot: the plant's.
      units: of the robot.
      motion: (B, T), with states.
      every: control steps from knot to knot; divides T.
      terrains: under each of B, or one for all.
      measured: (B, T + 1, P, 3) points [m]; NaN where missing. None without measurements.
    """
    states, points = motion.states, motion.observations.points
    assert states is not None
    qpos = states.qpos[:, ::every].reshape(len(points), -1, len(robot.bodies), FREE_POSITIONS)
    qvel = states.qvel[:, ::every].reshape(len(points), -1, len(robot.bodies), FREE_VELOCITIES)
    center = points[:, 0].mean(axis=1)
    origin = center * [1.0, 1.0, 0.0]
    off, seen = mean_offsets(points, measured, every)
    half = (robot.control_high - robot.control_low) / 2
    told = (motion.controls - robot.control_low - half) / half
    pieces = told.reshape(len(told), -1, every, told.shape[2]).mean(axis=2)
    command = np.concatenate([pieces[:, :1], pieces], axis=1)
    places = points[:, ::every]
    radius = np.array([point.radius for point in robot.points])
    height = places[..., 2] - ground_below(terrains, places) - radius
    if not robot.grounded and all(map(is_level, terrains)):
        height = np.full_like(height, units.length)
    L, speed = units.length, units.speed
    arrays = (
        (qpos[..., :3] - origin[:, None, None]) / L,
        origin / L,
        matrices(qpos[..., 3:]),
        qvel[..., :3] / speed,
        qvel[..., 3:] * units.time,
        motion.observations.winch[:, ::every] / L,
        command,
        height / L,
        off / L,
        seen,
    )
    return Knots(*(torch.as_tensor(np.ascontiguousarray(a), dtype=torch.float32) for a in arrays))


def mean_offsets(points: Floats, measured: Floats | None, every: int) -> tuple[Floats, Floats]:
    """Measured errors of points, averaged over the steps around each knot.

    Args:
      points: (B, T + 1, P, 3) predicted [m].
      measured: (B, T + 1, P, 3) [m]; NaN where missing. None without measurements.
      every: steps from knot to knot.

    Returns:
      (B, K, P, 3) means [m], zero without measurements, and (B, K, P) the measured fraction.
    """
    knots = points[:, ::every]
    if measured is None:
        return np.zeros_like(knots), np.zeros(knots.shape[:3])
    before, after = every // 2, (every - 1) // 2
    there = np.asarray(np.isfinite(measured).all(axis=-1))
    off = np.where(there[..., None], measured - points, 0.0)
    total, count = np.zeros_like(knots), np.zeros(knots.shape[:3])
    at = np.arange(0, points.shape[1], every)
    for shift in range(-before, after + 1):
        within = (at + shift >= 0) & (at + shift < points.shape[1])
        rows = np.clip(at + shift, 0, points.shape[1] - 1)
        total += np.where(within[:, None, None], off[:, rows], 0.0)
        count += np.where(within[:, None], there[:, rows], False)
    return total / np.maximum(count, 1)[..., None], count / every


def ground_below(terrains: Sequence[Terrain | None], places: Floats) -> Floats:
    """(B, ...) heights [m] of the ground below places (B, ..., 3); zero on level ground."""
    below = np.zeros(places.shape[:-1])
    for row in range(len(places)):
        terrain = terrains[row if len(terrains) > 1 else 0]
        if terrain is not None:
            below[row] = terrain.at(places[row, ..., :2])[0]
    return below


def matrices(quaternions: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
