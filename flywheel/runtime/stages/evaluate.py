"""Evaluate: errors of each arm's model, and success of a planner with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.run.context import Run
from flywheel.runtime.stages.on_robot import drive_robot, robot_score_jobs, with_errors
from flywheel.runtime.stages.outcomes import ArmOutcome, Iteration
from flywheel.runtime.stages.scoring import by_split, navigation, score_jobs, scored
from flywheel.runtime.workers.episode_plan import Effects, evaluation


def evaluate(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[ArmOutcome]:
    """Evaluate every arm's model on validation data, then in closed loop, then on test data.

    The closed loop is on the robot if the run has one.

    A model with predictions that are not finite drives no robot.
    """
    outcomes = _on_validation(run, iteration, outcomes)
    closed_loop = _in_closed_loop if run.config.robot is None else drive_robot
    outcomes = [
        closed_loop(run, iteration, outcome) if outcome.arm == "mppi" else outcome
        for outcome in outcomes
    ]
    return _on_tests(run, iteration, outcomes)


def _on_validation(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[ArmOutcome]:
    jobs = [_validation_jobs(run, iteration, outcome) for outcome in outcomes]
    every = [*(job for new, _ in jobs for job in new), *(job for _, old in jobs for job in old)]
    report = iteration.add(run.do(every, f"{iteration.number}: validate"))
    return [
        _judged(outcome, validation=scored(report, new), champion_validation=scored(report, old))
        for outcome, (new, old) in zip(outcomes, jobs, strict=True)
    ]


def _validation_jobs(
    run: Run, iteration: Iteration, outcome: ArmOutcome
) -> tuple[Sequence[Job], Sequence[Job]]:
    """Jobs for the new model, and for the arm's previous one."""
    if outcome.model is None:
        return (), ()
    arm, effects = outcome.arm, iteration.effects
    episodes = by_split(outcome.snapshot.episodes)["validation"]
    new = score_jobs(run, f"{arm}-new", outcome.model, episodes, effects, full=False)
    before = iteration.models.get(arm)
    if before is None:
        return new, ()
    return new, score_jobs(run, f"{arm}-old", before, episodes, effects, full=False)


def _in_closed_loop(run: Run, iteration: Iteration, outcome: ArmOutcome) -> ArmOutcome:
    if outcome.usable_model is None:
        return outcome
    plans = evaluation(run.config, iteration.number, outcome.arm, iteration.effects)
    jobs = run.episode_jobs(plans, outcome.usable_model)
    report = iteration.add(run.do(jobs, f"{iteration.number}: navigate"))
    champion = iteration.latest[outcome.arm]
    return _judged(
        outcome,
        navigation=navigation(run, "mppi", report, plans),
        champion_navigation=None if champion is None else champion.navigation,
    )


@dataclass(frozen=True)
class _TestJobs:
    """One arm's jobs on test data; none without a usable model."""

    episodes: list[Job] = field(default_factory=list)
    recordings: list[Job] = field(default_factory=list)
    overlay: Job | None = None


def _on_tests(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[ArmOutcome]:
    """Errors on simulated test episodes up to now and, separately, on recordings."""
    episodes = run.test_episodes(iteration.number)
    recordings = run.recordings("test", iteration.number + 1)
    effects = iteration.effects
    by_arm = [_test_jobs(run, outcome, episodes, recordings, effects) for outcome in outcomes]
    every = [job for jobs in by_arm for job in (*jobs.episodes, *jobs.recordings)]
    every += [jobs.overlay for jobs in by_arm if jobs.overlay is not None]
    on_robot = robot_score_jobs(run, iteration) if run.config.robot else {}
    every += [job for part in on_robot.values() for job in part]
    report = iteration.add(run.do(every, f"{iteration.number}: test"))
    judged = [
        _judged(
            outcome,
            test=scored(report, jobs.episodes),
            recordings=scored(report, jobs.recordings),
            overlay=None if jobs.overlay is None else report.results.get(jobs.overlay.id),
        )
        for outcome, jobs in zip(outcomes, by_arm, strict=True)
    ]
    return [with_errors(outcome, report, on_robot) for outcome in judged]


def _test_jobs(
    run: Run, outcome: ArmOutcome, episodes: list[str], recordings: list[str], effects: Effects
) -> _TestJobs:
    arm, model = outcome.arm, outcome.usable_model
    if model is None:
        return _TestJobs()
    overlay = None
    if episodes:
        arguments = (run.shared_weights(model), episodes[-1], effects)
        overlay = Job(f"overlay-{arm}", "sim", "overlay", arguments)
    return _TestJobs(
        score_jobs(run, f"{arm}-test", model, episodes, effects),
        score_jobs(run, f"{arm}-recordings", model, recordings, effects),
        overlay,
    )


def _judged(outcome: ArmOutcome, **found: Any) -> ArmOutcome:
    return replace(outcome, evaluated=replace(outcome.evaluated, **found))
