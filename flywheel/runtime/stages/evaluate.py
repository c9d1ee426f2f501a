"""Evaluate: what a model predicts, and what a planner reaches with it."""

from __future__ import annotations

from dataclasses import replace

from flywheel.data import Snapshot
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.results import Arm
from flywheel.runtime.run.context import Model, Run, usable
from flywheel.runtime.stages.outcomes import Evaluated, Tally, Trained
from flywheel.runtime.stages.scoring import by_split, navigation, score_jobs, scored
from flywheel.runtime.workers.episode_plan import evaluation


def evaluate(
    run: Run,
    iteration: int,
    snapshots: dict[Arm, Snapshot],
    trained: dict[Arm, Trained],
    tally: Tally,
) -> dict[Arm, Evaluated]:
    """Judge every arm's model on validation data, then in closed loop, then on test data.

    A model that predicts no finite numbers drives no robot.
    """
    models = {arm: done.model for arm, done in trained.items() if done.model is not None}
    found = _on_validation(run, iteration, snapshots, models, tally)
    fit = {arm: models[arm] for arm, done in found.items() if usable(done.validation)}
    if "mppi" in fit:
        found["mppi"] = _in_closed_loop(run, iteration, fit["mppi"], found["mppi"], tally)
    found |= _on_tests(run, iteration, fit, found, tally)
    return {arm: found.get(arm, Evaluated()) for arm in trained}


def _on_validation(
    run: Run,
    iteration: int,
    snapshots: dict[Arm, Snapshot],
    models: dict[Arm, Model],
    tally: Tally,
) -> dict[Arm, Evaluated]:
    effects = run.effects(iteration)
    new: dict[Arm, list[Job]] = {}
    old: dict[Arm, list[Job]] = {}
    for arm, model in models.items():
        episodes = by_split(snapshots[arm].episodes)["validation"]
        new[arm] = score_jobs(run, f"{arm}-new", run.weights(model), episodes, effects, False)
        champion = run.latest_model(arm)
        if champion is not None:
            old[arm] = score_jobs(
                run, f"{arm}-old", run.weights(champion), episodes, effects, False
            )
    jobs = [job for part in (*new.values(), *old.values()) for job in part]
    report = tally.add(run.do(jobs, f"{iteration}: validate"))
    return {
        arm: Evaluated(scored(report, new[arm]), scored(report, old.get(arm, []))) for arm in models
    }


def _in_closed_loop(
    run: Run, iteration: int, model: Model, found: Evaluated, tally: Tally
) -> Evaluated:
    plans = evaluation(run.config, iteration, "mppi", run.effects(iteration))
    report = tally.add(run.do(run.recordings(plans, model), f"{iteration}: navigate"))
    champion = run.latest("mppi")
    return replace(
        found,
        navigation=navigation(run, "mppi", report, plans),
        champion_navigation=None if champion is None else champion.navigation,
    )


def _on_tests(
    run: Run,
    iteration: int,
    fit: dict[Arm, Model],
    found: dict[Arm, Evaluated],
    tally: Tally,
) -> dict[Arm, Evaluated]:
    """Tests of iteration 0 and the closed-loop episodes up to now; apart from them, recordings."""
    episodes, logs = run.test_episodes(iteration), run.test_recordings()
    effects = run.effects(iteration)
    scores: dict[Arm, list[Job]] = {}
    on_logs: dict[Arm, list[Job]] = {}
    overlays: dict[Arm, Job] = {}
    for arm, model in fit.items():
        weights = run.weights(model)
        scores[arm] = score_jobs(run, f"{arm}-test", weights, episodes, effects)
        on_logs[arm] = score_jobs(run, f"{arm}-recordings", weights, logs, effects)
        if episodes:
            overlays[arm] = Job(
                f"overlay-{arm}", "sim", "overlay", (weights, episodes[-1], effects)
            )
    shares = (*scores.values(), *on_logs.values())
    jobs = [*(job for part in shares for job in part), *overlays.values()]
    report = tally.add(run.do(jobs, f"{iteration}: test"))
    return {
        arm: replace(
            found[arm],
            test=scored(report, scores[arm]),
            recordings=scored(report, on_logs[arm]),
            overlay=report.results.get(f"overlay-{arm}"),
        )
        for arm in fit
    }
