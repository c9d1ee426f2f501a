"""Decide: whether the new model becomes the champion; and the record of the iteration."""

from __future__ import annotations

from flywheel.runtime.results import Arm, GateDecision, IterationResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.gate import decide_champion
from flywheel.runtime.stages.outcomes import ArmOutcome, Tally
from flywheel.runtime.stages.scoring import by_split


def decide(
    run: Run, iteration: int, outcomes: list[ArmOutcome], tally: Tally
) -> list[IterationResult]:
    """The iteration's result in each arm. Only the MPPI arm has a champion and a gate."""
    return [_result(run, iteration, outcome, tally) for outcome in outcomes]


def _result(run: Run, iteration: int, outcome: ArmOutcome, tally: Tally) -> IterationResult:
    arm, collected, evaluated = outcome.arm, outcome.collected, outcome.evaluated
    data = by_split(outcome.snapshot.episodes)["train"]
    steps = {summary.id: summary.steps for summary in outcome.snapshot.episodes}
    main = arm == "mppi"  # what cannot be told apart by arm stands in its result
    return IterationResult(
        iteration=iteration,
        arm=arm,
        snapshot=outcome.snapshot.digest,
        parent_snapshot=_parent(run, iteration, arm),
        model=outcome.training.digest,
        validation=evaluated.validation,
        test=evaluated.test,
        recordings=evaluated.recordings,
        navigation=evaluated.navigation,
        episodes=len(data),
        steps=sum(steps[name] for name in data),
        new_episodes=len(collected.segments),
        new_steps=collected.steps,
        restarts=tally.restarts if main else 0,
        quarantined=collected.quarantined,
        invalid=collected.invalid,
        cpu_seconds=round(tally.cpu_seconds, 2) if main else 0.0,
        seconds={stage: round(s, 2) for stage, s in tally.seconds.items()},
        curve=outcome.training.curve,
        gate=_gate(run, outcome) if main else None,
        overlay=evaluated.overlay,
        diagnosis=run.folder.diagnosis(iteration),
    )


def _gate(run: Run, outcome: ArmOutcome) -> GateDecision:
    champion, evaluated = run.latest_model(outcome.arm), outcome.evaluated
    return decide_champion(
        run.config.gate,
        run.config.evaluate.horizon_seconds,
        evaluated.validation,
        evaluated.champion_validation,
        evaluated.navigation,
        evaluated.champion_navigation,
        same=champion is not None and champion.digest == outcome.training.digest,
    )


def _parent(run: Run, iteration: int, arm: Arm) -> str:
    if iteration == 0:
        return ""
    before = run.folder.finished(iteration - 1, run.arm_of(iteration - 1, arm))
    return "" if before is None else before.snapshot
