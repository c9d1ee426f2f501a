"""Decide: whether the new model takes the champion's place; and put on record what happened."""

from __future__ import annotations

from flywheel.data import Snapshot
from flywheel.runtime.results import Arm, GateDecision, IterationResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.gate import decide_champion
from flywheel.runtime.stages.outcomes import Collected, Evaluated, Tally, Trained
from flywheel.runtime.stages.scoring import by_split


def decide(
    run: Run,
    iteration: int,
    collected: dict[Arm, Collected],
    snapshots: dict[Arm, Snapshot],
    trained: dict[Arm, Trained],
    evaluated: dict[Arm, Evaluated],
    tally: Tally,
) -> list[IterationResult]:
    """What the iteration produced, per arm. Only the MPPI arm has a champion."""
    results = []
    for arm, done in evaluated.items():
        data = by_split(snapshots[arm].episodes)["train"]
        steps = {summary.id: summary.steps for summary in snapshots[arm].episodes}
        results.append(
            IterationResult(
                iteration=iteration,
                arm=arm,
                snapshot=snapshots[arm].digest,
                parent_snapshot=_parent(run, iteration, arm),
                model=trained[arm].note.digest,
                validation=done.validation,
                test=done.test,
                recordings=done.recordings,
                navigation=done.navigation,
                episodes=len(data),
                steps=sum(steps[name] for name in data),
                new_episodes=len(collected[arm].segments),
                new_steps=collected[arm].steps,
                restarts=tally.restarts if arm == "mppi" else 0,
                quarantined=collected[arm].quarantined,
                invalid=collected[arm].invalid,
                cpu_seconds=round(tally.cpu_seconds, 2) if arm == "mppi" else 0.0,
                seconds={stage: round(s, 2) for stage, s in tally.seconds.items()},
                curve=trained[arm].note.curve,
                gate=_gate(run, trained[arm], done) if arm == "mppi" else None,
                overlay=done.overlay,
                diagnosis=run.folder.diagnosis(iteration),
            )
        )
    return results


def _gate(run: Run, trained: Trained, done: Evaluated) -> GateDecision:
    champion = run.latest_model("mppi")
    return decide_champion(
        run.config.gate,
        run.config.evaluate.horizon_seconds,
        done.validation,
        done.champion_validation,
        done.navigation,
        done.champion_navigation,
        same=champion is not None and champion.digest == trained.note.digest,
    )


def _parent(run: Run, iteration: int, arm: Arm) -> str:
    if iteration == 0:
        return ""
    before = run.folder.finished(iteration - 1, run.arm_of(iteration - 1, arm))
    return "" if before is None else before.snapshot
