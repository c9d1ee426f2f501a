"""Settings of training, with the best measured recipe as defaults."""

from __future__ import annotations

from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, field_validator, model_validator

from flywheel.dynamics.arithmetic import Device, Precision
from flywheel.quantities import (
    Bounds,
    Factor,
    HorizonSeconds,
    Name,
    OptimiserSteps,
    PartialShare,
    Place,
    Samples,
    Seed,
    Share,
    Threads,
    Weight,
)
from flywheel.validation import Frozen

MOST_STAGES = 100
MOST_DATASETS = 1000  # of a run: as many inputs has the network's one-hot at most
Chunks = Annotated[int, Bounds(1, 100_000)]


class Stage(Frozen):
    """A part of a curriculum.

    Attributes:
      chunks: prediction chunks in a training window; gradients flow through all of them.
      share: of the step budget; the shares of a schedule are divided by their sum.
    """

    chunks: Annotated[int, Bounds(1, 1000)]
    share: Factor


def _stages(shares: dict[int, float]) -> tuple[Stage, ...]:
    return tuple(Stage(chunks=chunks, share=share) for chunks, share in shares.items())


class Schedule(Frozen):
    """Number of steps, length of windows and learning rate of a training.

    Attributes:
      steps: optimiser steps in all. Budgets are counted in steps, never in seconds.
      stages: the curriculum, one after the other.
      learning_rate: highest one, of AdamW; see `TrainingConfig.matrix_rate`.
      warmup_steps: of linear rise to it; a cosine falls from there over the rest of the budget.
      final_rate: where the cosine ends, as a fraction of the highest rate.
    """

    steps: OptimiserSteps
    stages: tuple[Stage, ...] = Field(min_length=1, max_length=MOST_STAGES)
    learning_rate: Factor
    warmup_steps: Annotated[int, Bounds(0, 10_000_000)]
    final_rate: Annotated[float, Bounds(0, 1, above=True)] = 0.01

    @model_validator(mode="after")
    def _every_stage_has_a_step(self) -> Self:
        if self.steps < len(self.stages):
            raise ValueError(
                f"{self.steps} steps are too few for {len(self.stages)} stages; each needs one"
            )
        return self


class TrainingConfig(Frozen):
    """Settings of a network's training.

    Attributes:
      initial: schedule of a training from random weights.
      fine_tuning: schedule of a training from the last iteration's weights.
      chunks_per_batch: prediction chunks per optimiser step; a stage of k chunks has this / k
        windows.
      least_windows: per batch, for any length.
      matrix_rate: learning rate of Muon, which steps the hidden matrices, over that of AdamW, which
        steps all other weights; 0 leaves all to AdamW.
      weight_decay: of both.
      clip: largest norm of the gradient.
      averaging: decay per step of the running mean of the weights, which is validated and kept:
        single steps scatter more than they gain. 0 keeps the weights unaveraged.
      huber: residuals beyond this many scales count linearly.
      velocity_weight: of the node velocities' loss.
      position_weight: of the node positions' loss.
      rest_weight: of the rest lengths' loss, if their truth is known.
      lead_power: errors in chunk j are divided by (1 + j) to this power (positions: twice it).
      yaw_augmentation: turn every window about the vertical by a random angle, unless the network's
        predictions turn with the robot anyway (`NetworkConfig.yaw_frame`), or cables hold it in the world.
      symmetries: list the robot's parts in the order of a random one of its symmetries, in each window
        that was simulated without an effect at a single place. Motion that was seen on one of the robot's
        sides is then known of all that are the same. A real robot's sides may differ.
      noise: standard deviation added to the past's points, as a fraction of the robot's length.
      mix: share of each data set in a batch; empty draws every window equally often.
      validate_every: steps between validations; also done at the end.
      validation_windows: rolled out at each validation.
      validation_seconds: their horizon [s].
      report_every: steps between points of the curve.
      patience: validations of the last stage without a better one before stopping early; 0 = never.
      checkpoint_every: steps between checkpoints; also written at the end of each stage.
      device: of the training; "cuda" for a GPU. Part of the result: sums are rounded differently.
      precision: of the hidden layers' matrix products on the processor; sums and weights, and
        everything on a GPU, are float32 in any case.
        "auto" is bfloat16 where the processor has instructions for it, which trains a quarter more
        windows in the same time. Part of the result.
      processes: number of parts of each batch, each computed by a process on a core of its own. Part
        of the result: sums are rounded differently. A part costs as much as some 30 windows before its
        first one, so that more processes pay for large batches and wide networks: two train 64
        windows 1.4 times as fast as one does, and 64 windows each 1.9 times. They wait for each other,
        and so lose where other programs take their cores. Each needs 0.4 GB.
      seed: of the weights, the order of the data and the augmentation.
      start_from: (`from` in files) weights that a run begins with, by the fine-tuning schedule: "shipped" for
        the shipped network for the run's robot, or a file of weights; "" for random ones.
    """

    model_config = ConfigDict(serialize_by_alias=True, validate_by_name=True)

    initial: Schedule = Schedule(
        steps=700,
        stages=_stages({1: 0.1, 2: 0.1, 4: 0.2, 8: 0.3, 16: 0.3}),
        learning_rate=3e-3,
        warmup_steps=100,
    )
    fine_tuning: Schedule = Schedule(
        steps=400,
        stages=_stages({16: 1.0}),  # going back to short windows would unlearn the long ones
        learning_rate=1e-3,
        warmup_steps=20,
    )
    chunks_per_batch: Chunks = 1024
    least_windows: Samples = 64
    matrix_rate: Annotated[float, Bounds(0, 100)] = 3.0
    weight_decay: Annotated[float, Bounds(0, 1e3)] = 1e-5
    clip: Factor = 1.0
    averaging: PartialShare = 0.98
    huber: Factor = 5.0
    velocity_weight: Weight = 1.0
    position_weight: Weight = 1.0
    rest_weight: Weight = 1.0
    lead_power: Annotated[float, Bounds(0, 10)] = 1.0
    yaw_augmentation: bool = True
    symmetries: bool = True
    noise: Share = 0.0
    mix: dict[Name, Weight] = Field(default={}, max_length=MOST_DATASETS)
    validate_every: OptimiserSteps = 100
    validation_windows: Samples = 128
    validation_seconds: HorizonSeconds = 2.0
    report_every: OptimiserSteps = 20
    patience: Annotated[int, Bounds(0, 10_000_000)] = 0
    checkpoint_every: OptimiserSteps = 100
    device: Device = "cpu"
    precision: Precision = "auto"
    processes: Threads = 1
    seed: Seed = 0
    start_from: Place = Field(default="", alias="from")

    @field_validator("start_from", mode="before")
    @classmethod
    def _none_is_nothing(cls, value: Any) -> Any:
        return "" if value is None else value  # as `training.from=` is read

    @model_validator(mode="before")
    @classmethod
    def _schedules_keep_what_is_not_given(cls, values: Any) -> Any:
        """Complete a schedule from the default: `training.initial.steps=500` changes just that."""
        if not isinstance(values, dict):
            return values
        partial = {
            name: {**cls.model_fields[name].default.model_dump(), **values[name]}
            for name in ("initial", "fine_tuning")
            if isinstance(values.get(name), dict)
        }
        return {**values, **partial}
