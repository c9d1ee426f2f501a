"""A simulated robot whose points, poses and winches are known at any time, to be written in any format."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from flywheel.dynamics.plant import Plant
from flywheel.records import Floats
from flywheel.robots import Robot, load_robot

STEP = 0.005  # [s] of the simulation
HELD = 0.4  # [s] for which a command holds
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # ours -> a tracker's with y up
AXES = "axes: {x: x, y: -z, z: y}\n"  # the same in a map


@dataclass(frozen=True)
class Truth:
    """A robot in motion; its own times are from 0 to `seconds`.

    Attributes:
      robot: platform4.
      seconds: of the motion.
      offset: its own time at time 0 of the clock by which it is asked [s].
      pace: its seconds per second of that clock.
    """

    robot: Robot
    seconds: float
    _points: CubicSpline
    _place: CubicSpline
    _turn: RotationSpline
    _winch: CubicSpline
    _told: Floats
    offset: float = 0.0
    pace: float = 1.0

    def by(self, offset: float, pace: float = 1.0) -> Truth:
        """The same motion, asked by another clock."""
        return replace(self, offset=offset, pace=pace)

    def own(self, time: Floats) -> Floats:
        """(N,) times of another clock in its own [s]."""
        return self.offset + self.pace * time

    def points(self, time: Floats) -> Floats:
        """(N, P, 3) [m]."""
        return self._points(self.own(time))

    def pose(self, time: Floats) -> tuple[Floats, Floats]:
        """(N, 3) positions of the body [m], and its rotations (N, 4) as x, y, z, w."""
        return self._place(self.own(time)), self._turn(self.own(time)).as_quat()

    def winch(self, time: Floats) -> Floats:
        """(N, W) positions [m]."""
        return self._winch(self.own(time))

    def commands(self, time: Floats) -> Floats:
        """(N, W) that hold at some times."""
        held = (self.own(time) / HELD + 1e-9).astype(int)
        return self._told[np.minimum(held, len(self._told) - 1)]


def made(seconds: float = 8.0, seed: int = 3) -> Truth:
    """Winches that take new commands each 0.4 s."""
    robot = load_robot("platform4")
    plant, rng = Plant(robot, dt=STEP), np.random.default_rng(seed)
    start = plant.settle(1.0)
    holding = robot.holding(robot.winch_of(start))
    count = round(seconds / HELD)
    wiggle = np.where(robot.rate_driven, 0.25, 0.12) * rng.uniform(
        -1, 1, (count, len(robot.winches))
    )
    wiggle[1::2] = np.where(robot.rate_driven, -wiggle[::2][: count // 2], wiggle[1::2])
    told = np.clip(holding + wiggle, robot.control_low, robot.control_high)
    flown = plant.simulate(start, np.repeat(told, round(HELD / STEP), axis=0)[None])
    time = STEP * np.arange(flown.controls.shape[-2] + 1)
    states = flown.states
    assert states is not None
    pose = states.qpos[0][:, :7]
    turn = Rotation.from_quat(np.roll(pose[:, 3:], -1, axis=1))
    return Truth(
        robot,
        float(time[-1]),
        CubicSpline(time, flown.observations.points[0]),
        CubicSpline(time, pose[:, :3]),
        RotationSpline(time, turn),
        CubicSpline(time, robot.winch_of(states)[0]),
        told,
    )
