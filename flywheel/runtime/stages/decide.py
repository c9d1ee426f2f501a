"""Decide: promote the new model to champion, or keep the old one."""

from __future__ import annotations

from dataclasses import replace

from flywheel.results import GateDecision
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.gate import decide_champion
from flywheel.runtime.stages.outcomes import ArmOutcome, Iteration


def decide(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[ArmOutcome]:
    """Apply the gate. Only the MPPI arm has a champion and a gate."""
    return [
        replace(outcome, gate=_gate(run, iteration, outcome)) if outcome.arm == "mppi" else outcome
        for outcome in outcomes
    ]


def _gate(run: Run, iteration: Iteration, outcome: ArmOutcome) -> GateDecision:
    champion, evaluated = iteration.models.get(outcome.arm), outcome.evaluated
    return decide_champion(
        run.config.gate,
        run.config.evaluate.horizon_seconds,
        evaluated.validation,
        evaluated.champion_validation,
        evaluated.navigation,
        evaluated.champion_navigation,
        same=champion is not None and champion.digest == outcome.training.digest,
    )
