"""Winch positions from measured tensions of cables, by the cables' own law.

A taut cable of length l with the rest length r pulls with T = k (l - r) + c dl/dt, so that a measured T
tells r = l - (T - c dl/dt) / k, with the length l measured or between the bodies. Where winches take
tensions, T - c dl/dt is their position. A slack cable only tells that r is at least l: nothing here.

What remains between these positions and the reckoned ones is a random walk seen through white noise:
winches go where they are told, but for what nobody knows of them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flywheel.dynamics.plant.poses import seen_poses
from flywheel.dynamics.plant.roll import relaxed, rest_lengths, unseen_axes
from flywheel.errors import DataError
from flywheel.noise import noise_floor
from flywheel.records import ChannelKind, Floats, MeasuredChannel, Trajectory
from flywheel.robots import Attachment, Robot

SURE = 5.0  # standard deviations of its noise above which a tension is one
# Share of the strongest pull of a winch from which it may pull less than its cable's law.
AT_LIMIT = 0.98
RATE_OVER = 0.05  # time over which a cable's speed is taken, until the instant [s]
PASSES = 2  # the roll of rods by reckoned winches, and by those that follow from it
TOGETHER = 10_000  # poses that are relaxed at once
NEAR = 1e-6  # from a body's points, relative to L: their pose tells where the end of a cable is
# Variance of the walk in a step over that of the noise, of which the likeliest is taken.
RATIOS = 10.0 ** np.arange(-7.0, 3.0)
UNKNOWN = 1e9  # variance of the first difference over that of the noise


def with_tensions(robot: Robot, trajectory: Trajectory, reckoned: Floats) -> Floats:
    """Winch positions corrected by the tensions until then, where there are any.

    Args:
      robot: of the trajectory.
      trajectory: unbatched, with channels.
      reckoned: (T + 1, W) positions without them [m or N].

    Returns:
      (T + 1, W) positions [m or N].
    """
    tensions = _pulls(robot, trajectory) if trajectory.channels else np.empty(0)
    if not np.isfinite(tensions).any():
        return reckoned
    known = reckoned
    for _ in range(PASSES if robot.free and unseen_axes(robot) else 1):
        off, count = _differences(robot, trajectory, tensions, known, reckoned)
        known = np.clip(reckoned + _walk(off, count), robot.rest_low, robot.rest_high)
    return np.where(np.isfinite(trajectory.observations.winch), reckoned, known)


def _pulls(robot: Robot, trajectory: Trajectory) -> Floats:
    """(T + 1, C) measured tensions of cables with winches that are surely taut, and not at their limit [N].

    NaN elsewhere, and for a channel whose noise is neither told nor seen.
    """
    found = np.full((trajectory.steps + 1, len(robot.cables)), np.nan)
    for index, cable in enumerate(robot.cables):
        channel = _channel(trajectory, "tension", cable.name)
        if channel is None or cable.winch < 0:
            continue
        try:
            noise = channel.noise or noise_floor([channel.values[:, None, None]])
        except DataError:
            continue
        taut = (channel.values > SURE * noise) & (channel.values < AT_LIMIT * cable.strongest)
        found[:, index] = np.where(taut, channel.values, np.nan)
    return found


def _channel(trajectory: Trajectory, kind: ChannelKind, name: str) -> MeasuredChannel | None:
    return next((each for each in trajectory.channels if each.key == (kind, name)), None)


def _differences(
    robot: Robot, trajectory: Trajectory, tensions: Floats, known: Floats, reckoned: Floats
) -> tuple[Floats, Floats]:
    """(T + 1, W) mean difference of told from reckoned positions, 0 for none, and the number of cables.

    Args:
      tensions: (T + 1, C) of taut cables; NaN elsewhere [N].
      known: (T + 1, W) best positions so far, for the roll of rods.
      reckoned: (T + 1, W) positions.
    """
    lengths = _lengths(robot, trajectory, known)
    speeds = _speeds(lengths, trajectory.dt)
    rest, shape = rest_lengths(robot, reckoned), reckoned.shape
    off, count = np.zeros(shape), np.zeros(shape)
    for index, cable in enumerate(robot.cables):
        pull = tensions[:, index].copy()
        if cable.damping:
            pull -= cable.damping * speeds[:, index]
        if robot.tension_driven:
            more = pull - reckoned[:, cable.winch]
        elif cable.stiffness:
            more = lengths[:, index] - pull / cable.stiffness - rest[:, index]
            more /= robot.ratios[index] or 1.0
        else:
            continue
        known_here = np.isfinite(more)
        off[known_here, cable.winch] += more[known_here]
        count[known_here, cable.winch] += 1
    return off / np.maximum(count, 1), count


def _lengths(robot: Robot, trajectory: Trajectory, winch: Floats) -> Floats:
    """(T + 1, C) lengths of cables: measured, else between the bodies; NaN where a point is missing [m]."""
    found = np.full((trajectory.steps + 1, len(robot.cables)), np.nan)
    points = trajectory.observations.points
    if robot.free and all(body.points for body in robot.bodies):
        rows = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
        for some in np.array_split(rows, 1 + len(rows) // TOGETHER) if len(rows) else ():
            poses = relaxed(robot, seen_poses(robot, points[some]), winch[some], unseen_axes(robot))
            found[some] = robot.cable_lengths(poses)
    for index, cable in enumerate(robot.cables):
        if not all(_placed(robot, end) for end in cable.ends):
            found[:, index] = np.nan
        channel = _channel(trajectory, "length", cable.name)
        if channel is not None:
            found[:, index] = np.where(np.isfinite(channel.values), channel.values, found[:, index])
    return found


def _placed(robot: Robot, end: Attachment) -> bool:
    """True if the points of a cable end's body tell its place; a rod's, with its roll by the cables."""
    if end.body < 0:
        return True
    offsets = robot.offsets_of(robot.bodies[end.body])
    apart = np.linalg.norm(offsets - end.offset, axis=1)
    return len(offsets) > 0 and bool(
        np.ptp(offsets, axis=0).any() or apart.min() < NEAR * robot.length
    )


def _speeds(lengths: Floats, dt: float) -> Floats:
    """(T + 1, C) speeds at the end of parabolas through the lengths until then; NaN for too few [m/s]."""
    steps = max(2, round(RATE_OVER / dt))
    times = np.arange(-steps, 1) * dt
    slope = np.linalg.pinv(np.stack([np.ones(steps + 1), times, times**2], axis=1))[1]
    found = np.full(lengths.shape, np.nan)
    if len(lengths) > steps:
        runs = np.lib.stride_tricks.sliding_window_view(lengths, steps + 1, axis=0)
        found[steps:] = runs @ slope
    return found


def _walk(off: Floats, count: Floats) -> Floats:
    """(T + 1, W) best estimate of a random walk at each instant, from what was seen of it until then.

    A Kalman filter of one level for each winch; the variance of its steps is the likeliest one.

    Args:
      off: (T + 1, W) the walk through noise.
      count: (T + 1, W) number of cables that tell it; 0 for none.
    """
    squares, logs, seen = np.zeros((3, len(RATIOS), off.shape[1]))
    for _, square, spread in _levels(off, count, RATIOS[:, None]):
        told = (spread > 1.0) & (spread < UNKNOWN)
        squares += np.where(told, square, 0.0)
        logs += np.where(told, np.log(spread), 0.0)
        seen += told
    cost = seen * np.log(np.maximum(squares, 1e-300) / np.maximum(seen, 1)) + logs
    likeliest = RATIOS[cost.argmin(axis=0)][None]
    return np.concatenate([level for level, _, _ in _levels(off, count, likeliest)])


def _levels(off: Floats, count: Floats, ratio: Floats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """At each instant the level (G, W), the square of its error before, and that square's expectation.

    Both are over the variance of the noise; the expectation is 1 where nothing is told.

    Args:
      off, count: as in `_walk`.
      ratio: (G, 1) or (G, W) variance of a step over that of the noise.
    """
    level = np.zeros((len(ratio), off.shape[1]))
    variance = np.full_like(level, UNKNOWN)
    for here, cables in zip(off, count, strict=True):
        spread = 1.0 + cables * variance
        error, share = here - level, cables / spread
        level = level + share * variance * error
        variance = variance / spread + ratio
        yield level, share * error**2, spread
