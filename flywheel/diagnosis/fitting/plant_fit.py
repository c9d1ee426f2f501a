"""A plant under test: the initial states of all windows are fitted, together with values of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice
from typing import Self

import numpy as np

from flywheel.diagnosis.fitting.jacobian import STATE_STEPS, FiniteDifferences
from flywheel.diagnosis.fitting.least_squares import (
    LEAST_DAMPING,
    Fit,
    Fitter,
    Jacobian,
    JacobianCache,
    Restart,
)
from flywheel.diagnosis.fitting.multistart import AFTER, BEFORE
from flywheel.diagnosis.fitting.parameters import prior_cost
from flywheel.diagnosis.fitting.simulation import Carried, InitialStates, WindowSimulator
from flywheel.diagnosis.settings import FittingSettings
from flywheel.dynamics.plant import unseen_axes
from flywheel.dynamics.plant.restarted import FREE_VELOCITIES
from flywheel.effects import Terms
from flywheel.records import Floats, State

MULTIPLIERS = (0.3, 3.0)  # on the best damping of a window's last step, all of which are tried
MOST_DAMPING = 1e4
# Random rotations of the bodies about invisible axes, tried for each such window, and their deviation [rad].
ROTATIONS, ROTATION = 4, 0.4
DAMPINGS = (
    1e-4,
    1e-2,
    0.1,
    1.0,
    10.0,
)  # of a step from other initial states, all of which are tried
FINALISTS = 2  # initial states of each window that continue after the rounds `BEFORE`


class PlantFitter(Fitter):
    """Fits the initial states of a plant.

    Args:
      simulator: of the windows.
      first: (K,) first estimates of the initial states.
      settings: of the diagnosis.
    """

    def __init__(
        self,
        simulator: WindowSimulator,
        first: State,
        settings: FittingSettings = FittingSettings(),
    ) -> None:
        known = settings.initial_states
        prior = np.repeat([known.place_prior, known.motion.speed], simulator.tangent // 2)
        winch_prior = known.winch_prior * simulator.winch_unit
        super().__init__(simulator.windows, prior, winch_prior, settings)
        self.simulator, self.first, self._halved = simulator, first, simulator.halved()
        self.differences = FiniteDifferences(simulator, first)

    @property
    def time_steps(self) -> Floats:
        """(K,) MuJoCo's steps in each window [s]."""
        return np.asarray(self.windows.robot.timestep / self.simulator.fineness)

    @property
    def starts_are_free(self) -> bool:
        """True."""
        return True

    def first_estimate(self, terms: Terms = ()) -> Fit:
        """The initial states as first estimated, and the winches at their nominal positions."""
        windows = self.windows
        winch = np.zeros((len(windows.recordings), len(windows.robot.winches)))
        return self.at(np.zeros((len(windows), len(self.local_prior))), winch, terms)

    def with_terms(self, fit: Fit, terms: Terms) -> Fit:
        """The same initial states with other terms."""
        return replace(self.at(fit.local, fit.initial.winch, terms), cache=fit.cache)

    def with_local(self, fit: Fit, local: Floats) -> Fit:
        """A fit at other initial states."""
        return self.at(local, fit.initial.winch, fit.terms)

    def at(self, local: Floats, winch: Floats, terms: Terms) -> Fit:
        """Predictions and cost at given parameters.

        Args:
          local: (K, X) deviations of initial states from their first estimates, in natural units.
          winch: (recordings, W) offsets of the winches [m].
          terms: effects with their values.
        """
        initial = InitialStates(self.simulator.moved(self.first, local), winch)
        (points,), (carried,) = self.simulator.chained(initial, [terms])
        return self._predicted(initial, terms, local, points, carried)

    def _predicted(
        self, initial: InitialStates, terms: Terms, local: Floats, points: Floats, carried: Carried
    ) -> Fit:
        """Cost of these points (K, steps + 1, P, 3)."""
        residual = self.windows.residual(points)
        cost = float((residual**2).sum() + self.local_cost(local).sum())
        cost += self._shared_cost(initial.winch, terms)
        if not np.isfinite(points).all():
            cost = np.inf
        return Fit(initial, terms, local, points, residual, carried, cost)

    def _shared_cost(self, winch: Floats, terms: Terms) -> float:
        """Cost of the shared parameters by their priors."""
        return float(((winch / self.winch_prior) ** 2).sum()) + prior_cost(terms)

    def jacobian(self, fit: Fit) -> Jacobian:
        """By two-sided differences, in the time steps of each window."""
        return self.differences.precise(fit, np.arange(len(self.windows)))

    def rough_jacobian(self, fit: Fit) -> Jacobian:
        """By one-sided differences, of other sizes than the last time."""
        return self._rough(fit, np.arange(len(self.windows)))

    def renewed(self, fit: Fit) -> JacobianCache:
        """A Jacobian around a fit, recomputed in its stale windows only."""
        if fit.cache is None:
            return super().renewed(fit)
        stale = np.flatnonzero(fit.cache.stale)
        if not len(stale):
            return fit.cache
        old, new = fit.cache.jacobian, self._rough(fit, stale)
        by_local, by_winch = old.by_local.copy(), old.by_winch.copy()
        by_local[stale], by_winch[stale] = new.by_local, new.by_winch
        return self.cached(Jacobian(by_local, by_winch), fit.cache)

    def _rough(self, fit: Fit, members: np.ndarray) -> Jacobian:
        """A rough Jacobian of windows `members` (n,)."""
        turn = 0 if fit.cache is None else fit.cache.number + 1
        return self.differences.rough(fit, members, STATE_STEPS[turn % len(STATE_STEPS)])

    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(n, K, steps + 1, P, 3) points with a fit's terms replaced by each of n [m]."""
        return self.simulator.chained(fit.initial, list(terms))[0]

    def step_error(self, fit: Fit) -> Floats:
        """(K, D, 1) change by half the time step [sigma]."""
        points, _ = self._halved.chained(fit.initial, [fit.terms])
        difference = (points - fit.points[None]).swapaxes(0, 1)
        return self.windows.slope(difference, 1.0, np.arange(len(fit.points)))

    def finer(self, fit: Fit, tolerated: float) -> Self | None:
        """The same with half the time step if that changes more than `tolerated` [sigma].

        Quarters are seldom better, and take twice as long.
        """
        square = self.windows.mean_square(self.step_error(fit)[..., 0])
        coarse = np.asarray((square > tolerated**2) & (self.simulator.fineness == 1))
        return self.halved(coarse) if coarse.any() else None

    def halved(self, where: np.ndarray) -> Self:
        """The same with time steps of half the length in windows `where` (K,)."""
        return type(self)(self.simulator.halved(where), self.first, self.settings)

    def rms(self, fit: Fit) -> float:
        """Root mean square error of the points [m]; the initial states count as degrees of freedom."""
        windows, points = self.windows, slice(len(self.windows.robot.points))
        left = fit.residual.reshape(windows.measured.shape)[:, :, points]
        freedom = windows.noisy[:, :, points].sum() - self.taken.sum()
        return float(np.sqrt((left**2).sum() / max(1, freedom))) * windows.sigma

    def stepped(
        self, fit: Fit, cache: JacobianCache, left: Floats, winch: Floats, terms: Terms
    ) -> Fit:
        """Each window takes its best damping, or does not move."""
        tried = np.multiply.outer(MULTIPLIERS, cache.damping).clip(LEAST_DAMPING, MOST_DAMPING)
        by_local = cache.jacobian.by_local
        steps = np.stack([self._steps(fit.local, by_local, left, each) for each in tried])
        if not steps.any():
            return replace(self.at(fit.local, winch, terms), cache=cache)
        locals_ = fit.local + np.concatenate([np.zeros_like(fit.local)[None], steps])
        points, carried = self._trials(fit, winch, terms, locals_)
        windows = np.arange(len(fit.local))
        costs = np.stack([self._cost(p, windows, c) for p, c in zip(points, locals_, strict=True)])
        best, damping = costs.argmin(axis=0), np.concatenate([tried[-1:], tried])
        cache = replace(cache, damping=damping[best, windows])
        if costs[best, windows].sum() + self._shared_cost(winch, terms) >= fit.cost:
            best = np.zeros_like(best)
        local = locals_[best, windows]
        if best.any() and not self.simulator.apart(terms):  # what windows begin with changes, too
            return replace(self.at(local, winch, terms), cache=cache)
        initial = InitialStates(self.simulator.moved(self.first, local), winch)
        after = self._predicted(initial, terms, local, points[best, windows], carried)
        return replace(after, cache=cache)

    def restarted(self, fit: Fit, restart: Restart) -> Fit:
        """A fit in which stuck windows start elsewhere; the fit itself if none is better.

        Windows that fit much worse than the others may have started in a wrong place, or have been
        misled by a wrong model: they are restarted from their present states, from their first
        estimates, and with their bodies turned at random about invisible axes.
        """
        square, usual = self.mean_squares(fit), restart.usual
        if usual is None:  # a window by itself has no others to be compared with
            usual = float(np.median(square)) if len(square) > 1 else 1.0
        loudest = np.argsort(-square)[: restart.most]
        doubted = np.sort(loudest[square[loudest] > restart.stuck * max(1.0, usual)])
        if not len(doubted):
            return fit
        here = fit.local[doubted]
        turned = self._turned(np.repeat(here, ROTATIONS, axis=0), restart.seed)
        tried = np.concatenate([here, np.zeros_like(here), turned])
        members = np.concatenate([doubted, doubted, np.repeat(doubted, ROTATIONS)])
        return self.searched(fit, members, tried)

    def best_of(self, fit: Fit, other: Fit) -> Fit:
        """The better of two fits of one model, in which each window starts where it fits better."""
        fit, other = sorted((fit, other), key=lambda each: each.cost)
        members = np.arange(len(fit.local))
        own, its = (
            self.costs(fit.carried, fit.terms, members, each.local) for each in (fit, other)
        )
        moved = its < own
        local = np.where(moved[:, None], other.local, fit.local)
        mixed = self.at(local, fit.initial.winch, fit.terms)
        if mixed.cost >= fit.cost:
            return fit
        return replace(mixed, cache=fit.cache).outdated(moved)

    def _turned(self, local: Floats, seed: int) -> Floats:
        """Local parameters (n, X) with random rotations of the bodies about their invisible axes."""
        rng, local = np.random.default_rng(seed), local.copy()
        for body, axis in unseen_axes(self.windows.robot).items():
            turn = FREE_VELOCITIES * body + np.arange(3, 6)
            local[:, turn] += rng.normal(0.0, ROTATION, (len(local), 1)) * axis
        return local

    def _trials(
        self, fit: Fit, winch: Floats, terms: Terms, locals_: Floats
    ) -> tuple[Floats, Carried]:
        """Windows with other offsets and terms at (n, K, X), the first of which is the fit's.

        Returns:
          (n, K, steps + 1, P, 3) points of each window alone [m], and the starts of the first.
        """
        if terms == fit.terms and np.array_equal(winch, fit.initial.winch):
            known, carried = fit.points[None], fit.carried
        elif self.simulator.apart(terms):  # all in one batch
            known, carried = np.empty((0, *fit.points.shape)), self.simulator.began(winch, terms)
        else:
            stay = self.at(fit.local, winch, terms)
            known, carried = stay.points[None], stay.carried
        new = locals_[len(known) :]
        members = np.tile(np.arange(len(fit.local)), len(new))
        states = self.simulator.moved(self.first[members], new.reshape(len(members), -1))
        points = self.simulator.parallel(states, carried, terms, members)
        return np.concatenate([known, points.reshape(*new.shape[:2], *points.shape[1:])]), carried

    def costs(self, carried: Carried, terms: Terms, members: np.ndarray, local: Floats) -> Floats:
        """(n,) cost of each window alone, at local parameters (n, X)."""
        simulator = self.simulator
        states = simulator.moved(self.first[members], local)
        return self._cost(simulator.parallel(states, carried, terms, members), members, local)

    def _cost(self, points: Floats, members: np.ndarray, local: Floats) -> Floats:
        """(n,) cost of each window alone, with predicted points (n, steps + 1, P, 3)."""
        residual = self.windows.residual_of(members, points)
        cost = (residual**2).sum(axis=-1) + self.local_cost(local)
        return np.where(np.isfinite(points).all(axis=(1, 2, 3)), cost, np.inf)

    def _steps(
        self, local: Floats, by_local: Floats, left: Floats, damping: float | Floats
    ) -> Floats:
        """(n, X) steps of the initial states towards residuals (n, D)."""
        matrix, right = self.normal_equations(local, by_local, left, damping)
        return np.linalg.solve(matrix, right[..., None])[..., 0]

    def _stepped_alone(
        self, fit: Fit, members: np.ndarray, local: Floats, step: float
    ) -> tuple[Floats, Floats, Floats]:
        """A step of windows `members` (n,) from (n, X), each alone, with the best damping.

        Returns:
          Local parameters after it (n, X), and the cost (n,) before and after it.
        """
        states = self.simulator.moved(self.first[members], local)
        points = self.simulator.parallel(states, fit.carried, fit.terms, members)
        by_local = self.differences.rough_by_local(fit, members, local, points, step)
        left = np.nan_to_num(self.windows.residual_of(members, points))
        steps = np.stack([self._steps(local, by_local, left, d) for d in DAMPINGS])
        tried = np.concatenate([np.zeros_like(local)[None], steps]) + local
        rows = np.tile(members, len(steps))
        cost = self.costs(fit.carried, fit.terms, rows, tried[1:].reshape(-1, local.shape[1]))
        here = self._cost(points, members, local)
        cost = np.concatenate([here[None], cost.reshape(len(steps), -1)])
        best, each = cost.argmin(axis=0), np.arange(len(members))
        return tried[best, each], here, cost[best, each]

    def searched(self, fit: Fit, members: np.ndarray, local: Floats) -> Fit:
        """Windows from other initial states: each of `members` (n,) from (n, X), kept if it ends lower.

        After the elimination, each goes on as long as it may still become the lowest of its window.
        """
        rounds = BEFORE + AFTER
        local, cost, on = local.copy(), np.zeros(len(members)), np.ones(len(members), bool)
        for number, step in enumerate(islice(cycle(STATE_STEPS), rounds), 1):
            before = cost.copy()
            local[on], before[on], cost[on] = self._stepped_alone(fit, members[on], local[on], step)
            if number < BEFORE:
                continue
            if number == BEFORE:
                kept = _best_of_each(members, cost, FINALISTS)
                members, local, on = members[kept], local[kept], on[kept]
                before, cost = before[kept], cost[kept]
            least = np.array([cost[members == one].min() for one in members])
            with np.errstate(invalid="ignore"):  # both infinite
                fell, missing = before - cost, cost - least
            on &= fell > self.settings.stopping.converged_fall
            on &= missing <= (rounds - number) * fell
            if not on.any():
                break
        own = self.costs(fit.carried, fit.terms, np.arange(len(fit.local)), fit.local)
        found = fit.local.copy()
        for k, value, candidate in zip(members, cost, local, strict=True):
            if value < own[k]:
                own[k], found[k] = value, candidate
        after = self.at(found, fit.initial.winch, fit.terms)
        if after.cost >= fit.cost:
            return fit
        moved = (found != fit.local).any(axis=1)
        return replace(after, cache=fit.cache).outdated(moved)


def _best_of_each(members: np.ndarray, cost: Floats, most: int) -> np.ndarray:
    """Indices of the `most` cheapest of each member."""
    cheapest = np.argsort(cost)
    return np.concatenate([cheapest[members[cheapest] == one][:most] for one in np.unique(members)])
