"""What a user can choose about MPPI."""

from __future__ import annotations

from typing import ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class MppiConfig(BaseModel):
    """How MPPI searches. The defaults are measured: docs/results/oracle.md.

    Attributes:
      samples: K, plans tried per round.
      rounds: of trying and averaging per plan.
      horizon_seconds: H, predicted [s].
      knot_seconds: between the knots of a plan [s].
      replan_seconds: carried out of each plan [s].
      temperature: beta of the weights, > 0.
      relative_temperature: count it in standard deviations of the sampled costs, which makes it
        independent of the costs' scale and of how near the goal is.
      noise: standard deviation of a knot, as a fraction of the winch's range of rest lengths.
      smoothness: correlation of the noise from knot to knot.
      narrowing: factor on the noise from each round to the next.
      elites: best plans that are tried again in the next round, and in the next plan.
      fresh: share of the samples that do not start from the plan: every winch strokes to an end or
        to the middle of its range.
      fresh_seconds: duration of such a stroke [s].
    """

    TIMES: ClassVar = ("horizon_seconds", "knot_seconds", "replan_seconds")
    model_config = ConfigDict(frozen=True, extra="forbid")

    samples: int = Field(default=48, ge=1)
    rounds: int = Field(default=1, ge=1)
    horizon_seconds: float = Field(default=3.0, gt=0)
    knot_seconds: float = Field(default=0.5, gt=0)
    replan_seconds: float = Field(default=0.5, gt=0)
    temperature: float = Field(default=0.05, gt=0)
    relative_temperature: bool = True
    noise: float = Field(default=0.3, gt=0)
    smoothness: float = Field(default=0.7, ge=0, lt=1)
    narrowing: float = Field(default=0.6, gt=0, le=1)
    elites: int = Field(default=2, ge=0)
    fresh: float = Field(default=0.4, ge=0, le=1)
    fresh_seconds: float = Field(default=1.5, gt=0)

    @model_validator(mode="after")
    def _acts_within_its_horizon(self) -> Self:
        if self.replan_seconds > self.horizon_seconds:
            raise ValueError(
                f"replan_seconds ({self.replan_seconds}) is carried out of a plan of "
                f"horizon_seconds ({self.horizon_seconds}); it cannot be longer"
            )
        return self
