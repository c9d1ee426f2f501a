"""Fit the starts of all windows, and sizes of effects, to the measurements.

Output error: the difference of measured and predicted positions is made small, never a difference of
velocities or forces. Starts are unknowns like any other; each belongs to one window, so that they are
eliminated window by window (Schur complement).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.free import Free
from flywheel.diagnosis.prediction import Carried, Predictor, Starts
from flywheel.effects import Terms
from flywheel.records import Floats, State

STEP = 2e-3  # of a finite difference of a start, in natural units
WINCH_STEP = 1e-3  # of one of a winch's offset [L]
DAMPING = (1e-4, 1e-2, 0.1, 1.0, 10.0)
SHARES = (1.0, 0.3, 0.0)  # of the step of what windows share
STEPS = 3  # of a fit between two linearisations
ENOUGH = 0.001  # relative fall of the cost below which a fit has converged
# Standard deviations of what is known about starts before any fit, in natural units.
PRIOR_PLACE, PRIOR_SPEED, PRIOR_WINCH = 0.1, 0.5, 0.003


@dataclass(frozen=True)
class Linear:
    """How residuals depend on the starts, in sigmas.

    Attributes:
      by_start: (K, D, X) change of the prediction with each entry of a start.
      by_winch: (K, D, W) with the offsets of the winches of the window's log.
    """

    by_start: Floats
    by_winch: Floats


@dataclass(frozen=True)
class Fit:
    """Starts and terms that fit the measurements.

    Attributes:
      starts: fitted.
      terms: with fitted values.
      change: (K, X) how far the starts are from their first estimates, in natural units.
      points: (K, steps + 1, P, 3) predicted [m].
      residual: (K, D) measured minus predicted, in sigmas; 0 where nothing was measured.
      carried: what the windows began with.
      cost: sum of squares, with priors.
      converged: the last step hardly changed the cost.
    """

    starts: Starts
    terms: Terms
    change: Floats
    points: Floats
    residual: Floats
    carried: Carried
    cost: float
    converged: bool = False


class Fitter:
    """Fits one set of windows with one plant.

    Args:
      predictor: of the windows.
      first: (K,) first estimates of the starts.
      finer: of the same windows, with smaller time steps.
    """

    def __init__(self, predictor: Predictor, first: State, finer: Predictor) -> None:
        self.predictor, self.first, self.finer = predictor, first, finer
        half = predictor.tangent // 2
        self.prior = np.repeat([PRIOR_PLACE, PRIOR_SPEED], half)
        self.winch_prior = PRIOR_WINCH * predictor.length

    def beginning(self, terms: Terms = ()) -> Fit:
        """The first estimates as they are."""
        windows = self.predictor.windows
        winch = np.zeros((len(windows.logs), len(windows.robot.winches)))
        return self.at(np.zeros((len(windows), self.predictor.tangent)), winch, terms)

    def at(self, change: Floats, winch: Floats, terms: Terms) -> Fit:
        """Predictions and cost at given unknowns."""
        predictor = self.predictor
        starts = Starts(predictor.moved(self.first, change), winch)
        points, carried = predictor.chained(starts, [terms])
        residual = predictor.windows.residual(points[0])
        cost = float((residual**2).sum() + self.prior_cost(change).sum())
        cost += float(((winch / self.winch_prior) ** 2).sum())
        if not np.isfinite(points).all():
            cost = np.inf
        return Fit(starts, terms, change, points[0], residual, carried[0], cost)

    def prior_cost(self, change: Floats) -> Floats:
        """(...) of changes (..., X)."""
        return ((change / self.prior) ** 2).sum(axis=-1)

    def fit(self, fit: Fit, free: Sequence[Free] = (), rounds: int = 8) -> Fit:
        """Levenberg-Marquardt from a fit, with sizes of effects free or none."""
        for _ in range(rounds):
            after = self.refit(fit, self.linear(fit, precise=False), free, STEPS)
            fell = 1.0 - after.cost / fit.cost if np.isfinite(fit.cost) else 1.0
            fit = after
            if fell < ENOUGH:
                return replace(fit, converged=True)
        return fit

    def refit(self, fit: Fit, linear: Linear, free: Sequence[Free], rounds: int = 3) -> Fit:
        """Steps with the starts' sensitivities held: they are what costs time."""
        for _ in range(rounds):
            after = self.improved(fit, linear, free)
            if after is None:
                break
            fell = 1.0 - after.cost / fit.cost if np.isfinite(fit.cost) else 1.0
            fit = after
            if fell < ENOUGH:
                break
        return fit

    def linear(self, fit: Fit, precise: bool = True) -> Linear:
        """Differences around a fit, in one batch for all windows: of both sides where precise."""
        predictor = self.predictor
        count, winches = len(predictor.windows), fit.starts.winch.shape[1]
        everyone = np.arange(count)
        by_start = self.by_start(fit, everyone, fit.change, None if precise else fit.points)
        offset = WINCH_STEP * predictor.length
        members = np.repeat(everyone, winches)
        shifted = np.repeat(fit.carried.winch, winches, axis=0)
        shifted = shifted + offset * np.tile(np.eye(winches), (count, 1))
        after = predictor.parallel(
            fit.starts.mechanics[members], fit.carried, fit.terms, members, shifted
        )
        after = after.reshape(count, winches, *after.shape[1:])
        by_winch = self.slope(after - fit.points[:, None], offset, everyone)
        return Linear(by_start, by_winch)

    def by_start(
        self, fit: Fit, members: np.ndarray, change: Floats, here: Floats | None = None
    ) -> Floats:
        """(n, D, X) sensitivities of windows `members` (n,) at changes (n, X).

        Of both sides, or, at half the price, of one side against what is predicted `here`.
        """
        predictor, size = self.predictor, self.predictor.tangent
        sides = (1.0, -1.0) if here is None else (1.0,)
        steps = np.concatenate([side * np.eye(size) for side in sides]) * STEP
        tried = (change[:, None] + steps).reshape(-1, size)
        rows = np.repeat(members, len(steps))
        states = predictor.moved(self.first[rows], tried)
        points = predictor.parallel(states, fit.carried, fit.terms, rows)
        points = points.reshape(len(members), len(sides), size, *points.shape[1:])
        opposite = points[:, 1] if here is None else here[:, None]
        return self.slope(points[:, 0] - opposite, len(sides) * STEP, members)

    def slope(self, difference: Floats, step: float, members: np.ndarray) -> Floats:
        """(n, D, m) of differences (n, m, steps + 1, P, 3); 0 where nothing was measured."""
        windows = self.predictor.windows
        seen = np.isfinite(windows.measured[members])[:, None]
        slope = np.where(seen, difference / (step * windows.sigma), 0.0)
        flat = np.nan_to_num(slope.reshape(*slope.shape[:2], -1), nan=0.0)
        return flat.swapaxes(1, 2)

    def columns(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(K, D, n) how the prediction changes if its terms are replaced, in sigmas."""
        points, _ = self.predictor.chained(fit.starts, list(terms))
        difference = np.moveaxis(points - fit.points[None], 0, 1)
        return self.slope(difference, 1.0, np.arange(len(fit.change)))

    def step_error(self, fit: Fit) -> Floats:
        """(K, D, 1) how the prediction changes with smaller time steps: numbers, not physics."""
        points, _ = self.finer.chained(fit.starts, [fit.terms])
        return self.slope(
            (points - fit.points[None]).swapaxes(0, 1), 1.0, np.arange(len(points[0]))
        )

    def improved(self, fit: Fit, linear: Linear, free: Sequence[Free]) -> Fit | None:
        """One step of all unknowns; None if none makes the cost fall.

        What windows share takes one common step; each window then takes the damping that suits it.
        """
        moves = [f.step_from(fit.terms) for f in free]
        stepped = [f.moved(fit.terms, move) for f, move in zip(free, moves, strict=True)]
        sizes = self.columns(fit, stepped) / moves if free else None
        by_shared = self.shared(linear, sizes)
        winches = fit.starts.winch
        whole = self._shared_step(fit, linear, by_shared)
        for share in SHARES:
            step = share * whole
            winch = winches + step[: winches.size].reshape(winches.shape)
            terms = fit.terms
            for f, size in zip(free, step[winches.size :], strict=True):
                terms = f.moved(terms, size)
            left = fit.residual - by_shared @ step
            tries = np.stack([self._steps(fit.change, linear.by_start, left, d) for d in DAMPING])
            change = self._best_of_each(fit.change, tries, winch, terms)
            after = self.at(change, winch, terms)
            if after.cost < fit.cost:
                return after
        return None

    def _best_of_each(self, change: Floats, tries: Floats, winch: Floats, terms: Terms) -> Floats:
        """(K, X) of the steps (n, K, X), or none, what makes each window's own cost least."""
        predictor, count = self.predictor, len(change)
        start = predictor.moved(self.first, change)
        carried = predictor.chained(Starts(start, winch), [terms])[1][0]
        tried = np.concatenate([np.zeros_like(change)[None], tries]) + change
        members = np.tile(np.arange(count), len(tried))
        cost = self.costs(carried, terms, members, tried.reshape(-1, change.shape[1]))
        return tried[cost.reshape(len(tried), count).argmin(axis=0), np.arange(count)]

    def costs(self, carried: Carried, terms: Terms, members: np.ndarray, change: Floats) -> Floats:
        """(n,) cost of each window alone, at changes (n, X)."""
        predictor = self.predictor
        states = predictor.moved(self.first[members], change)
        points = predictor.parallel(states, carried, terms, members)
        residual = predictor.windows.residual_of(members, points)
        cost = (residual**2).sum(axis=-1) + self.prior_cost(change)
        cost[~np.isfinite(points).all(axis=(1, 2, 3))] = np.inf
        return cost

    def _steps(self, change: Floats, by_start: Floats, left: Floats, damping: float) -> Floats:
        """(n, X) steps of the starts towards residuals (n, D)."""
        local, pull = self._normal(change, by_start, left, damping)
        return np.linalg.solve(local, pull[..., None])[..., 0]

    def _normal(
        self, change: Floats, by_start: Floats, left: Floats, damping: float
    ) -> tuple[Floats, Floats]:
        """Normal equations of the starts: (n, X, X) and (n, X)."""
        prior = 1.0 / self.prior**2
        local = by_start.swapaxes(1, 2) @ by_start + np.diag(prior)
        diagonal = np.einsum("kxx->kx", local)
        local = local + damping * diagonal[..., None] * np.eye(len(prior))
        return local, np.einsum("kdx,kd->kx", by_start, left) - prior * change

    def shared(self, linear: Linear, sizes: Floats | None) -> Floats:
        """(K, D, S) dependence on what windows share: each log's winch offsets, then sizes."""
        windows = self.predictor.windows
        logs, winches = len(windows.logs), linear.by_winch.shape[2]
        own = np.zeros((*linear.by_winch.shape[:2], logs * winches))
        for k, log in enumerate(windows.log):
            own[k, :, log * winches : (log + 1) * winches] = linear.by_winch[k]
        return own if sizes is None else np.concatenate([own, sizes], axis=2)

    def _shared_step(self, fit: Fit, linear: Linear, shared: Floats) -> Floats:
        """(S,) step of what windows share, with their starts eliminated."""
        local, pull = self._normal(fit.change, linear.by_start, fit.residual, DAMPING[0])
        cross = linear.by_start.swapaxes(1, 2) @ shared
        eliminated = np.linalg.solve(local, np.concatenate([cross, pull[..., None]], axis=2))
        whole = np.einsum("kds,kdt->st", shared, shared, optimize=True)
        right = np.einsum("kds,kd->s", shared, fit.residual)
        whole -= np.einsum("kxs,kxt->st", cross, eliminated[..., :-1])
        right -= np.einsum("kxs,kx->s", cross, eliminated[..., -1])
        offsets = np.arange(fit.starts.winch.size)
        whole[offsets, offsets] += 1.0 / self.winch_prior**2
        right[offsets] -= fit.starts.winch.ravel() / self.winch_prior**2
        whole += np.diag(1e-9 * np.diag(whole) + 1e-12)
        return np.linalg.solve(whole, right)

    def searched(self, fit: Fit, members: np.ndarray, change: Floats, rounds: int = 4) -> Fit:
        """Windows from other starts: each of `members` (n,) from (n, X), kept where it ends lower."""
        for _ in range(rounds):
            states = self.predictor.moved(self.first[members], change)
            points = self.predictor.parallel(states, fit.carried, fit.terms, members)
            by_start = self.by_start(fit, members, change, points)
            left = np.nan_to_num(self.predictor.windows.residual_of(members, points))
            steps = np.stack([self._steps(change, by_start, left, d) for d in DAMPING])
            tried = np.concatenate([np.zeros_like(change)[None], steps]) + change
            rows = np.tile(members, len(tried))
            cost = self.costs(fit.carried, fit.terms, rows, tried.reshape(-1, change.shape[1]))
            best = cost.reshape(len(tried), -1).argmin(axis=0)
            change = tried[best, np.arange(len(members))]
        cost = self.costs(fit.carried, fit.terms, members, change)
        own = self.costs(fit.carried, fit.terms, np.arange(len(fit.change)), fit.change)
        found = fit.change.copy()
        for k, value, candidate in zip(members, cost, change, strict=True):
            if value < own[k]:
                own[k], found[k] = value, candidate
        after = self.at(found, fit.starts.winch, fit.terms)
        return after if after.cost < fit.cost else fit
