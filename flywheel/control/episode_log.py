"""Log of an episode in progress: measurements, commands, and the resulting winch positions."""

from __future__ import annotations

import numpy as np

from flywheel.dynamics.plant import Reckoning
from flywheel.dynamics.plant.reckoning import APART
from flywheel.records import Floats, Observation, Past, State, Trajectory
from flywheel.robots import Robot
from flywheel.terrain import Terrain


class EpisodeLog:
    """Measurements and commands on a grid of control steps.

    Args:
      robot: measured robot.
      dt: control step [s].
      steps: maximum number of commands.
      reckoning: of unmeasured winches.
      terrain: under the robot.
      dataset: index of the data set assumed by a network.
    """

    def __init__(
        self,
        robot: Robot,
        dt: float,
        steps: int,
        reckoning: Reckoning,
        terrain: Terrain | None = None,
        dataset: int = 0,
    ) -> None:
        self.robot, self.dt, self.terrain, self._reckoning = robot, dt, terrain, reckoning
        self.dataset = dataset
        self.done = 0
        self._newest, self._next_look = 0, 0
        self._last_lengths: Floats = np.zeros((1, len(robot.cables)))
        self._points = np.full((1, steps + 1, len(robot.points), 3), np.nan)
        self._winch = np.full((1, steps + 1, len(robot.winches)), np.nan)
        self._reckoned = np.empty_like(self._winch)
        self._reckoned[:] = robot.winch_of(robot.keyframe)
        self._controls = np.empty((1, steps, len(robot.winches)))

    def see(self, observations: Observation, first: int) -> None:
        """Add measurements (1, n, ...) of the control steps from `first` on."""
        end = first + observations.points.shape[1]
        self._points[:, first:end], self._winch[:, first:end] = (
            observations.points,
            observations.winch,
        )
        self._newest = max(self._newest, end - 1)
        if first == 0:
            begin = self._winch[:, 0]
            self._reckoned[:, 0] = np.where(np.isfinite(begin), begin, self._reckoned[:, 0])

    def command(self, controls: Floats) -> None:
        """Add the next commands (n, W)."""
        now, after = self.done, self.done + len(controls)
        self._controls[0, now:after] = controls
        self.done = after
        told = self._reckoning.told(self._controls[0, :after])[now:]
        self._reckoned[0, now : after + 1] = self._reckoning.wound(
            self._reckoned[0, now], told, self._lengths(now, after)
        )

    def past(self, state: State | None = None, planned: Floats | None = None) -> Past:
        """The past, up to the newest measurement.

        A winch counts as measured only if it was measured at every step so far; otherwise it would
        seem to jump.

        Args:
          state: (1,) of the plant, for the oracle.
          planned: (c, W) commands that are already fixed.
        """
        end = min(self._newest, self.done)
        seen = self._winch[:, : end + 1]
        measured = np.isfinite(seen).all(axis=1, keepdims=True)
        pending = self._controls[:, end : self.done]
        if planned is not None:
            pending = np.concatenate([pending, planned[None]], axis=1)
        return Past(
            observations=Observation(self._points[:, : end + 1], seen),
            controls=self._controls[:, :end],
            winch=np.where(
                measured, self._reckoning.earlier(seen[0]), self._reckoned[:, : end + 1]
            ),
            pending=pending,
            dataset=self.dataset,
            state=state,
            terrains=(self.terrain,),
        )

    def trajectory(self, states: State | None = None) -> Trajectory:
        """The whole episode, unbatched."""
        end = slice(None, self.done + 1)
        observations = Observation(self._points[0, end].copy(), self._winch[0, end].copy())
        return Trajectory(observations, self._controls[0, : self.done].copy(), self.dt, states)

    def _lengths(self, first: int, end: int) -> Floats | None:
        """(end - first, C) lengths of the cables, if they are needed [m]; kept constant over short gaps."""
        if not self._reckoning.loaded:
            return None
        if end >= self._next_look:
            self._last_lengths = self._reckoning.lengths(
                self._points[0, : end + 1], self._reckoned[0, first], end - first
            )
            self._next_look = end + round(APART / self.dt)
            return self._last_lengths
        return np.repeat(self._last_lengths[-1:], end - first, axis=0)
