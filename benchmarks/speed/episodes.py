"""Episodes to train on that need no store."""

from __future__ import annotations

import numpy as np

from flywheel.data import WindowBatch
from flywheel.dynamics.plant import Plant
from flywheel.robots import Robot


class Episodes:
    """Random controls on the plant, in memory; answers what training asks of a `WindowCache`."""

    datasets = ("nominal",)

    def __init__(self, robot: Robot, count: int, threads: int, steps: int = 500) -> None:
        low, high, size = robot.control_low, robot.control_high, len(robot.winches)
        knots = np.random.default_rng(0).uniform(low, high, (count, steps // 50, size))
        plant, self._controls = Plant(robot, threads=threads), np.repeat(knots, 50, axis=1)
        seen = plant.simulate(plant.rest(), self._controls).observations
        self._points, self._winch = seen.points, seen.winch

    def starts(self, length: int, past: int | None = None) -> np.ndarray:
        """All windows of a length, numbered."""
        count, steps = self._controls.shape[:2]
        return (np.arange(count)[:, None] * steps + np.arange(steps - length + 1)).ravel()

    def gather(self, starts: np.ndarray, length: int) -> WindowBatch:
        """The windows of these numbers."""
        episode, first = np.divmod(starts[:, None], self._controls.shape[1])
        rows = first + np.arange(length + 1)
        points, winch = self._points[episode, rows], self._winch[episode, rows]
        controls, dataset = self._controls[episode, rows[:, :-1]], np.zeros(len(starts), np.int64)
        return WindowBatch(points, points, controls, winch, winch, dataset)
