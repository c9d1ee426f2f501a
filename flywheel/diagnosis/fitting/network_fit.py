"""Fit sizes of effects to what a trained model leaves: a network under test.

A network starts from the measured past, so that no start needs to be fitted; but it makes errors of its
own, larger than the noise. What it would make of the recorded motion is tried: a plant moves from fitted
starts through the recorded commands, which is taken for the truth, and the network predicts that from its
noisy past. Repeated from starts nearby, this gives the covariance of the network's own errors in every
window; what lies along them counts as little as it should. Half of the draws make the covariance, the
other half tell what it leaves of such errors, and so what a score must exceed.

An effect changes the motion, and also the past that the network sees of it. With the plant's motion y and
the network's prediction N, the network with an effect predicts

    N(measured past) + [y - N(past of y)] with the effect - [y - N(past of y)] without it.

The plant need not be right for this: it says what an effect changes, not where the robot goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flywheel.diagnosis.checks.adequacy import loudest, sample_correlation
from flywheel.diagnosis.fitting.initial_states import nominal_winch
from flywheel.diagnosis.fitting.jacobian_cache import Held, Linear
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.parameters import term_cost
from flywheel.diagnosis.fitting.plant_fit import StartFitter
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.selection.score_test import ScoreTest
from flywheel.dynamics.plant import Reckoning
from flywheel.effects import Terms
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, Past

DRAWS = 96
SHAKEN_PLACE, SHAKEN_SPEED = 0.01, 0.03  # of the starts of the draws, in natural units
BEYOND = 0.95  # quantile of its own errors that a network's residual must exceed


@dataclass(frozen=True)
class OwnErrors:
    """What a network's own errors would be taken for, at most.

    Attributes:
      score: best score of any candidate.
      noise, correlation, loudest: of what is left of them; see `Adequacy`.
    """

    score: float
    noise: float
    correlation: float
    loudest: float


class NetworkFitter(Fitter):
    """Fits terms to what a network leaves of windows.

    Args:
      world: of a plant, for the same windows; the network sees their first steps, and predicts the others.
      fit: of its starts, with any terms.
      terms: that the plant has already.
      model: under test.
      rng: of the draws.
      draws: of the network's own errors.

    Raises:
      ModelError: the model does not fit the windows, or is not finite in the plant's world.
    """

    def __init__(
        self,
        world: StartFitter,
        fit: Fit,
        terms: Terms,
        model: Subject,
        rng: np.random.Generator,
        draws: int = DRAWS,
    ) -> None:
        windows, history = world.windows, model.dynamics.history
        if windows.steps <= history:
            raise ModelError(
                f"The model looks back {history} steps; windows of {windows.steps} leave nothing to "
                "predict. Give longer windows, or longer recordings."
            )
        ahead = windows.measured.copy()
        ahead[:, : history + 1] = np.nan
        self._usable = _all_seen(windows.measured[:, : history + 1])
        ahead[~self._usable] = np.nan
        self._world, self._model = world, model
        self._starts, self._terms = fit.starts, terms
        self._around = fit.change
        self._past = windows
        places = list(zip(windows.log, windows.first, strict=True))
        steps = windows.steps
        self._controls = np.stack([windows.logs[i].controls[f : f + steps] for i, f in places])
        reckoning = Reckoning(windows.robot, windows.dt, model.terms)
        self._winch = nominal_winch(windows, reckoning)[:, : history + 1]
        super().__init__(replace(windows, measured=ahead), np.ones(0), world.winch_prior)
        worlds, (self._carried,) = world.predictor.chained(fit.starts, [terms])
        self._without = self._unseen(worlds)[0]
        self._measured = self._predicted(windows.measured[None])[0]
        modes, self._own = self._drawn(rng, draws)
        self._modes, size, _ = np.linalg.svd(modes, full_matrices=False)
        self._modes = self._modes * size[:, None]
        self.prior = np.ones(self._modes.shape[2])

    @property
    def time_steps(self) -> Floats:
        """See `Fitter`: of the plant that says what effects change."""
        return self._world.time_steps

    def at(self, change: Floats, winch: Floats, terms: Terms) -> Fit:
        """See `Fitter`; `change` does not matter, since the best is known."""
        del change, winch
        carried, points = self._carried, self._measured
        if terms != self._terms:
            worlds, (carried,) = self._world.predictor.chained(self._starts, [terms])
            points = points + (self._unseen(worlds)[0] - self._without)
        off = self.windows.residual(points)
        own = self._modes.swapaxes(1, 2)
        normal = own @ self._modes + np.eye(len(self.prior))
        change = np.linalg.solve(normal, own @ off[..., None])
        left = off - (self._modes @ change)[..., 0]
        change = change[..., 0]
        cost = float((left**2).sum() + self.prior_cost(change).sum()) + term_cost(terms)
        cost = cost if np.isfinite(points[self._usable]).all() else np.inf
        return Fit(self._starts, terms, change, points, left, carried, cost)

    def linear(self, fit: Fit, precise: bool = True) -> Linear:
        """See `Fitter`."""
        del precise
        count, size, _ = self._modes.shape
        return Linear(self._modes, np.zeros((count, size, fit.starts.winch.shape[1])))

    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """See `Fitter`."""
        worlds, _ = self._world.predictor.chained(self._starts, list(terms))
        return self._measured + (self._unseen(worlds) - self._without)

    def step_error(self, fit: Fit) -> Floats:
        """See `Fitter`: a network has no time step."""
        return np.zeros((*self._modes.shape[:2], 1))

    def stepped(self, fit: Fit, held: Held, left: Floats, winch: Floats, terms: Terms) -> Fit:
        """See `Fitter`."""
        return replace(self.at(fit.change, winch, terms), held=held)

    def rms(self, fit: Fit) -> float:
        """See `Fitter`: its own errors included, as it is used."""
        off = self.windows.residual(fit.points)
        measured = np.isfinite(self.windows.measured).sum()
        return float(np.sqrt((off**2).sum() / max(1, measured))) * self.windows.sigma

    def own_errors(self, test: ScoreTest) -> OwnErrors:
        """What a test makes of the network's own errors, in draws that it does not know."""
        measured = np.isfinite(self.windows.measured)
        by_window = measured.sum(axis=(1, 2, 3))
        found = []
        for draw in np.moveaxis(self._own, 2, 0):
            residual = test.projection(draw[..., None])[:, 0]
            noise = float(residual @ residual) / max(test.freedom, 1.0)
            best = max(s.score for s in replace(test, residual=residual, noise=noise).scores())
            left = test.whole(draw[..., None])[:, 0]
            loud = float(left @ left) / max(test.freedom, 1.0)
            correlation = sample_correlation(left, measured.shape)
            found.append((best, loud, correlation, loudest(left, by_window, test.freedom)))
        return OwnErrors(*np.quantile(found, BEYOND, axis=0).tolist())

    def _unseen(self, worlds: Floats) -> Floats:
        """What the network does not see coming in worlds (n, K, steps + 1, P, 3) [m]."""
        return worlds - self._predicted(worlds)

    def _predicted(self, worlds: Floats) -> Floats:
        """The network's predictions from the first steps of worlds (n, K, steps + 1, P, 3) [m].

        NaN where a point was never seen there, or the world is not finite.
        """
        model, history = self._model.dynamics, self._model.dynamics.history
        count, windows = worlds.shape[:2]
        points = worlds[:, :, : history + 1].reshape(-1, history + 1, *worlds.shape[3:])
        controls = np.tile(self._controls, (count, 1, 1))
        winch = np.tile(self._winch, (count, 1, 1))
        seen = Observation(points, np.full_like(winch, np.nan))
        usable = _all_seen(points)
        past = Past(seen[usable], controls[usable, :history], winch[usable], self._model.dataset)
        predicted = np.full((count * windows, *worlds.shape[2:]), np.nan)
        predicted[:, : history + 1] = points
        if usable.any():
            ahead = model.rollout(past, controls[usable, history:])
            predicted[usable, history + 1 :] = ahead.points[:, 1:]
        return predicted.reshape(worlds.shape)

    def _drawn(self, rng: np.random.Generator, draws: int) -> tuple[Floats, Floats]:
        """(K, D, draws / 2) errors whose covariance is the network's own, and as many with noise."""
        world, windows = self._world, self._past
        count, size = self._around.shape
        spread = np.repeat([SHAKEN_PLACE, SHAKEN_SPEED], size // 2)
        shaken = self._around + spread * rng.normal(size=(draws, count, size))
        members = np.tile(np.arange(count), draws)
        states = world.predictor.moved(world.first[members], shaken.reshape(-1, size))
        points = world.predictor.parallel(states, self._carried, self._terms, members)
        points = points.reshape(draws, count, *points.shape[1:])
        points = points[np.isfinite(points).all(axis=(1, 2, 3, 4))]
        seen = points + windows.sigma * rng.normal(size=points.shape)
        missing = np.isnan(windows.measured)
        wrong = points - self._predicted(np.where(missing, np.nan, seen))
        errors = self.windows.slope(np.moveaxis(wrong, 0, 1), 1.0, np.arange(count))
        half = len(points) // 2
        if half < 2:
            raise ModelError("The plant stays finite from too few starts to try the network on.")
        known = np.isfinite(self.windows.measured).reshape(count, -1, 1)
        own = errors[..., half:]
        return errors[..., :half] / np.sqrt(half), own + known * rng.normal(size=own.shape)


def _all_seen(points: Floats) -> np.ndarray:
    """(n,) whether every point of pasts (n, h + 1, P, 3) was seen at least once."""
    seen = np.asarray(np.isfinite(points).all(axis=-1))
    return np.asarray(seen.any(axis=1).all(axis=-1))
