"""The record of an iteration: outcomes and costs of its stages."""

from __future__ import annotations

from flywheel.results import Arm, IterationResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.outcomes import ArmOutcome, Iteration
from flywheel.runtime.stages.scoring import by_split


def record(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[IterationResult]:
    """The iteration's result in each arm."""
    return [_result(run, iteration, outcome) for outcome in outcomes]


def _result(run: Run, iteration: Iteration, outcome: ArmOutcome) -> IterationResult:
    arm, collected, evaluated = outcome.arm, outcome.collected, outcome.evaluated
    data = by_split(outcome.snapshot.episodes)["train"]
    steps = {summary.id: summary.steps for summary in outcome.snapshot.episodes}
    main = arm == "mppi"  # costs shared by both arms are recorded for the MPPI arm
    return IterationResult(
        iteration=iteration.number,
        arm=arm,
        snapshot=outcome.snapshot.digest,
        parent_snapshot=_parent(run, iteration.number, arm),
        model=outcome.training.digest,
        validation=evaluated.validation,
        test=evaluated.test,
        recordings=evaluated.recordings,
        navigation=evaluated.navigation,
        episodes=len(data),
        steps=sum(steps[name] for name in data),
        new_episodes=len(collected.segments),
        new_steps=collected.steps,
        restarts=iteration.restarts if main else 0,
        quarantined=collected.quarantined,
        invalid=collected.invalid,
        cpu_seconds=round(iteration.cpu_seconds, 2) if main else 0.0,
        seconds={stage: round(s, 2) for stage, s in iteration.seconds.items()},
        curve=outcome.training.curve,
        gate=outcome.gate,
        overlay=evaluated.overlay,
        robot=evaluated.robot,
        diagnosis=iteration.diagnosis,
    )


def _parent(run: Run, number: int, arm: Arm) -> str:
    if number == 0:
        return ""
    before = run.folder.finished(number - 1, run.arm_of(number - 1, arm))
    return "" if before is None else before.snapshot
