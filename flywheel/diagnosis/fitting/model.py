"""What is tested: a plant, or a trained model in its stead."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.baseline import baseline_fit, fitter_of, refined_fit
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.network_fit import NetworkFitter
from flywheel.diagnosis.fitting.parameters import free_values
from flywheel.diagnosis.fitting.subject import Subject
from flywheel.diagnosis.fitting.windows import WINDOW, Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import Scales, Terms
from flywheel.errors import DataError, ModelError
from flywheel.records import Trajectory


@dataclass(frozen=True)
class UnderTest:
    """What is tested.

    Attributes:
      plant: itself, or what says what effects would change.
      model: that is tested in its stead.
      seed: of what is random.
      busy: called before every simulation.
    """

    plant: Plant
    model: Subject | None
    seed: int
    busy: Callable[[], None] = lambda: None

    def fitted(
        self,
        recordings: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
        around: Terms | None = None,
        calibrated: bool = True,
    ) -> tuple[Fitter, Fit]:
        """A fitter of windows of recordings, and its fit without further effects.

        Where a model is tested, the plant starts from where it fits best with terms like `around`. A plant
        that is yet to be `calibrated` may be fitted roughly.
        """
        plant, model = self.plant, self.model
        windows = self.windows(recordings, seconds, sigma)
        if model is None:
            fitter = fitter_of(windows, plant, self.busy)
            return baseline_fit(fitter, fitter.beginning(plant.terms), self.seed, calibrated)
        terms = plant.terms if around is None else around
        world = fitter_of(windows, plant, self.busy)
        world, start = refined_fit(world, world.beginning(terms), self.seed)
        if around is not None:
            start = world.fit(start, free_values(around, Scales.of(plant.robot)))
        rng = np.random.default_rng(self.seed)
        network = NetworkFitter(world, start, plant.terms, model, rng)
        return network, network.beginning(plant.terms)

    def windows(
        self,
        recordings: Sequence[Trajectory],
        seconds: float | None = None,
        sigma: float | None = None,
    ) -> Windows:
        """Recordings cut as they are looked at; see `Windows.cut`.

        Raises:
          DataError: recordings that cannot be used.
          ModelError: a model that cannot.
        """
        plant, model = self.plant, self.model
        if model is not None:
            _check(plant, model)
            seen = model.dynamics.history * plant.dt
            seconds = seconds or seen + WINDOW * Scales.of(plant.robot).time
        windows = Windows.cut(plant.robot, recordings, seconds, sigma)
        if abs(windows.dt - plant.dt) > 1e-9:
            raise DataError(
                f"The recordings are in control steps of {windows.dt:g} s, the plant in steps of "
                f"{plant.dt:g} s."
            )
        return windows


def _check(plant: Plant, model: Subject) -> None:
    got = (model.dynamics.robot.digest, model.dynamics.dt)
    if got != (plant.robot.digest, plant.dt):
        raise ModelError(
            f"The model {model.name} is for robot {got[0][:12]} in steps of {got[1]:g} s, the plant for "
            f"{plant.robot.digest[:12]} in steps of {plant.dt:g} s."
        )
