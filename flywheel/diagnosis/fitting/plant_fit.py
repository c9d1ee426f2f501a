"""Fit the starts of all windows, and sizes of effects, to the measurements: a plant under test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import cycle, islice
from typing import Self

import numpy as np

from flywheel.diagnosis.fitting.jacobian import Differences
from flywheel.diagnosis.fitting.jacobian_cache import Held, Linear
from flywheel.diagnosis.fitting.least_squares import LEAST_DAMPING, STUCK, Fit, Fitter
from flywheel.diagnosis.fitting.parameters import term_cost
from flywheel.diagnosis.fitting.simulation import Carried, Predictor, Starts
from flywheel.dynamics.plant import unseen_axes
from flywheel.dynamics.plant.restarted import FREE_VELOCITIES
from flywheel.effects import Terms
from flywheel.records import Floats, State

DAMPING = (LEAST_DAMPING, 1e-2, 0.1, 1.0, 10.0)  # of a window's own step in a search
NEAR = (0.1, 1.0, 10.0)  # times what suited a window's last step, all of which are tried
MOST_DAMPING = 1e4
# Standard deviations of what is known about starts before any fit, in natural units.
PRIOR_PLACE, PRIOR_SPEED, PRIOR_WINCH = 0.1, 0.5, 0.003
FINEST = 2  # times shorter, at most: quarters are seldom better, and take twice as long
TRIES = 4  # of such a window with its bodies turned
TURN = 0.4  # standard deviation of their turns about axes that no point shows [rad]
# Of differences, in turn: contacts make every one of them blind somewhere.
SCALES = (2e-3, 8e-3, 5e-4)
SEARCHES, HEATS, FINALISTS = 6, 2, 2  # rounds; after how many of them only so many per window go on


class StartFitter(Fitter):
    """Fits the states from which a plant starts.

    Args:
      predictor: of the windows.
      first: (K,) first estimates of the starts.
    """

    def __init__(self, predictor: Predictor, first: State) -> None:
        prior = np.repeat([PRIOR_PLACE, PRIOR_SPEED], predictor.tangent // 2)
        super().__init__(predictor.windows, prior, PRIOR_WINCH * predictor.length)
        self.predictor, self.first, self.finer = predictor, first, predictor.finer()
        self.differences = Differences(predictor, first)

    @property
    def time_steps(self) -> Floats:
        """See `Fitter`."""
        return np.asarray(self.windows.robot.timestep / self.predictor.fineness)

    def at(self, change: Floats, winch: Floats, terms: Terms) -> Fit:
        """Predictions and cost at given unknowns."""
        predictor = self.predictor
        starts = Starts(predictor.moved(self.first, change), winch)
        (points,), (carried,) = predictor.chained(starts, [terms])
        return self._predicted(starts, terms, change, points, carried)

    def _predicted(
        self, starts: Starts, terms: Terms, change: Floats, points: Floats, carried: Carried
    ) -> Fit:
        """What these points (K, steps + 1, P, 3) cost."""
        residual = self.windows.residual(points)
        cost = float((residual**2).sum() + self.prior_cost(change).sum())
        cost += self._shared_cost(starts.winch, terms)
        if not np.isfinite(points).all():
            cost = np.inf
        return Fit(starts, terms, change, points, residual, carried, cost)

    def _shared_cost(self, winch: Floats, terms: Terms) -> float:
        """Of what windows share, by what is known before."""
        return float(((winch / self.winch_prior) ** 2).sum()) + term_cost(terms)

    def linear(self, fit: Fit, precise: bool = True) -> Linear:
        """See `Fitter`; where not precise, by differences of other sizes than the last time."""
        return self._linear(fit, np.arange(len(self.windows)), precise)

    def renewed(self, fit: Fit) -> Held:
        """See `Fitter`: of the stale windows only."""
        if fit.held is None:
            return super().renewed(fit)
        stale = np.flatnonzero(fit.held.stale)
        if not len(stale):
            return fit.held
        old, new = fit.held.linear, self._linear(fit, stale, precise=False)
        by_start, by_winch = old.by_start.copy(), old.by_winch.copy()
        by_start[stale], by_winch[stale] = new.by_start, new.by_winch
        return Held.fresh(Linear(by_start, by_winch), fit.held)

    def _linear(self, fit: Fit, members: np.ndarray, precise: bool) -> Linear:
        """Of windows `members` (n,)."""
        if precise:
            return self.differences.precise(fit, members)
        turn = 0 if fit.held is None else fit.held.number + 1
        return self.differences.rough(fit, members, SCALES[turn % len(SCALES)])

    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """See `Fitter`."""
        return self.predictor.chained(fit.starts, list(terms))[0]

    def step_error(self, fit: Fit) -> Floats:
        """See `Fitter`."""
        points, _ = self.finer.chained(fit.starts, [fit.terms])
        difference = (points - fit.points[None]).swapaxes(0, 1)
        return self.windows.slope(difference, 1.0, np.arange(len(fit.points)))

    def coarse(self, fit: Fit, tolerated: float) -> np.ndarray:
        """See `Fitter`."""
        square = self.windows.mean_square(self.step_error(fit)[..., 0])
        return np.asarray((square > tolerated**2) & (self.predictor.fineness < FINEST))

    def refined(self, where: np.ndarray) -> Self:
        """See `Fitter`."""
        return type(self)(self.predictor.finer(where), self.first)

    def rms(self, fit: Fit) -> float:
        """See `Fitter`; the fitted starts count as degrees of freedom."""
        left = (fit.residual**2).sum() / max(1, self.freedom(fit))
        return float(np.sqrt(left)) * self.windows.sigma

    def stepped(self, fit: Fit, held: Held, left: Floats, winch: Floats, terms: Terms) -> Fit:
        """See `Fitter`: each window takes the damping that suits it, or stays where it is."""
        tried = np.clip(np.multiply.outer(NEAR, held.own), LEAST_DAMPING, MOST_DAMPING)
        by_start = held.linear.by_start
        steps = np.stack([self._steps(fit.change, by_start, left, each) for each in tried])
        if not steps.any():
            return replace(self.at(fit.change, winch, terms), held=held)
        changes = fit.change + np.concatenate([np.zeros_like(fit.change)[None], steps])
        points, carried = self._trials(fit, winch, terms, changes)
        windows = np.arange(len(fit.change))
        costs = np.stack([self._cost(p, windows, c) for p, c in zip(points, changes, strict=True)])
        best, own = costs.argmin(axis=0), np.concatenate([tried[-1:], tried])
        held = replace(held, own=own[best, windows])
        if costs[best, windows].sum() + self._shared_cost(winch, terms) >= fit.cost:
            best = np.zeros_like(best)
        change = changes[best, windows]
        if best.any() and not self.predictor.apart(terms):  # what windows begin with changes, too
            return replace(self.at(change, winch, terms), held=held)
        starts = Starts(self.predictor.moved(self.first, change), winch)
        after = self._predicted(starts, terms, change, points[best, windows], carried)
        return replace(after, held=held)

    def elsewhere(
        self,
        fit: Fit,
        seed: int = 0,
        stuck: float = STUCK,
        usual: float | None = None,
        most: int | None = None,
    ) -> Fit:
        """See `Fitter`.

        Windows that fit much worse than the others may have begun in a wrong place, or have been led
        there by a wrong model: they are tried on from where they are, from their first estimates, and
        with their bodies turned at random as far as nobody sees it.
        """
        square = self.mean_squares(fit)
        if usual is None:  # a window by itself has no others to be compared with
            usual = float(np.median(square)) if len(square) > 1 else 1.0
        loudest = np.argsort(-square)[:most]
        doubted = np.sort(loudest[square[loudest] > stuck * max(1.0, usual)])
        if not len(doubted):
            return fit
        here = fit.change[doubted]
        turned = self._turned(np.repeat(here, TRIES, axis=0), seed)
        tried = np.concatenate([here, np.zeros_like(here), turned])
        return self.searched(
            fit, np.concatenate([doubted, doubted, np.repeat(doubted, TRIES)]), tried
        )

    def best_of(self, fit: Fit, other: Fit) -> Fit:
        """See `Fitter`: each window begins where it fits better."""
        fit, other = sorted((fit, other), key=lambda each: each.cost)
        members = np.arange(len(fit.change))
        own, its = (
            self.costs(fit.carried, fit.terms, members, each.change) for each in (fit, other)
        )
        moved = its < own
        change = np.where(moved[:, None], other.change, fit.change)
        mixed = self.at(change, fit.starts.winch, fit.terms)
        if mixed.cost >= fit.cost:
            return fit
        return mixed if fit.held is None else replace(mixed, held=fit.held | moved)

    def _turned(self, change: Floats, seed: int) -> Floats:
        """Changes (n, X) with random turns of the bodies about their unseen axes added."""
        rng, change = np.random.default_rng(seed), change.copy()
        for body, axis in unseen_axes(self.windows.robot).items():
            turn = FREE_VELOCITIES * body + np.arange(3, 6)
            change[:, turn] += rng.normal(0.0, TURN, (len(change), 1)) * axis
        return change

    def _trials(
        self, fit: Fit, winch: Floats, terms: Terms, changes: Floats
    ) -> tuple[Floats, Carried]:
        """Windows with other offsets and terms at changes (n, K, X), the first of which is the fit's.

        Returns:
          (n, K, steps + 1, P, 3) points of each window alone [m], and what the first begin with.
        """
        if terms == fit.terms and np.array_equal(winch, fit.starts.winch):
            known, carried = fit.points[None], fit.carried
        elif self.predictor.apart(terms):  # all in one batch
            known, carried = np.empty((0, *fit.points.shape)), self.predictor.began(winch, terms)
        else:
            stay = self.at(fit.change, winch, terms)
            known, carried = stay.points[None], stay.carried
        new = changes[len(known) :]
        members = np.tile(np.arange(len(fit.change)), len(new))
        states = self.predictor.moved(self.first[members], new.reshape(len(members), -1))
        points = self.predictor.parallel(states, carried, terms, members)
        return np.concatenate([known, points.reshape(*new.shape[:2], *points.shape[1:])]), carried

    def costs(self, carried: Carried, terms: Terms, members: np.ndarray, change: Floats) -> Floats:
        """(n,) cost of each window alone, at changes (n, X)."""
        predictor = self.predictor
        states = predictor.moved(self.first[members], change)
        return self._cost(predictor.parallel(states, carried, terms, members), members, change)

    def _cost(self, points: Floats, members: np.ndarray, change: Floats) -> Floats:
        """(n,) of each window alone, with predicted points (n, steps + 1, P, 3)."""
        residual = self.windows.residual_of(members, points)
        cost = (residual**2).sum(axis=-1) + self.prior_cost(change)
        return np.where(np.isfinite(points).all(axis=(1, 2, 3)), cost, np.inf)

    def _steps(
        self, change: Floats, by_start: Floats, left: Floats, damping: float | Floats
    ) -> Floats:
        """(n, X) steps of the starts towards residuals (n, D)."""
        local, pull = self.normal(change, by_start, left, damping)
        return np.linalg.solve(local, pull[..., None])[..., 0]

    def searched(self, fit: Fit, members: np.ndarray, change: Floats) -> Fit:
        """Windows from other starts: each of `members` (n,) from (n, X), kept where it ends lower."""
        for number, step in enumerate(islice(cycle(SCALES), SEARCHES)):
            states = self.predictor.moved(self.first[members], change)
            points = self.predictor.parallel(states, fit.carried, fit.terms, members)
            by_start = self.differences.roughly_by_start(fit, members, change, step)
            left = np.nan_to_num(self.windows.residual_of(members, points))
            steps = np.stack([self._steps(change, by_start, left, d) for d in DAMPING])
            tried = np.concatenate([np.zeros_like(change)[None], steps]) + change
            rows = np.tile(members, len(tried))
            cost = self.costs(fit.carried, fit.terms, rows, tried.reshape(-1, change.shape[1]))
            cost = cost.reshape(len(tried), -1)
            change = tried[cost.argmin(axis=0), np.arange(len(members))]
            if number + 1 == HEATS:
                through = _best_of(members, cost.min(axis=0), FINALISTS)
                members, change = members[through], change[through]
        cost = self.costs(fit.carried, fit.terms, members, change)
        own = self.costs(fit.carried, fit.terms, np.arange(len(fit.change)), fit.change)
        found = fit.change.copy()
        for k, value, candidate in zip(members, cost, change, strict=True):
            if value < own[k]:
                own[k], found[k] = value, candidate
        after = self.at(found, fit.starts.winch, fit.terms)
        if after.cost >= fit.cost:
            return fit
        moved = (found != fit.change).any(axis=1)
        return after if fit.held is None else replace(after, held=fit.held | moved)


def _best_of(members: np.ndarray, cost: Floats, most: int) -> np.ndarray:
    """Indices of the `most` cheapest of each member."""
    cheapest = np.argsort(cost)
    return np.concatenate([cheapest[members[cheapest] == one][:most] for one in np.unique(members)])
