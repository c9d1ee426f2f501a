"""The end of a run: every model on the same pooled tests, and the baselines on them."""

from __future__ import annotations

from pathlib import Path

from flywheel.files import file_name
from flywheel.results import PooledTest, RunResult, UnseenCourse
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.run.context import Run, usable
from flywheel.runtime.run.folder import POOLED
from flywheel.runtime.stages.scoring import navigation, score_jobs, scored
from flywheel.runtime.stages.video import film
from flywheel.runtime.workers.episode_plan import (
    Effects,
    ceiling,
    unseen,
    unseen_ceiling,
    unseen_name,
)
from flywheel.runtime.workers.sim_worker import Baseline

ON_RECORDINGS = f"{Baseline.PERSISTENCE}-recordings"


def evaluate_finally(run: Run, so_far: RunResult) -> RunResult:
    """Score every model, the floors and persistence on the test episodes of all iterations.

    The test episodes are sealed as a separate snapshot, so that the numbers name their data.

    Args:
      run: with all iterations complete.
      so_far: its result without the final numbers.

    Returns:
      The result, finished.
    """
    episodes = run.test_episodes(run.config.iterations)
    if run.snapshot(POOLED) is None:
        run.store.seal(POOLED, episodes, parent=None)
    effects = run.effects(run.config.iterations)
    scores = _score_jobs(run, so_far, episodes, effects)
    plans = ceiling(run.config, effects)
    on_unseen_courses = _on_unseen_courses(run, effects)
    jobs = [*(job for part in scores.values() for job in part), *run.episode_jobs(plans)]
    report = run.do(jobs, "pooled tests")
    errors = {name: scored(report, part) for name, part in scores.items()}
    return so_far.model_copy(
        update={
            "pooled": tuple(
                PooledTest(arm=r.arm, iteration=r.iteration, model=r.model, errors=found)
                for r in so_far.iterations
                if (found := errors.get(f"{r.arm}-{r.iteration}")) is not None
            ),
            "floor": errors.get(Baseline.FLOOR),
            "informed_floor": errors.get(Baseline.INFORMED_FLOOR),
            "persistence": errors[Baseline.PERSISTENCE],
            "persistence_on_recordings": errors[ON_RECORDINGS],
            "oracle": navigation(run, "mppi on the plant", report, plans),
            "unseen": on_unseen_courses,
            "finished": True,
        }
    )


def _score_jobs(
    run: Run, so_far: RunResult, episodes: list[str], effects: Effects
) -> dict[str, list[Job]]:
    """The jobs of every model and baseline, by its name."""
    jobs: dict[str, list[Job]] = {}
    for result in so_far.iterations:
        if usable(result.validation):
            name = f"{result.arm}-{result.iteration}"
            jobs[name] = score_jobs(run, name, run.model_of(result), episodes, effects)
    still, recordings = Baseline.PERSISTENCE, run.recordings("test", run.config.iterations + 1)
    jobs[still] = score_jobs(run, still, still, episodes, effects)
    jobs[ON_RECORDINGS] = score_jobs(run, ON_RECORDINGS, still, recordings, effects)
    if run.config.evaluate.floor:
        for floor in (Baseline.FLOOR, Baseline.INFORMED_FLOOR):
            jobs[floor] = score_jobs(run, floor.replace(" ", "-"), floor, episodes, effects)
    return jobs


def _on_unseen_courses(run: Run, effects: Effects) -> tuple[UnseenCourse, ...]:
    """Drive the last champion, and the planner that knows the plant, through each unseen course."""
    found: list[UnseenCourse] = []
    champion = run.latest_model("mppi")
    if champion is None:
        return ()
    for course in run.config.evaluate.unseen:
        plans = unseen(run.config, course, effects)
        ceiling_plans = unseen_ceiling(run.config, course, effects)
        jobs = [*run.episode_jobs(plans, champion), *run.episode_jobs(ceiling_plans)]
        name = file_name(Path(course).stem)
        report = run.do(jobs, f"unseen course {name}")
        driven = navigation(run, "mppi", report, plans)
        if driven is None:
            continue
        found.append(
            UnseenCourse(
                course=name,
                navigation=driven,
                oracle=navigation(run, "mppi on the plant", report, ceiling_plans),
                video=film(run, plans, unseen_name(course)),
            )
        )
    return tuple(found)
