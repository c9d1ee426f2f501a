"""Settings of MPPI."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, Self

from pydantic import model_validator

from flywheel.dynamics.arithmetic import Arithmetic, Device, Precision
from flywheel.errors import ConfigError
from flywheel.quantities import Bounds, Factor, HorizonSeconds, PartialShare, Samples, Share
from flywheel.validation import Frozen


class MppiConfig(Frozen):
    """Settings of the search by MPPI. The defaults are measured: docs/results/oracle.md.

    Attributes:
      samples: K, plans sampled per round.
      rounds: of sampling and averaging per plan.
      horizon_seconds: H, predicted [s].
      knot_seconds: between the knots of a plan [s].
      replan_seconds: executed part of each plan [s].
      temperature: beta of the weights, > 0.
      relative_temperature: measure it in standard deviations of the sampled costs, which makes it
        independent of the costs' scale and of the distance to the goal.
      noise: standard deviation of a knot, as a fraction of the winch's range of rest lengths.
      smoothness: correlation of the noise from knot to knot.
      narrowing: factor on the noise from each round to the next.
      elites: best plans that are kept for the next round, and for the next plan; with the plan itself at
        most half of the samples, so that a search goes on with few of them, too.
      fresh: fraction of the samples that do not start from the plan: every winch strokes to an end
        or to the middle of its range.
      fresh_seconds: duration of such a stroke [s].
      turning: fraction of the samples that follow one of prism3's gaits that turn, cw or ccw; their costs
        decide whether turning pays.
      device: of a network's predictions; "cuda" for a GPU, on which plants are not simulated. Part of
        the result: sums are rounded differently.
      precision: of a network's matrix products on the processor. "auto" is bfloat16 where the
        processor has instructions for it, with which plans take a quarter less time. Part of the
        result.
    """

    TIMES: ClassVar = ("horizon_seconds", "knot_seconds", "replan_seconds")
    samples: Samples = 48
    rounds: Annotated[int, Bounds(1, 100)] = 1
    horizon_seconds: HorizonSeconds = 3.0
    knot_seconds: HorizonSeconds = 0.5
    replan_seconds: HorizonSeconds = 0.5
    temperature: Factor = 0.05
    relative_temperature: bool = True
    noise: Annotated[float, Bounds(0, 10, above=True)] = 0.3
    smoothness: PartialShare = 0.7
    narrowing: Annotated[float, Bounds(0, 1, above=True)] = 0.6
    elites: Annotated[int, Bounds(0, 10_000)] = 2
    fresh: Share = 0.4
    fresh_seconds: HorizonSeconds = 1.5
    turning: Share = 0.0
    device: Device = "cpu"
    precision: Precision = "auto"

    @property
    def arithmetic(self) -> Arithmetic:
        """Of a network's predictions."""
        return Arithmetic(self.device, self.precision)

    @model_validator(mode="after")
    def _acts_within_its_horizon(self) -> Self:
        if self.replan_seconds > self.horizon_seconds:
            raise ValueError(
                f"replan_seconds ({self.replan_seconds}) is the executed part of a plan of "
                f"horizon_seconds ({self.horizon_seconds}); it cannot be longer"
            )
        return self

    @model_validator(mode="after")
    def _draws_all_samples_once(self) -> Self:
        if self.fresh + self.turning > 1:
            raise ValueError(
                f"fresh and turning are shares of the same samples, at most 1 together; got {self.fresh} and "
                f"{self.turning}"
            )
        return self

    def steps(self, dt: float) -> dict[str, int]:
        """Each of `TIMES` in control steps of `dt` [s].

        Raises:
          ConfigError: one is not a multiple of it.
        """
        steps = {what: round(getattr(self, what) / dt) for what in self.TIMES}
        for what, count in steps.items():
            seconds = getattr(self, what)
            if count < 1 or not math.isclose(count * dt, seconds, rel_tol=1e-6):
                raise ConfigError(
                    f"{what} must be a multiple of the model's {dt:g} s, got {seconds:g} s."
                )
        return steps
