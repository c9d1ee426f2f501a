"""A trained network under test: values of effects are fitted to its residual.

A network starts from the measured past, so that no initial state needs to be fitted; but its own
errors are larger than the noise. Its prediction of the recorded motion is tested: a plant moves
from fitted initial states through the recorded commands, which is taken as the truth, and the
network predicts that from its noisy past. Repeated from nearby states, this gives the covariance of
the network's own errors in every window; residuals along them are down-weighted. Half of the draws
make the covariance, the other half give the remaining level of such errors, which a score must
exceed.

An effect changes the motion, and also the past seen by the network. With the plant's motion y and
the network's prediction N, the network with an effect predicts

    N(measured past) + [y - N(past of y)] with the effect - [y - N(past of y)] without it.

The plant need not be right for this: it gives the change by an effect, not the motion of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flywheel.diagnosis.fitting.initial_states import nominal_winch
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian, JacobianCache
from flywheel.diagnosis.fitting.parameters import prior_cost
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.dynamics.plant import Reckoning
from flywheel.effects import Terms
from flywheel.errors import ModelError
from flywheel.records import Floats, Observation, Past

# Nearby initial states: half make the covariance of the network's own errors, half test it; and the standard
# deviations of their poses and velocities, in natural units.
DRAWS, PLACE, SPEED = 96, 0.01, 0.03


class NetworkFitter(Fitter):
    """Fits terms to a network's residual in windows.

    Args:
      world: of a plant, for the same windows; the network sees their first steps, and predicts the
        others.
      fit: of its initial states, with any terms.
      terms: of the plant.
      model: under test.
      rng: of the draws of the network's own errors.

    Raises:
      ModelError: the model does not fit the windows, or is not finite in the plant's world.
    """

    def __init__(
        self, world: PlantFitter, fit: Fit, terms: Terms, model: Subject, rng: np.random.Generator
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
        self._initial, self._terms = fit.initial, terms
        self._around = fit.local
        self._past = windows
        places = list(zip(windows.recording, windows.first, strict=True))
        steps = windows.steps
        self._controls = np.stack(
            [windows.recordings[i].controls[f : f + steps] for i, f in places]
        )
        reckoning = Reckoning(windows.robot, windows.dt, model.terms)
        self._winch = nominal_winch(windows, reckoning)[:, : history + 1]
        super().__init__(
            replace(windows, measured=ahead), np.ones(0), world.winch_prior, world.settings
        )
        worlds, (self._carried,) = world.simulator.chained(fit.initial, [terms])
        self._without = self._unseen(worlds)[0]
        self._measured = self._predicted(windows.measured[None])[0]
        modes, self._own = self._drawn(rng)
        self._modes, size, _ = np.linalg.svd(modes, full_matrices=False)
        self._modes = self._modes * size[:, None]
        self.local_prior = np.ones(self._modes.shape[2])

    @property
    def time_steps(self) -> Floats:
        """(K,) of the plant for changes by effects [s]."""
        return self._world.time_steps

    @property
    def starts_are_free(self) -> bool:
        """A network starts with the measured past."""
        return False

    @property
    def own_errors(self) -> Floats:
        """(K, D, n) draws, with noise, that are not part of the covariance of its errors [sigma]."""
        return self._own

    def first_estimate(self, terms: Terms = ()) -> Fit:
        """The best amounts of its own errors in the windows, in closed form."""
        carried, points = self._carried, self._measured
        if terms != self._terms:
            worlds, (carried,) = self._world.simulator.chained(self._initial, [terms])
            points = points + (self._unseen(worlds)[0] - self._without)
        off = self.windows.residual(points)
        own = self._modes.swapaxes(1, 2)
        normal = own @ self._modes + np.eye(len(self.local_prior))
        local = np.linalg.solve(normal, own @ off[..., None])
        left = off - (self._modes @ local)[..., 0]
        local = local[..., 0]
        cost = float((left**2).sum() + self.local_cost(local).sum()) + prior_cost(terms)
        cost = cost if np.isfinite(points[self._usable]).all() else np.inf
        return Fit(self._initial, terms, local, points, left, carried, cost)

    def with_terms(self, fit: Fit, terms: Terms) -> Fit:
        """Other terms, with the best amounts of its own errors."""
        return replace(self.first_estimate(terms), cache=fit.cache)

    def with_local(self, fit: Fit, local: Floats) -> Fit:
        """The fit itself: the best amounts are known, independent of the start."""
        return self.first_estimate(fit.terms)

    def jacobian(self, fit: Fit) -> Jacobian:
        """Its own errors; independent of offsets of winches, which are part of its past."""
        count, size, _ = self._modes.shape
        return Jacobian(self._modes, np.zeros((count, size, fit.initial.winch.shape[1])))

    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        """(n, K, steps + 1, P, 3) points with a fit's terms replaced by each of n [m]."""
        worlds, _ = self._world.simulator.chained(self._initial, list(terms))
        return self._measured + (self._unseen(worlds) - self._without)

    def stepped(
        self, fit: Fit, cache: JacobianCache, left: Floats, winch: Floats, terms: Terms
    ) -> Fit:
        """Other terms, with the best amounts of its own errors."""
        return replace(self.first_estimate(terms), cache=cache)

    def rms(self, fit: Fit) -> float:
        """Root mean square error [m], its own errors included: as in use."""
        squares = (self.windows.residual(fit.points) ** 2).sum()
        return float(np.sqrt(squares / max(1, self.windows.noisy.sum()))) * self.windows.sigma

    def _unseen(self, worlds: Floats) -> Floats:
        """Prediction errors of the network in worlds (n, K, steps + 1, P, 3) [m]."""
        return worlds - self._predicted(worlds)

    def _predicted(self, worlds: Floats) -> Floats:
        """The network's predictions from the first steps of worlds (n, K, steps + 1, P, 3) [m].

        NaN if a point was never seen there, or the world is not finite.
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

    def _drawn(self, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """(K, D, draws / 2) errors that define the network's own covariance, and as many with noise."""
        world, windows, (count, size) = self._world, self._past, self._around.shape
        spread = np.repeat([PLACE, SPEED], size // 2)
        shaken = self._around + spread * rng.normal(size=(DRAWS, count, size))
        members = np.tile(np.arange(count), DRAWS)
        states = world.simulator.moved(world.first[members], shaken.reshape(-1, size))
        points = world.simulator.parallel(states, self._carried, self._terms, members)
        points = points.reshape(DRAWS, count, *points.shape[1:])
        points = points[np.isfinite(points).all(axis=(1, 2, 3, 4))]
        seen = points + windows.sigma * windows.noisy * rng.normal(size=points.shape)
        missing = np.isnan(windows.measured)
        wrong = points - self._predicted(np.where(missing, np.nan, seen))
        errors = self.windows.slope(np.moveaxis(wrong, 0, 1), 1.0, np.arange(count))
        half = len(points) // 2
        if half < 2:
            raise ModelError("The plant stays finite from too few starts to test the network.")
        noisy = self.windows.noisy.reshape(count, -1, 1)
        own = errors[..., half:]
        return errors[..., :half] / np.sqrt(half), own + noisy * rng.normal(size=own.shape)


def _all_seen(points: Floats) -> np.ndarray:
    """(n,) True if every point of pasts (n, h + 1, P, 3) was seen at least once."""
    seen = np.asarray(np.isfinite(points).all(axis=-1))
    return np.asarray(seen.any(axis=1).all(axis=-1))
