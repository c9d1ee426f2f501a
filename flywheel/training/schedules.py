"""Curriculum and learning rate as pure functions of the step."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flywheel.training.config import Schedule


@dataclass(frozen=True)
class StageSpan:
    """Steps `start` <= step < `stop` train on windows of `chunks` prediction chunks."""

    chunks: int
    start: int
    stop: int


def spans(schedule: Schedule) -> tuple[StageSpan, ...]:
    """The stages of a schedule; together exactly its steps, and at least one step each."""
    total = sum(stage.share for stage in schedule.stages)
    count = len(schedule.stages)
    spare = schedule.steps - count
    result: list[StageSpan] = []
    start, passed = 0, 0.0
    for i, stage in enumerate(schedule.stages):
        passed += stage.share
        stop = i + 1 + round(spare * min(1.0, passed / total))
        stop = schedule.steps if i == count - 1 else stop
        result.append(StageSpan(stage.chunks, start, stop))
        start = stop
    return tuple(result)


def stage_at(schedule: Schedule, step: int) -> StageSpan:
    """The stage that a step belongs to."""
    return next(span for span in spans(schedule) if step < span.stop)


def learning_rate(schedule: Schedule, step: int) -> float:
    """Linear warm-up, then a cosine to `final_rate` at the last step."""
    if step < schedule.warmup_steps:
        return schedule.learning_rate * (step + 1) / schedule.warmup_steps
    rest = max(1, schedule.steps - 1 - schedule.warmup_steps)
    progress = min(1.0, (step - schedule.warmup_steps) / rest)
    cosine = 0.5 * (1.0 + math.cos(math.pi * progress))
    low = schedule.final_rate
    return schedule.learning_rate * (low + (1.0 - low) * cosine)
