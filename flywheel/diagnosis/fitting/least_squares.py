"""Fit sizes of effects to measurements, beside what is unknown about every window.

Output error: the difference of measured and predicted positions is made small, never a difference of
velocities or forces. What is unknown about a window belongs to it alone, so that it is eliminated
window by window (Schur complement). What that is depends on the model under test: the state that a
plant starts from (`start_fit`), or the error that a network makes anyway (`network_fit`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from flywheel.diagnosis.fitting.jacobian_cache import SHARED_DAMPING, Held, Linear, astray
from flywheel.diagnosis.fitting.levenberg_marquardt import damped_step
from flywheel.diagnosis.fitting.parameters import Free
from flywheel.diagnosis.fitting.simulation import Carried, Starts
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.effects import Terms
from flywheel.records import Floats

LEAST_DAMPING = 1e-4  # of a window's own steps
STUCK = 1.3  # mean square of a window, over the usual one, at which its start is doubted
STEPS = 3  # of a fit between two linearisations
MANY = 12  # sizes from which their sensitivities, too, are held for all of these
# Fall of the cost below which a fit has converged: relative, and far below what tells models apart.
ENOUGH, LITTLE = 0.001, 2.0


@dataclass(frozen=True)
class Fit:
    """Windows' unknowns, and terms, that fit the measurements.

    Attributes:
      starts: of the plant.
      terms: with fitted values.
      change: (K, X) what is unknown about windows: how far starts are from their first estimates, in
        natural units, or how much of each of its errors a network makes.
      points: (K, steps + 1, P, 3) predicted [m].
      residual: (K, D) measured minus predicted, in sigmas; 0 where nothing was measured.
      carried: what the windows began with.
      cost: sum of squares, with priors.
      converged: the last step hardly changed the cost.
      held: sensitivities from nearby; None where there are none.
    """

    starts: Starts
    terms: Terms
    change: Floats
    points: Floats
    residual: Floats
    carried: Carried
    cost: float
    converged: bool = False
    held: Held | None = None


class Fitter(ABC):
    """Fits one set of windows with one model.

    Args:
      windows: to be fitted.
      prior: (X,) standard deviations of what is unknown about each window, around zero.
      winch_prior: of the winches' offsets [m].
    """

    def __init__(self, windows: Windows, prior: Floats, winch_prior: float) -> None:
        self.windows, self.prior, self.winch_prior = windows, prior, winch_prior

    @property
    @abstractmethod
    def time_steps(self) -> Floats:
        """(K,) MuJoCo's steps in each window [s]."""

    @abstractmethod
    def at(self, change: Floats, winch: Floats, terms: Terms) -> Fit:
        """Predictions and cost at given unknowns."""

    @abstractmethod
    def linear(self, fit: Fit, precise: bool = True) -> Linear:
        """Sensitivities around a fit."""

    @abstractmethod
    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(n, K, steps + 1, P, 3) points if a fit's terms are replaced by each of n [m]."""

    @abstractmethod
    def step_error(self, fit: Fit) -> Floats:
        """(K, D, n) how the prediction changes with smaller time steps: numbers, not physics."""

    @abstractmethod
    def stepped(self, fit: Fit, held: Held, left: Floats, winch: Floats, terms: Terms) -> Fit:
        """A fit with other offsets and terms, its windows' own unknowns moved towards `left` (K, D).

        Where none of it makes the cost fall, they may as well stay.
        """

    @abstractmethod
    def rms(self, fit: Fit) -> float:
        """What a fit is off, per degree of freedom [m]."""

    def coarse(self, fit: Fit, tolerated: float) -> np.ndarray:
        """(K,) windows that shorter time steps, if they can have them, change by more than `tolerated`."""
        del tolerated
        return np.zeros(len(fit.change), bool)

    def refined(self, where: np.ndarray) -> Self:
        """The same with time steps of half the length in windows `where` (K,)."""
        del where
        return self

    def renewed(self, fit: Fit) -> Held:
        """Sensitivities around a fit, computed anew where those that it holds are stale."""
        if fit.held is not None and not fit.held.stale.any():
            return fit.held
        return Held.fresh(self.linear(fit, precise=False), fit.held)

    def elsewhere(
        self,
        fit: Fit,
        seed: int = 0,
        stuck: float = STUCK,
        usual: float | None = None,
        most: int | None = None,
    ) -> Fit:
        """A fit in which windows that got stuck begin elsewhere; the fit itself if none is better.

        Args:
          seed: of other beginnings.
          stuck: mean square of a window, over the usual one, from which it may have got stuck.
          usual: mean square of a window that is not stuck [sigma^2]; None for the median one.
          most: windows that begin elsewhere, the loudest ones; None for all that may have got stuck.
        """
        del seed, stuck, usual, most
        return fit

    def best_of(self, fit: Fit, other: Fit) -> Fit:
        """The better of two fits of one model, with what is better in the other one."""
        return min(fit, other, key=lambda each: each.cost)

    def beginning(self, terms: Terms = ()) -> Fit:
        """The first estimates as they are."""
        windows = self.windows
        winch = np.zeros((len(windows.logs), len(windows.robot.winches)))
        return self.at(np.zeros((len(windows), len(self.prior))), winch, terms)

    def roughly(self, terms: Terms, free: Sequence[Free]) -> Fit:
        """The first estimates as they are, with sizes of effects that suit them."""
        begun = self.beginning(terms)
        if not free:
            return begun
        unknowns = len(self.prior), begun.starts.winch.shape[1]
        nothing = Linear(*(np.zeros((*begun.residual.shape, count)) for count in unknowns))
        return self.refit(replace(begun, held=Held.fresh(nothing)), free)

    def under_or_anew(self, fit: Fit, terms: Terms, free: Sequence[Free] = ()) -> Fit:
        """Other terms, before starts are fitted to them: each window begins as before or as first estimated.

        What is better is taken: starts that made up for a wrong model may lead astray, and so may sizes
        that were seen from there.
        """
        here, first = self.under(fit, terms), self.roughly(terms, free)
        stale = np.ones(len(fit.change), bool)
        first = replace(first, held=None if here.held is None else here.held | stale)
        return self.best_of(here, first)

    def under(self, fit: Fit, terms: Terms) -> Fit:
        """The same unknowns with other terms, before anything is fitted to them."""
        return replace(self.at(fit.change, fit.starts.winch, terms), held=fit.held)

    def freedom(self, fit: Fit) -> int:
        """Degrees of freedom: what noise alone would cost."""
        return int(np.isfinite(self.windows.measured).sum()) - fit.change.size

    def mean_squares(self, fit: Fit) -> Floats:
        """(K,) mean square residual of each window [sigma^2]."""
        return self.windows.mean_square(fit.residual)

    def prior_cost(self, change: Floats) -> Floats:
        """(...) of changes (..., X)."""
        return ((change / self.prior) ** 2).sum(axis=-1)

    def fit(self, fit: Fit, free: Sequence[Free] = (), rounds: int = 8, enough: float = 0.0) -> Fit:
        """Levenberg-Marquardt from a fit, with sizes of effects free or none.

        Args:
          enough: fall of the cost in a round, below which it has converged, too.
        """
        for _ in range(rounds):
            before, anew = fit.cost, fit.held is None or bool(fit.held.stale.all())
            begun = replace(fit, held=self.renewed(fit))
            fit = self.refit(begun, free)
            if fit is begun and anew:  # differences of one side may have misled
                fit = self.refit(replace(fit, held=Held.fresh(self.linear(fit), fit.held)), free)
            if _hardly_fell(before, fit.cost, enough):
                if anew:
                    return replace(fit, converged=True)
                assert fit.held is not None
                fit = replace(fit, held=fit.held | np.ones(len(self.windows), bool))
        return fit

    def refit(self, fit: Fit, free: Sequence[Free], rounds: int = STEPS) -> Fit:
        """Steps with the starts' sensitivities held, as the fit has them: they are what costs time."""
        sizes = None
        for _ in range(rounds):
            if sizes is None or len(free) < MANY:
                sizes = self.by_size(fit, free)
            after = self.improved(fit, free, sizes)
            if after is None:
                break
            done = _hardly_fell(fit.cost, after.cost)
            fit = after
            if done:
                break
        return fit

    def columns(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(K, D, n) how the prediction changes if its terms are replaced, in sigmas."""
        difference = np.moveaxis(self.predictions(fit, terms) - fit.points[None], 0, 1)
        return self.windows.slope(difference, 1.0, np.arange(len(fit.change)))

    def by_size(self, fit: Fit, free: Sequence[Free]) -> Floats:
        """(K, D, n) sensitivities to sizes of effects."""
        if not free:
            return np.zeros((*fit.residual.shape, 0))
        moves = [f.step_from(fit.terms) for f in free]
        varied = [f.moved(fit.terms, move) for f, move in zip(free, moves, strict=True)]
        return self.columns(fit, varied) / moves

    def improved(self, fit: Fit, free: Sequence[Free], sizes: Floats) -> Fit | None:
        """One step of all unknowns, with sensitivities to sizes; None if none makes the cost fall.

        What windows share takes one common step, as little damped as will do; each window then takes
        what suits it.
        """
        assert fit.held is not None
        held, linear = fit.held, fit.held.linear
        by_shared = self.shared(linear, sizes)
        winches = fit.starts.winch
        matrix, pull = self._shared_normal(fit, linear, by_shared, free)
        bounds = np.repeat([[-np.inf], [np.inf]], winches.size, axis=1)
        bounds = np.concatenate(
            [bounds, np.reshape([f.room(fit.terms) for f in free], (-1, 2)).T], 1
        )
        for index in held.tried:
            step = damped_step(matrix, pull, SHARED_DAMPING[index], bounds)
            winch = winches + step[: winches.size].reshape(winches.shape)
            terms = fit.terms
            for f, size in zip(free, step[winches.size :], strict=True):
                terms = f.moved(terms, size)
            left = fit.residual - by_shared @ step
            after = self.stepped(fit, held, left, winch, terms)
            assert after.held is not None
            held = replace(held, own=after.held.own)
            if after.cost < fit.cost:
                own = np.einsum("kdx,kx->kd", linear.by_start, after.change - fit.change)
                went = replace(held, common=index, bold=False)
                went |= astray(fit.residual, left - own, after.residual)
                return replace(after, held=went)
        return None

    def shared(self, linear: Linear, sizes: Floats | None) -> Floats:
        """(K, D, S) dependence on what windows share: each log's winch offsets, then sizes."""
        windows = self.windows
        logs, winches = len(windows.logs), linear.by_winch.shape[2]
        own = np.zeros((*linear.by_winch.shape[:2], logs * winches))
        for k, log in enumerate(windows.log):
            own[k, :, log * winches : (log + 1) * winches] = linear.by_winch[k]
        return own if sizes is None else np.concatenate([own, sizes], axis=2)

    def normal(
        self, change: Floats, by_start: Floats, left: Floats, damping: float | Floats
    ) -> tuple[Floats, Floats]:
        """Normal equations of what is unknown about windows: (n, X, X) and (n, X); one damping or (n,)."""
        prior = 1.0 / self.prior**2
        local = by_start.swapaxes(1, 2) @ by_start + np.diag(prior)
        diagonal = np.einsum("kxx->kx", local)
        damped = np.multiply(np.reshape(damping, (-1, 1)), diagonal)
        local = local + damped[..., None] * np.eye(len(prior))
        return local, np.einsum("kdx,kd->kx", by_start, left) - prior * change

    def _shared_normal(
        self, fit: Fit, linear: Linear, shared: Floats, free: Sequence[Free]
    ) -> tuple[Floats, Floats]:
        """Normal equations (S, S), (S,) of what windows share, with their starts eliminated."""
        local, pull = self.normal(fit.change, linear.by_start, fit.residual, LEAST_DAMPING)
        cross = linear.by_start.swapaxes(1, 2) @ shared
        eliminated = np.linalg.solve(local, np.concatenate([cross, pull[..., None]], axis=2))
        whole = np.einsum("kds,kdt->st", shared, shared, optimize=True)
        right = np.einsum("kds,kd->s", shared, fit.residual)
        whole -= np.einsum("kxs,kxt->st", cross, eliminated[..., :-1])
        right -= np.einsum("kxs,kx->s", cross, eliminated[..., -1])
        offsets = np.arange(fit.starts.winch.size)
        whole[offsets, offsets] += 1.0 / self.winch_prior**2
        right[offsets] -= fit.starts.winch.ravel() / self.winch_prior**2
        known = np.array([1.0 / f.prior**2 for f in free])
        values = np.arange(offsets.size, len(whole))
        whole[values, values] += known
        right[values] -= known * [f.value(fit.terms) for f in free]
        return whole, right


def _hardly_fell(before: float, after: float, enough: float = 0.0) -> bool:
    """Whether a fit has converged."""
    return bool(np.isfinite(before)) and before - after < max(enough, min(ENOUGH * before, LITTLE))
