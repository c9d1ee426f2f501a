"""Sensors: noise, dropout, and unmeasured winch positions."""

from __future__ import annotations

import numpy as np

from flywheel.quantities import PartialShare, Share
from flywheel.records import Observation
from flywheel.robots import Robot
from flywheel.validation import Frozen


class MeasurementModel(Frozen):
    """Measurement of a plant. By default it is exact, without winch positions.

    Attributes:
      noise: standard deviation of each coordinate of a point, as a fraction of `robot.length`.
      dropout: probability that a point is missing from an observation.
      winch_measured: measure all winch positions; else only those the MJCF has a sensor for.
    """

    noise: Share = 0.0
    dropout: PartialShare = 0.0
    winch_measured: bool = False

    def apply(
        self, observation: Observation, robot: Robot, rng: np.random.Generator
    ) -> Observation:
        """A measured copy of a noise-free observation; missing entries are NaN."""
        points = np.array(observation.points, float)
        if self.noise:
            points += rng.normal(scale=self.noise * robot.length, size=points.shape)
        if self.dropout:
            points[rng.random(points.shape[:-1]) < self.dropout] = np.nan
        measured = [self.winch_measured or winch.measured for winch in robot.winches]
        return Observation(points, np.where(measured, observation.winch, np.nan))
