"""Nonlinear least squares: values of effects, together with the unknowns of every window.

Output error: the difference of measured and predicted positions is minimised, never a difference of
velocities or forces. Shared parameters (values of effects, offsets of winches) are common to
windows; local parameters belong to one window alone, so they are eliminated window by window (Schur
complement of the normal equations). The local parameters depend on the model under test: the
initial state of a plant (`plant_fit`), or the amounts of a network's own errors (`network_fit`).

With the residual r, the Jacobians J of the local and S of the shared parameters, and priors P and Q, a step
solves, window by window and then over all of them,

    [J'J + P   J'S  ] [local ]   [J'r - P local ]
    [S'J      S'S + Q] [shared] = [S'r - Q shared]   with damping on the diagonal (Levenberg-Marquardt).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from flywheel.diagnosis.fitting.parameters import FreeParameter, Key, free_parameters
from flywheel.diagnosis.fitting.simulation import Carried, InitialStates
from flywheel.diagnosis.fitting.stopping import converged, least_worthwhile_fall
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import FittingSettings
from flywheel.effects import Scales, Terms
from flywheel.records import Floats

# Dampings of the shared parameters' step, tried one after the other; infinite for no step.
SHARED_DAMPINGS = (0.0, 0.3, 10.0, np.inf)
# Of a window's own step: least for the shared parameters' equations, first, and at most with a new Jacobian.
LEAST_DAMPING, FIRST_DAMPING, MOST_WITH_NEW_JACOBIAN = 1e-4, 0.1, 1.0
STEPS = 3  # with one Jacobian
# Shared parameters that are many: their sensitivities, too, are kept for all these steps, as simulating them
# dominates the cost then, and the best of the dampings is used.
MANY = 12
# Error of a window's predicted change, relative to the change, above which its Jacobian is stale; and square
# of an error that is always negligible [sigma^2].
PREDICTION_ERROR = 0.3
# Change of the recordings by the whole prior of a number as built, beside initial states, below which its
# sensitivities are not computed again: it cannot explain more than noise [sigma].
LEAST_SHOWN = 1.0


@dataclass(frozen=True)
class Jacobian:
    """Derivatives of predictions with respect to the unknowns of windows, in sigmas; D measurements
    per window.

    Attributes:
      by_local: (K, D, X) change of the prediction with each local parameter: for a plant, with each entry
        of the initial state.
      by_winch: (K, D, W) with the offsets of the winches of the window's recording.
    """

    by_local: Floats
    by_winch: Floats


@dataclass(frozen=True)
class KeptColumns:
    """Sensitivities to many, nearly linear values: they are computed once.

    Attributes:
      keys: of each value, its column.
      columns: (K, D, n) in sigmas per unit.
    """

    keys: Mapping[Key, int]
    columns: Floats


@dataclass(frozen=True)
class JacobianCache:
    """A Jacobian computed during a fit, and its validity since then.

    Attributes:
      jacobian: the matrices; each window's may be from another iteration.
      stale: (K,) windows whose change differed from its prediction.
      damping: (K,) best for each window's last step.
      shared_damping: index of the best damping for the last step of the shared parameters.
      untried: no step of the shared parameters was taken with it yet.
      number: of recomputations.
      kept: sensitivities that are not recomputed.
    """

    jacobian: Jacobian
    stale: np.ndarray
    damping: Floats
    shared_damping: int = 0
    untried: bool = True
    number: int = 0
    kept: KeptColumns | None = None

    @classmethod
    def fresh(cls, jacobian: Jacobian, before: JacobianCache | None = None) -> JacobianCache:
        """A new Jacobian; windows with smaller damping `before` keep it."""
        fresh = np.zeros(len(jacobian.by_local), bool)
        if before is None:
            return cls(jacobian, fresh, np.full(len(fresh), FIRST_DAMPING))
        damping = np.minimum(before.damping, MOST_WITH_NEW_JACOBIAN)
        return cls(
            jacobian,
            fresh,
            damping,
            before.shared_damping,
            number=before.number + 1,
            kept=before.kept,
        )

    def outdated(self, stale: np.ndarray) -> JacobianCache:
        """The same with further stale windows (K,)."""
        return replace(self, stale=self.stale | stale)

    def tried(self, dampings: int) -> list[int]:
        """Indices of the shared parameters' `dampings`, in the order in which they are tried.

        From slightly less than the last best one; with a new Jacobian, first the least of all.
        """
        usual = list(range(max(0, self.shared_damping - 1), dampings))
        return [0, *usual] if self.untried and usual[0] > 0 else usual


@dataclass(frozen=True)
class Fit:
    """Parameters that fit the measurements of K windows, and the predictions.

    Attributes:
      initial: states and winch offsets at the plant's start.
      terms: effects with fitted values.
      local: (K, X) local parameters: deviations of initial states from their first estimates, in
        natural units, or amounts of a network's own errors.
      points: (K, steps + 1, P, 3) predicted [m].
      residual: (K, D) measured minus predicted, in sigmas; 0 for missing measurements.
      carried: starts of the windows.
      cost: sum of squares, with priors [sigma^2].
      converged: the last step hardly changed the cost.
      cache: a Jacobian from nearby; None if there is none.
    """

    initial: InitialStates
    terms: Terms
    local: Floats
    points: Floats
    residual: Floats
    carried: Carried
    cost: float
    converged: bool = False
    cache: JacobianCache | None = None

    @property
    def kept(self) -> KeptColumns | None:
        """Sensitivities that are not recomputed; None for none."""
        return None if self.cache is None else self.cache.kept

    def outdated(self, where: np.ndarray) -> Fit:
        """The same with a Jacobian that is stale in windows `where` (K,)."""
        return replace(self, cache=None if self.cache is None else self.cache.outdated(where))


@dataclass(frozen=True)
class Restart:
    """Windows that start elsewhere.

    Attributes:
      seed: of other initial states.
      stuck: mean square of a window, over the usual one, from which it may be stuck in a local minimum.
      usual: mean square of a window that is not stuck [sigma^2]; None for the median one.
      most: largest number of windows, those with the largest residuals; None for all that may be
        stuck.
    """

    seed: int = 0
    stuck: float = 1.3
    usual: float | None = None
    most: int | None = None


class Fitter(ABC):
    """Fits one set of windows with one model; as it is, one without errors, initial states or time steps.

    Args:
      windows: to be fitted.
      local_prior: (X,) standard deviations of the local parameters, around zero.
      winch_prior: of the winches' offsets [m].
      settings: of the diagnosis.
    """

    def __init__(
        self, windows: Windows, local_prior: Floats, winch_prior: float, settings: FittingSettings
    ) -> None:
        self.windows, self.local_prior, self.winch_prior = windows, local_prior, winch_prior
        self.settings = settings
        self.scales = Scales.of(windows.robot)

    @property
    @abstractmethod
    def time_steps(self) -> Floats:
        """(K,) MuJoCo's steps in each window [s]."""

    @property
    @abstractmethod
    def starts_are_free(self) -> bool:
        """True if initial states are fitted; else the model starts from the measurements."""

    @property
    def own_errors(self) -> Floats:
        """(K, D, n) draws of the model's own errors, including noise [sigma]; n may be 0."""
        return np.zeros((len(self.windows), int(np.prod(self.windows.measured.shape[1:])), 0))

    @abstractmethod
    def first_estimate(self, terms: Terms = ()) -> Fit:
        """The local parameters as first estimated, before anything is fitted."""

    @abstractmethod
    def with_terms(self, fit: Fit, terms: Terms) -> Fit:
        """The same parameters with other terms, before anything is fitted to them."""

    @abstractmethod
    def with_local(self, fit: Fit, local: Floats) -> Fit:
        """A fit at other local parameters (K, X)."""

    @abstractmethod
    def jacobian(self, fit: Fit) -> Jacobian:
        """The Jacobian around a fit."""

    def rough_jacobian(self, fit: Fit) -> Jacobian:
        """The same, sufficiently accurate for the direction of a fit."""
        return self.jacobian(fit)

    @abstractmethod
    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(n, K, steps + 1, P, 3) points with a fit's terms replaced by each of n [m]."""

    def step_error(self, fit: Fit) -> Floats:
        """(K, D, n) change of the prediction with smaller time steps: numerics, not physics [sigma]."""
        return np.zeros((*fit.residual.shape, 1))

    @abstractmethod
    def stepped(
        self, fit: Fit, cache: JacobianCache, left: Floats, winch: Floats, terms: Terms
    ) -> Fit:
        """A fit with other offsets and terms, its local parameters moved towards `left` (K, D).

        If no move reduces the cost, they may stay.
        """

    @abstractmethod
    def rms(self, fit: Fit) -> float:
        """Root mean square error of a fit, per degree of freedom [m]."""

    def finer(self, fit: Fit, tolerated: float) -> Self | None:
        """The same with half the time step in windows that change by more than `tolerated` [sigma].

        None if there is no such window, or its steps cannot be shorter.
        """
        return None

    def restarted(self, fit: Fit, restart: Restart) -> Fit:
        """A fit in which stuck windows start elsewhere; the fit itself if none is better."""
        return fit

    def best_of(self, fit: Fit, other: Fit) -> Fit:
        """The better of two fits of one model, with the better windows of the other one."""
        return min(fit, other, key=lambda each: each.cost)

    def free(self, terms: Terms) -> list[FreeParameter]:
        """All values of terms, as parameters of a fit."""
        return free_parameters(terms, self.scales, self.settings.believed)

    def renewed(self, fit: Fit) -> JacobianCache:
        """A Jacobian around a fit, recomputed in stale windows."""
        if fit.cache is not None and not fit.cache.stale.any():
            return fit.cache
        return self.cached(self.rough_jacobian(fit), fit.cache)

    def cached(self, jacobian: Jacobian, before: JacobianCache | None = None) -> JacobianCache:
        """A new Jacobian; see `JacobianCache.fresh`."""
        return JacobianCache.fresh(jacobian, before)

    def rough_estimate(
        self, terms: Terms, free: Sequence[FreeParameter], kept: KeptColumns | None = None
    ) -> Fit:
        """The local parameters as first estimated, with suitable values of effects."""
        begun = self.first_estimate(terms)
        if not free:
            return begun
        unknowns = len(self.local_prior), begun.initial.winch.shape[1]
        nothing = Jacobian(*(np.zeros((*begun.residual.shape, count)) for count in unknowns))
        cache = replace(self.cached(nothing), kept=kept)
        return self.lm_steps(replace(begun, cache=cache), free)

    def warm_start(self, fit: Fit, terms: Terms, free: Sequence[FreeParameter] = ()) -> Fit:
        """Other terms, before anything else is fitted to them: each window starts as before, or anew.

        The better start is used: initial states that compensated for a wrong model may mislead, and
        so may values estimated from them.
        """
        here, first = self.with_terms(fit, terms), self.rough_estimate(terms, free, fit.kept)
        first = replace(first, cache=here.cache).outdated(np.ones(len(fit.local), bool))
        return self.best_of(here, first)

    @cached_property
    def taken(self) -> Floats:
        """(K,) degrees of freedom taken by the local parameters from noisy coordinates in each window.

        All of them; with filled-in coordinates, those taken from the rest: a planar robot's height
        and tilt are determined by filled-in coordinates.
        """
        if not self.windows.filled.any():
            return np.minimum(self.windows.noisy_in_each, len(self.local_prior)).astype(float)
        by_local = self.rough_jacobian(self.first_estimate()).by_local
        bases = local_bases(by_local, self.local_prior)[:, : by_local.shape[1]]
        return np.asarray(self.windows.squares(bases).sum(axis=(1, 2)))

    @property
    def freedom(self) -> float:
        """Degrees of freedom: the expected cost of noise alone."""
        return float(self.windows.noisy.sum() - self.taken.sum())

    def worthwhile(self, fit: Fit) -> float:
        """Decrease of the cost worth another round; 0 for a model that may be right."""
        return least_worthwhile_fall(fit.cost, self.freedom, self.settings.stopping)

    def mean_squares(self, fit: Fit) -> Floats:
        """(K,) mean square residual of each window [sigma^2]."""
        return self.windows.mean_square(fit.residual)

    def local_cost(self, local: Floats) -> Floats:
        """(...) cost of local parameters (..., X) by their prior."""
        return ((local / self.local_prior) ** 2).sum(axis=-1)

    def fit(
        self, fit: Fit, free: Sequence[FreeParameter] = (), rounds: int = 8, enough: float = 0.0
    ) -> Fit:
        """Levenberg-Marquardt from a fit; each round ends with a Jacobian that is stale somewhere.

        Args:
          fit: starting point.
          free: values of effects that are fitted, too.
          rounds: maximum number.
          enough: decrease of the cost in a round, below which it has converged, too [sigma^2].
        """
        for _ in range(rounds):
            before, anew = fit.cost, fit.cache is None or bool(fit.cache.stale.all())
            begun = replace(fit, cache=self.renewed(fit))
            fit = self.lm_steps(begun, free)
            if fit is begun and anew:  # differences of one side may have misled
                precise = self.cached(self.jacobian(fit), fit.cache)
                fit = self.lm_steps(replace(fit, cache=precise), free)
            if converged(before, fit.cost, self.settings.stopping, enough):
                if anew:
                    return replace(fit, converged=True)
                fit = fit.outdated(np.ones(len(self.windows), bool))
        return fit

    def lm_steps(self, fit: Fit, free: Sequence[FreeParameter]) -> Fit:
        """Steps with the present Jacobian, whose computation dominates the time."""
        columns = None
        for _ in range(STEPS):
            if columns is None or len(free) < MANY:
                columns = self.by_value(fit, free)
            after = self._step(fit, free, columns)
            if after is None:
                break
            done = converged(fit.cost, after.cost, self.settings.stopping)
            fit = after
            if done:
                break
        return fit

    def columns(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(K, D, n) change of the prediction with other terms, in sigmas."""
        difference = np.moveaxis(self.predictions(fit, terms) - fit.points[None], 0, 1)
        return self.windows.slope(difference, 1.0, np.arange(len(fit.local)))

    def by_value(self, fit: Fit, free: Sequence[FreeParameter]) -> Floats:
        """(K, D, n) sensitivities to n values of effects, in sigmas per unit."""
        if fit.kept is None:
            return self._by_value(fit, free)
        places = [fit.kept.keys.get(f.key(fit.terms), -1) for f in free]
        old = np.array(places, int)
        found = np.empty((*fit.residual.shape, len(free)))
        found[..., old >= 0] = fit.kept.columns[..., old[old >= 0]]
        new = [f for f, place in zip(free, places, strict=True) if place < 0]
        found[..., old < 0] = self._by_value(fit, new)
        return found

    def keeping(self, fit: Fit, terms: Terms) -> Fit:
        """A fit whose sensitivities to the values of some of its terms are computed now, and kept."""
        free = [f for f in self.free(fit.terms) if fit.terms[f.term] in terms]
        keys = {f.key(fit.terms): place for place, f in enumerate(free)}
        kept = KeptColumns(keys, self._by_value(fit, free))
        return replace(fit, cache=replace(self.renewed(fit), kept=kept))

    def kept_anew(self, fit: Fit) -> Fit:
        """A fit with its kept sensitivities computed anew, but for values that recordings hardly show."""
        if fit.kept is None:
            return fit
        kept, cache = fit.kept, self.renewed(fit)
        free = [f for f in self.free(fit.terms) if f.key(fit.terms) in kept.keys]
        places = np.array([kept.keys[f.key(fit.terms)] for f in free])
        bases = local_bases(cache.jacobian.by_local, self.local_prior)
        own = kept.columns[..., places]
        beside = bases[:, : own.shape[1]].swapaxes(1, 2) @ own
        shown = np.sqrt((own**2).sum(axis=(0, 1)) - (beside**2).sum(axis=(0, 1)))
        prior = np.array([f.prior for f in free])
        again = shown * prior >= LEAST_SHOWN
        columns = kept.columns.copy()
        anew = [f for f, wanted in zip(free, again, strict=True) if wanted]
        columns[..., places[again]] = self._by_value(fit, anew)
        return replace(fit, cache=replace(cache, kept=replace(kept, columns=columns)))

    def _by_value(self, fit: Fit, free: Sequence[FreeParameter]) -> Floats:
        if not free:
            return np.zeros((*fit.residual.shape, 0))
        moves = [f.step_from(fit.terms) for f in free]
        varied = [f.moved(fit.terms, move) for f, move in zip(free, moves, strict=True)]
        return self.columns(fit, varied) / moves

    def by_shared(self, jacobian: Jacobian, by_value: Floats | None) -> Floats:
        """(K, D, S) sensitivities to the shared parameters: each recording's winch offsets, then values."""
        windows = self.windows
        recordings, winches = len(windows.recordings), jacobian.by_winch.shape[2]
        own = np.zeros((*jacobian.by_winch.shape[:2], recordings * winches))
        for k, index in enumerate(windows.recording):
            own[k, :, index * winches : (index + 1) * winches] = jacobian.by_winch[k]
        return own if by_value is None else np.concatenate([own, by_value], axis=2)

    def normal_equations(
        self, local: Floats, by_local: Floats, left: Floats, damping: float | Floats
    ) -> tuple[Floats, Floats]:
        """Matrices (n, X, X) and right-hand sides (n, X) of local parameters; one damping or (n,)."""
        prior = 1.0 / self.local_prior**2
        matrix = by_local.swapaxes(1, 2) @ by_local + np.diag(prior)
        diagonal = np.einsum("kxx->kx", matrix)
        damped = np.multiply(np.reshape(damping, (-1, 1)), diagonal)
        matrix = matrix + damped[..., None] * np.eye(len(prior))
        return matrix, np.einsum("kdx,kd->kx", by_local, left) - prior * local

    def _step(self, fit: Fit, free: Sequence[FreeParameter], by_value: Floats) -> Fit | None:
        """One step of all parameters; None if none reduces the cost.

        The shared ones take one common step, with the least possible damping, or, if they are many,
        the best one: long steps of many lead to poor minima. Each window then takes its best step.
        """
        assert fit.cache is not None
        cache, jacobian = fit.cache, fit.cache.jacobian
        by_shared = self.by_shared(jacobian, by_value)
        winches = fit.initial.winch
        matrix, right = self._shared_equations(fit, jacobian, by_shared, free)
        bounds = np.repeat([[-np.inf], [np.inf]], winches.size, axis=1)
        bounds = np.concatenate(
            [bounds, np.reshape([f.room(fit.terms) for f in free], (-1, 2)).T], 1
        )
        best, many = None, len(free) >= MANY
        for index in cache.tried(len(SHARED_DAMPINGS)):
            step = damped_step(matrix, right, SHARED_DAMPINGS[index], bounds)
            winch = winches + step[: winches.size].reshape(winches.shape)
            terms = fit.terms
            for f, size in zip(free, step[winches.size :], strict=True):
                terms = f.moved(terms, size)
            left = fit.residual - by_shared @ step
            after = self.stepped(fit, cache, left, winch, terms)
            assert after.cache is not None
            cache = replace(cache, damping=after.cache.damping)
            if best is not None and after.cost >= best.cost:
                break
            if after.cost < fit.cost:
                own = np.einsum("kdx,kx->kd", jacobian.by_local, after.local - fit.local)
                went = replace(cache, shared_damping=index, untried=False)
                stale = _mispredicted(fit.residual, left - own, after.residual)
                best = replace(after, cache=went.outdated(stale))
                if not many:
                    break
        return best

    def _shared_equations(
        self, fit: Fit, jacobian: Jacobian, shared: Floats, free: Sequence[FreeParameter]
    ) -> tuple[Floats, Floats]:
        """Normal equations (S, S), (S,) of the shared parameters, with the local ones eliminated."""
        by_local, left = jacobian.by_local, fit.residual
        local, own = self.normal_equations(fit.local, by_local, left, LEAST_DAMPING)
        cross = by_local.swapaxes(1, 2) @ shared
        eliminated = np.linalg.solve(local, np.concatenate([cross, own[..., None]], axis=2))
        whole = np.einsum("kds,kdt->st", shared, shared, optimize=True)
        right = np.einsum("kds,kd->s", shared, left)
        whole -= np.einsum("kxs,kxt->st", cross, eliminated[..., :-1])
        right -= np.einsum("kxs,kx->s", cross, eliminated[..., -1])
        offsets = np.arange(fit.initial.winch.size)
        whole[offsets, offsets] += 1.0 / self.winch_prior**2
        right[offsets] -= fit.initial.winch.ravel() / self.winch_prior**2
        known = np.array([1.0 / f.prior**2 for f in free])
        values = np.arange(offsets.size, len(whole))
        whole[values, values] += known
        right[values] -= known * [f.value(fit.terms) for f in free]
        return whole, right


def local_bases(by_local: Floats, prior: Floats) -> Floats:
    """(K, D + X, X) orthonormal bases of the changes by local parameters, and of their priors.

    Args:
      by_local: (K, D, X) sensitivities.
      prior: (X,) standard deviations of the parameters.
    """
    own = np.broadcast_to(np.diag(1.0 / prior), (len(by_local), len(prior), len(prior)))
    return np.linalg.qr(np.concatenate([by_local, own], axis=1))[0]


def damped_step(matrix: Floats, right: Floats, damping: float, bounds: Floats) -> Floats:
    """(S,) step of Levenberg-Marquardt with normal equations (S, S), (S,), within bounds (2, S).

    A parameter that would leave its bounds goes to the bound, and the others are solved again.
    """
    if np.isinf(damping):
        return np.zeros_like(right)
    damped = matrix + np.diag((damping + 1e-9) * np.diag(matrix) + 1e-12)
    step = np.linalg.solve(damped, right)
    within = np.clip(step, *bounds)
    free = step == within
    if not free.all():
        left = right[free] - damped[np.ix_(free, ~free)] @ within[~free]
        within[free] = np.linalg.solve(damped[np.ix_(free, free)], left)
    return np.clip(within, *bounds)


def _mispredicted(before: Floats, promised: Floats, after: Floats) -> np.ndarray:
    """(K,) windows whose residuals (K, D) differ from the prediction."""
    off, went = ((after - x) ** 2 for x in (promised, before))
    least = np.maximum(PREDICTION_ERROR**2 * went.sum(axis=1), PREDICTION_ERROR)
    return np.asarray(off.sum(axis=1) > least)
