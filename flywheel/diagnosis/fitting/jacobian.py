"""Finite differences: derivatives of a plant's predictions with respect to the initial states of
its windows.
"""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Jacobian
from flywheel.diagnosis.fitting.simulation import WindowSimulator
from flywheel.records import Floats, State

# Steps of an initial state, in natural units: the first for accurate differences, all in turn for rough ones:
# contacts make every one of them blind somewhere.
STATE_STEPS = (2e-3, 8e-3, 5e-4)
WINCH_STEP = 1e-3  # of a winch's offset, in lengths of the robot
# Distance from the points in a window's own steps, in lengths of the robot, above which `hasty` ones lead
# nowhere: cables are too stiff for them. Shipped robots stay within a hundredth.
STRAY = 0.05


class FiniteDifferences:
    """Jacobians of a plant's predictions, accurate or rough ones.

    Accurate ones are two-sided differences, in the time steps of each window. Rough ones, for
    intermediate steps of a fit, are one-sided and in `hasty` steps, up to twice as long as the
    plant's own: a quarter of the price. They only give the direction; the residual is simulated
    accurately.

    Args:
      simulator: of the windows.
      first: (K,) reference initial states of the local parameters.
    """

    def __init__(self, simulator: WindowSimulator, first: State) -> None:
        self._simulator, self._first = simulator, first
        self._hasty = simulator.hasty()

    def precise(self, fit: Fit, members: np.ndarray) -> Jacobian:
        """The Jacobian of windows `members` (n,) around a fit."""
        simulator, local, step = self._simulator, fit.local[members], STATE_STEPS[0]
        ahead, behind = (self._aside(simulator, fit, members, local, s) for s in (step, -step))
        by_local = simulator.windows.slope(ahead - behind, 2 * step, members)
        return Jacobian(by_local, self._by_winch(simulator, fit, members, fit.points[members]))

    def rough(self, fit: Fit, members: np.ndarray, step: float) -> Jacobian:
        """The same, roughly, with differences of a `step` in natural units."""
        local = fit.local[members]
        simulator, here = self._begun(fit, members, local, fit.points[members])
        by_local = self._of_one_side(simulator, fit, members, local, here, step)
        return Jacobian(by_local, self._by_winch(simulator, fit, members, here))

    def rough_by_local(
        self, fit: Fit, members: np.ndarray, local: Floats, points: Floats, step: float
    ) -> Floats:
        """(n, D, X) of windows `members` (n,) at local parameters (n, X), by differences of a `step`.

        Their `points` (n, steps + 1, P, 3) there are in the time steps of each window [m].
        """
        simulator, here = self._begun(fit, members, local, points)
        return self._of_one_side(simulator, fit, members, local, here, step)

    def _begun(
        self, fit: Fit, members: np.ndarray, local: Floats, points: Floats
    ) -> tuple[WindowSimulator, Floats]:
        """Simulator of rough differences, and the points of windows at their origin.

        Windows that end up far from `points` in such steps keep their own.
        """
        simulator, states = self._hasty, self._simulator.moved(self._first[members], local)
        here = simulator.parallel(states, fit.carried, fit.terms, members)
        robot = simulator.windows.robot
        apart = np.square(here - points)[:, :, : len(robot.points)].sum(axis=3).mean(axis=(1, 2))
        lost = ~(apart <= (STRAY * robot.length) ** 2)  # or not finite
        if lost.any():
            able = ~np.isin(np.arange(len(simulator.windows)), members[lost])
            simulator = self._simulator.hasty(able)
            here = simulator.parallel(states, fit.carried, fit.terms, members)
        return simulator, here

    def _of_one_side(
        self,
        simulator: WindowSimulator,
        fit: Fit,
        members: np.ndarray,
        local: Floats,
        here: Floats,
        step: float,
    ) -> Floats:
        """(n, D, X) of windows with points `here` at the origin."""
        aside = self._aside(simulator, fit, members, local, step)
        return simulator.windows.slope(aside - here[:, None], step, members)

    def _aside(
        self, simulator: WindowSimulator, fit: Fit, members: np.ndarray, local: Floats, step: float
    ) -> Floats:
        """(n, X, steps + 1, P, 3) points at local parameters (n, X), with a step in each of them [m]."""
        size = simulator.tangent
        rows = np.repeat(members, size)
        tried = (local[:, None] + step * np.eye(size)).reshape(-1, size)
        states = simulator.moved(self._first[rows], tried)
        points = simulator.parallel(states, fit.carried, fit.terms, rows)
        return points.reshape(len(members), size, *points.shape[1:])

    def _by_winch(
        self, simulator: WindowSimulator, fit: Fit, members: np.ndarray, here: Floats
    ) -> Floats:
        """(n, D, W) with a change of each winch at the start of windows with points `here`."""
        winches = fit.initial.winch.shape[1]
        offset = WINCH_STEP * simulator.winch_unit
        rows = np.repeat(members, winches)
        shifted = fit.carried.winch[rows] + offset * np.tile(np.eye(winches), (len(members), 1))
        initial = fit.initial.mechanics[rows]
        points = simulator.parallel(initial, fit.carried, fit.terms, rows, shifted)
        points = points.reshape(len(members), winches, *points.shape[1:])
        return simulator.windows.slope(points - here[:, None], offset, members)
