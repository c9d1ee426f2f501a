"""The end of a run: every model on the same pooled tests, beside what it is compared with."""

from __future__ import annotations

from pathlib import Path

from flywheel.files import file_name
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.results import PooledTest, RunResult, UnseenCourse
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
from flywheel.runtime.workers.sim_worker import FLOOR, INFORMED_FLOOR, PERSISTENCE

ON_RECORDINGS = "persistence on recordings"


def conclude(run: Run, so_far: RunResult) -> RunResult:
    """Score every model, the floors and persistence on the test episodes of all iterations.

    The test episodes are sealed under a name of their own: the numbers say what they are of.
    """
    episodes = run.test_episodes(run.config.iterations)
    if run.snapshot(POOLED) is None:
        run.store.seal(POOLED, episodes, parent=None)
    scores: dict[str, list[Job]] = {}
    effects = run.effects(run.config.iterations)
    for result in so_far.iterations:
        if usable(result.validation):
            weights = run.weights(run.model_of(result))
            name = f"{result.arm}-{result.iteration}"
            scores[name] = score_jobs(run, name, weights, episodes, effects)
    scores[PERSISTENCE] = score_jobs(run, PERSISTENCE, PERSISTENCE, episodes, effects)
    logs = run.test_recordings()
    scores[ON_RECORDINGS] = score_jobs(run, f"{PERSISTENCE}-recordings", PERSISTENCE, logs, effects)
    if run.config.evaluate.floor:
        for floor in (FLOOR, INFORMED_FLOOR):
            name = floor.replace(" ", "-")
            scores[floor] = score_jobs(run, name, floor, episodes, effects)
    plans = ceiling(run.config, effects)
    elsewhere = _on_unseen_courses(run, effects)
    jobs = [*(job for part in scores.values() for job in part), *run.recordings(plans)]
    report = run.do(jobs, "pooled tests")
    errors = {name: scored(report, part) for name, part in scores.items()}
    return so_far.model_copy(
        update={
            "pooled": tuple(
                PooledTest(arm=r.arm, iteration=r.iteration, model=r.model, errors=found)
                for r in so_far.iterations
                if (found := errors.get(f"{r.arm}-{r.iteration}")) is not None
            ),
            "floor": errors.get(FLOOR),
            "informed_floor": errors.get(INFORMED_FLOOR),
            "persistence": errors[PERSISTENCE],
            "persistence_on_recordings": errors[ON_RECORDINGS],
            "oracle": navigation(run, "mppi on the plant", report, plans),
            "unseen": elsewhere,
            "finished": True,
        }
    )


def _on_unseen_courses(run: Run, effects: Effects) -> tuple[UnseenCourse, ...]:
    """The last champion, and the planner that knows the plant, on each course they have not met."""
    found, champion = [], run.latest_model("mppi")
    for course in run.config.evaluate.unseen if champion is not None else ():
        plans, best = (
            unseen(run.config, course, effects),
            unseen_ceiling(run.config, course, effects),
        )
        jobs = [*run.recordings(plans, champion), *run.recordings(best)]
        name = file_name(Path(course).stem)
        report = run.do(jobs, f"unseen course {name}")
        driven = navigation(run, "mppi", report, plans)
        if driven is None:
            continue
        found.append(
            UnseenCourse(
                course=name,
                navigation=driven,
                oracle=navigation(run, "mppi on the plant", report, best),
                video=film(run, plans, unseen_name(course)),
            )
        )
    return tuple(found)
