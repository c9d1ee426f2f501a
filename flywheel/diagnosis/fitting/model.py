"""The model under test, a plant or a trained model, and its fit without further effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flywheel.diagnosis.fitting.initial_states import estimated_initial_states
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Restart
from flywheel.diagnosis.fitting.multistart import AFTER, BEFORE, unstuck
from flywheel.diagnosis.fitting.network_fit import NetworkFitter
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.refinement import F, shorter_steps
from flywheel.diagnosis.fitting.simulation import WindowSimulator
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import FittingSettings, Settings, WindowSettings
from flywheel.dynamics.plant import Plant, swing_period
from flywheel.effects import Scales, Terms
from flywheel.errors import DataError, ModelError
from flywheel.records import Trajectory

# Fraction of the cost that the last round must remove for a fit of initial states to go on, and the most
# further rounds: stiff cables make the cost so rough that it is far from its end after the usual ones.
GOING, LONGEST = 0.1, 20


@dataclass(frozen=True)
class ModelUnderTest:
    """Subject of the test.

    Attributes:
      plant: itself, or the source of changes by effects.
      model: tested instead of it.
      seed: of random numbers.
      busy: called before every simulation.
      settings: of the diagnosis.
    """

    plant: Plant
    model: Subject | None
    seed: int
    busy: Callable[[], None] = lambda: None
    settings: Settings = Settings()

    @property
    def name(self) -> str:
        """The name of the trained model; "" for the plant."""
        return "" if self.model is None else self.model.name

    def fitted(
        self,
        recordings: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
        around: Terms | None = None,
        calibrated: bool = True,
        discrepancy: float = 0.0,
    ) -> tuple[Fitter, Fit]:
        """A fitter of windows of recordings, and its fit without further effects.

        If a model is tested, the plant starts where it fits best with terms like `around`. A plant
        before `calibrated` may be fitted roughly. A `discrepancy` is unexplained by any model [m].
        """
        plant, model, fitting = self.plant, self.model, self.settings.fitting
        windows = self.windows(recordings, seconds, sigma).with_discrepancy(discrepancy)
        world = fitter_of(windows, plant, self.busy, fitting)
        if model is None:
            return fitted_as_given(world, world.first_estimate(plant.terms), self.seed, calibrated)
        terms = plant.terms if around is None else around
        world, start = fitted_and_refined(world, world.first_estimate(terms), self.seed)
        if around is not None:
            start = world.fit(start, world.free(around))
        rng = np.random.default_rng(self.seed)
        network = NetworkFitter(world, start, plant.terms, model, rng)
        return network, network.first_estimate(plant.terms)

    def windows(
        self,
        recordings: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
    ) -> Windows:
        """Recordings cut for the model, whose past may be long; see `Windows.cut`.

        Raises:
          DataError: recordings cannot be used.
          ModelError: the model cannot.
        """
        plant, model, seen = self.plant, self.model, 0.0
        if model is not None:
            _check(plant, model)
            seen = model.dynamics.history * plant.dt
            # It predicts nothing beside the points.
            recordings = [replace(track, channels=()) for track in recordings]
        seconds = seconds or seen + self._usual
        windows = Windows.cut(plant.robot, recordings, seconds, sigma, self.settings.windows)
        if abs(windows.dt - plant.dt) > 1e-9:
            raise DataError(
                f"The recordings are in control steps of {windows.dt:g} s, the plant in steps of "
                f"{plant.dt:g} s."
            )
        return windows

    @cached_property
    def _usual(self) -> float:
        """Length of windows, unless it is given [s]."""
        return usual_window(self.plant, self.settings.windows)


def usual_window(plant: Plant, settings: WindowSettings) -> float:
    """Length of windows that suits a robot's size and, if it hangs and swings, its period [s]."""
    return max(settings.seconds * Scales.of(plant.robot).time, swing_period(plant))


def _check(plant: Plant, model: Subject) -> None:
    got = (model.dynamics.robot.digest, model.dynamics.dt)
    if got != (plant.robot.digest, plant.dt):
        raise ModelError(
            f"The model {model.name} is for robot {got[0][:12]} in steps of {got[1]:g} s, the plant for "
            f"{plant.robot.digest[:12]} in steps of {plant.dt:g} s."
        )


def fitter_of(
    windows: Windows,
    plant: Plant,
    busy: Callable[[], None] = lambda: None,
    settings: FittingSettings = FittingSettings(),
) -> PlantFitter:
    """A fitter that starts with initial states estimated from the measurements.

    Args:
      windows: to be fitted.
      plant: under test.
      busy: called before every simulation.
      settings: of the diagnosis.
    """
    first = estimated_initial_states(windows, plant, settings.initial_states)
    return PlantFitter(WindowSimulator(windows, plant, busy), first, settings)


def fitted(fitter: Fitter, terms: Terms = (), rounds: int = AFTER, seed: int = 0) -> Fit:
    """Fitted initial states, with constant terms, in the time steps of the fitter."""
    fit = fitter.fit(fitter.first_estimate(terms), rounds=BEFORE)
    return _fitted_on(fitter, fitter.restarted(fit, Restart(seed)), rounds)


def _fitted_on(fitter: Fitter, fit: Fit, rounds: int, enough: float = 0.0) -> Fit:
    """A fit after so many rounds, and after more as long as each takes away a good part of the cost."""
    fit = fitter.fit(fit, rounds=rounds - 1, enough=enough)
    for _ in range(1 + LONGEST):
        before = fit.cost
        fit = fitter.fit(fit, rounds=1, enough=enough)
        if fit.converged or not before - fit.cost >= max(enough, GOING * before):
            break
    return fit


def fitted_and_refined(fitter: F, begun: Fit, seed: int = 0) -> tuple[F, Fit]:
    """Fitted initial states, with constant terms, and a fitter with sufficiently short time steps."""
    fitter, fit = shorter_steps(fitter, fitter.fit(begun, rounds=BEFORE))
    return fitter, _fitted_on(fitter, fitter.restarted(fit, Restart(seed)), AFTER)


def fitted_as_given(fitter: F, begun: Fit, seed: int = 0, calibrated: bool = True) -> tuple[F, Fit]:
    """The same for a model that may lack an effect.

    If it is clearly wrong, its initial states are not searched everywhere, nor fitted to the last
    digit; nor are time steps, before it is `calibrated`.
    """
    fit = fitter.fit(begun, rounds=BEFORE)
    if not calibrated and fitter.worthwhile(fit):
        return fitter, fit
    fitter, fit = shorter_steps(fitter, fit)
    fit = unstuck(fitter, fit, Restart(seed))
    return fitter, _fitted_on(fitter, fit, AFTER, fitter.worthwhile(fit))
