"""Dead reckoning of unmeasured winches, with their known effects.

A winch that is faster, later or weaker than in its datasheet soon differs from the position
computed from its commands, and misleads a network or planner that starts there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from flywheel.dynamics.plant.laws import Group, grouped
from flywheel.dynamics.plant.measured_winches import with_tensions
from flywheel.dynamics.plant.poses import seen_poses
from flywheel.dynamics.plant.roll import relaxed, rest_lengths, unseen_axes
from flywheel.effects import CommandEffect, Terms, WinchEffect, Winches, points_late
from flywheel.records import Floats, Trajectory
from flywheel.robots import Robot
from flywheel.smoothing import interpolated

APART = 0.1  # between the instants at which lengths of cables are computed from what is seen [s]
PIECE = 0.5  # after which the turns of rods are relaxed with the winches where they are by then [s]
LOOK_BACK = 1.0  # for a point that is out of sight [s]
ROUNDS = 2  # rounds of the search for unseen rolls: to a hundredth of a radian


@dataclass(frozen=True)
class Reckoning:
    """Winch positions from commands, and from the observed load if that matters.

    Attributes:
      robot: of the winches.
      dt: control step [s].
      terms: known effects beyond the MJCF.
      speed: known ratio of the rate of rate winches to the commanded one (`PlantParameters`).
    """

    robot: Robot
    dt: float
    terms: Terms = ()
    speed: float = 1.0

    @cached_property
    def nominal(self) -> bool:
        """True if the winches have no known effects beyond the MJCF."""
        return self.speed == 1.0 and not any(
            isinstance(term.effect, CommandEffect | WinchEffect) and not term.absent
            for term in self.terms
        )

    @cached_property
    def loaded(self) -> bool:
        """True if the load of the winches matters."""
        return any(isinstance(t.effect, WinchEffect) and not t.absent for t in self.terms)

    def known(self, trajectory: Trajectory) -> Floats:
        """(T + 1, W) best estimate of the winch positions over an unbatched trajectory [m or N].

        Measured ones if available, see `Robot.known_winch`; else reckoned, and corrected by the measured
        tensions of cables. Where points are measured late, they are those of the points' time.
        """
        if points_late(self.terms):
            seen = trajectory.observations
            channels = (replace(c, values=self.earlier(c.values)) for c in trajectory.channels)
            seen = replace(seen, winch=self.earlier(seen.winch))
            trajectory = replace(trajectory, observations=seen, channels=tuple(channels))
        return with_tensions(self.robot, trajectory, self._reckoned(trajectory))

    def _reckoned(self, trajectory: Trajectory) -> Floats:
        """(T + 1, W) measured or reckoned positions."""
        seen, controls = trajectory.observations, trajectory.controls
        if self.nominal or np.isfinite(seen.winch).all():
            return self.robot.known_winch(seen.winch, controls, self.dt)
        told, now = self.told(controls), self.robot.first_winch(seen.winch[0], controls[:1])
        if not self.loaded:
            return self.wound(now, told, None, seen.winch)
        positions, piece = [now[None]], max(1, round(PIECE / self.dt))
        for begin in range(
            0, len(told), piece
        ):  # how rods are turned follows from the winches so far
            end = min(begin + piece, len(told))
            lengths = self.lengths(seen.points[: end + 1], now, end - begin)
            part = self.wound(now, told[begin:end], lengths, seen.winch[begin : end + 1])
            positions.append(part[1:])
            now = part[-1]
        return np.concatenate(positions)

    def earlier(self, values: Floats) -> Floats:
        """Values (T + 1, ...) beside the points, of the time of points that are measured late."""
        if not (late := points_late(self.terms) / self.dt):
            return values
        before = np.maximum(np.arange(len(values)) - late, 0.0)[None]
        return interpolated(values.reshape(1, len(values), -1), before)[0].reshape(values.shape)

    def told(self, controls: Floats) -> Floats:
        """(T, W) commands that reach the winches, given the commands (T, W) from an episode's
        beginning on.
        """
        told = np.clip(controls, self.robot.control_low, self.robot.control_high)[None]
        groups = grouped([self.terms], CommandEffect, len(self.robot.winches))  # type: ignore[type-abstract]
        for effect, _, values in sorted(groups, key=lambda group: group[0].stage):
            told = effect.command(told, values, self.robot, self.dt)
        return np.asarray(told[0]) * np.where(self.robot.rate_driven, self.speed, 1.0)

    def wound(
        self,
        start: Floats,
        told: Floats,
        lengths: Floats | None = None,
        measured: Floats | None = None,
    ) -> Floats:
        """(T + 1, W) positions [m] of winches that start at (W,) and receive commands (T, W).

        Args:
          lengths: (T, C) of the cables at each step, if winches are `loaded`; see `lengths` [m].
          measured: (T + 1, W) positions to use and to continue from; NaN if missing [m].
        """
        loaded = None if lengths is None else partial(self._loaded, lengths)
        return self.robot.wind(np.asarray(start, float), told, self.dt, measured, loaded)

    def _loaded(self, lengths: Floats, step: int, now: Floats, command: Floats) -> Floats:
        """(W,) equivalent commands for nominal winches that move as winches do under load."""
        robot = self.robot
        winches = Winches(now[None], self._load(lengths[step], now)[None])
        rates = robot.rates(now, command, self.dt)[None]
        for effect, _, values in self._winch_laws:
            rates = effect.rate(rates, winches, values)
        return robot.telling(now, rates[0], self.dt)

    @cached_property
    def _winch_laws(self) -> list[Group[WinchEffect]]:
        return grouped([self.terms], WinchEffect, len(self.robot.winches))  # type: ignore[type-abstract]

    def _load(self, lengths: Floats, winch: Floats) -> Floats:
        """(W,) tension of the most loaded cable of each winch [N]."""
        stretch = np.maximum(lengths - rest_lengths(self.robot, winch), 0.0)
        return np.asarray((self._carried * stretch).max(axis=1))

    @cached_property
    def _carried(self) -> Floats:
        """(W, C) stiffness of each winch's cables; 0 for other cables [N/m]."""
        carried = np.zeros((len(self.robot.winches), len(self.robot.cables)))
        for index, winch in enumerate(self.robot.winches):
            for cable in winch.cables:
                carried[index, cable] = self.robot.cables[cable].stiffness
        return carried

    def lengths(self, points: Floats, winch: Floats, last: int | None = None) -> Floats:
        """(last, C) lengths of the cables in the last steps, from points (T + 1, P, 3) until then [m].

        Undetermined rotations of the bodies are relaxed, with winches at (W,). Missing points are
        extrapolated on straight lines; cables of bodies with a point that was never seen are
        assumed slack.

        Raises:
          RobotError: some bodies are not free, so that points do not determine their poses.
        """
        self.robot.require_free("reckoned with winches whose load matters")
        steps = len(points) - 1 if last is None else last
        recent = points[-(steps + 1 + round(LOOK_BACK / self.dt)) :]
        unseen = np.asarray(~np.isfinite(recent).all(axis=2).any(axis=0))
        seen = _filled(recent)[-(steps + 1) :]
        at = np.unique(np.append(np.arange(0, steps, max(1, round(APART / self.dt))), steps - 1))
        poses = relaxed(
            self.robot,
            seen_poses(self.robot, seen[at]),
            np.repeat(winch[None], len(at), axis=0),
            unseen_axes(self.robot),
            ROUNDS,
        )
        lengths, every = self.robot.cable_lengths(poses), np.arange(steps)
        lengths[:, self._touching(unseen)] = 0.0
        return np.stack([np.interp(every, at, length) for length in lengths.T], axis=1)

    def _touching(self, points: np.ndarray) -> np.ndarray:
        """(C,) bool: cables that end on a body with one of the points (P,) bool."""
        bodies = {i for i, body in enumerate(self.robot.bodies) if points[list(body.points)].any()}
        return np.array([any(e.body in bodies for e in cable.ends) for cable in self.robot.cables])


def _filled(points: Floats) -> Floats:
    """Points (T + 1, P, 3), interpolated linearly; 0 for a point that is never seen."""
    filled, every = points.copy(), np.arange(len(points))
    for point in range(points.shape[1]):
        known = np.isfinite(points[:, point]).all(axis=1)
        if not known.any():
            filled[:, point] = 0.0
        elif not known.all():
            for axis in range(3):
                there = points[known, point, axis]
                filled[:, point, axis] = np.interp(every, every[known], there)
    return filled
