"""Drive the robot with each planner, and score models on held-out measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flywheel.results import Errors, Navigation, RobotResult, RobotScore, RunResult
from flywheel.runtime.config.robot_config import Planner
from flywheel.runtime.pool.jobs import Job, PoolReport
from flywheel.runtime.run.context import Model, Run, usable
from flywheel.runtime.stages.collect import valid_notes
from flywheel.runtime.stages.outcomes import ArmOutcome, Iteration
from flywheel.runtime.stages.scoring import navigation, score_jobs, scored
from flywheel.runtime.workers.episode_plan import EpisodePlan, robot_drives
from flywheel.runtime.workers.sim_worker import Baseline, KnownPlant

GIVEN, PLANT, RESIDUAL, NETWORK, NOISE = "given", "plant", "residual", "network", "noise"


def drive_robot(run: Run, iteration: Iteration, outcome: ArmOutcome) -> ArmOutcome:
    """Let every planner drive the robot to the goals; an unusable model does not drive."""
    robot = run.config.robot
    assert robot is not None, "only a run with a robot drives one"
    number = iteration.number
    trained = {NETWORK: outcome.usable_model, RESIDUAL: run.residual(number)}
    plans: dict[Planner, list[EpisodePlan]] = {
        planner: robot_drives(run.config, number, planner, iteration.effects)
        for planner in robot.planners
        if planner not in trained or trained[planner] is not None
    }
    jobs = [job for p, its in plans.items() for job in run.robot_jobs(its, trained.get(p))]
    report = iteration.add(run.do(jobs, f"{number}: drive the robot"))
    notes = [note for its in plans.values() for note in valid_notes(report, its, iteration)]
    driven = _driven(run, report, plans)
    before = iteration.latest[outcome.arm]
    found = RobotResult(
        minutes=run.robot_minutes(number),
        driven_minutes=sum(note.steps for note in notes) * run.config.network.dt / 60,
        drives=driven,
    )
    evaluated = replace(
        outcome.evaluated,
        robot=found,
        navigation=driven.get(NETWORK),
        champion_navigation=None if before is None else before.navigation,
    )
    return replace(outcome, evaluated=evaluated)


def _driven(
    run: Run, report: PoolReport, plans: Mapping[Planner, list[EpisodePlan]]
) -> dict[str, Navigation]:
    found = {planner: navigation(run, planner, report, its) for planner, its in plans.items()}
    return {planner: each for planner, each in found.items() if each is not None}


def robot_score_jobs(run: Run, iteration: Iteration) -> dict[str, list[Job]]:
    """Jobs that score all models but the network on the robot's held-out recordings.

    Args:
      run: in progress.
      iteration: with its drives.
    """
    episodes = run.recordings("test", iteration.number + 1)
    effects = iteration.effects
    subjects: dict[str, Baseline | KnownPlant | Model | None] = {
        GIVEN: KnownPlant(run.config.effects),
        PLANT: KnownPlant(effects),
        RESIDUAL: run.residual(iteration.number),
        NOISE: Baseline.NOISE,
    }
    return {
        name: score_jobs(
            run,
            f"robot-{name}",
            subject,
            episodes,
            subject.effects if isinstance(subject, KnownPlant) else effects,
            full=False,
        )
        for name, subject in subjects.items()
        if subject is not None
    }


def with_errors(
    outcome: ArmOutcome, report: PoolReport, jobs: Mapping[str, list[Job]]
) -> ArmOutcome:
    """The outcome with the errors on the robot's recordings; the network's are known already."""
    robot = outcome.evaluated.robot
    if robot is None:
        return outcome
    found = {name: scored(report, part) for name, part in jobs.items()}
    noise = found.pop(NOISE)
    errors = {NETWORK: outcome.evaluated.recordings, **found}
    known = {name: each for name, each in errors.items() if each is not None}
    result = robot.model_copy(
        update={"errors": known, "noise": None if noise is None else noise.short}
    )
    return replace(outcome, evaluated=replace(outcome.evaluated, robot=result))


def score_finally(run: Run, so_far: RunResult) -> RunResult:
    """Score the models of all iterations on all of the robot's held-out recordings."""
    if run.config.robot is None:
        return so_far
    last = run.config.iterations
    episodes = run.recordings("test", last + 1)
    jobs: dict[tuple[int, str], list[Job]] = {}
    for result in so_far.of_arm("mppi"):
        number = result.iteration
        models: dict[str, Model | KnownPlant] = {PLANT: KnownPlant(run.effects(number))}
        if usable(result.validation):
            models[NETWORK] = run.model_of(result)
        if (corrected := run.residual(number)) is not None:
            models[RESIDUAL] = corrected
        if number == 0:
            models[GIVEN] = KnownPlant(run.config.effects)
        for name, model in models.items():
            known = run.config.effects if name == GIVEN else run.effects(number)
            label = f"on-robot-{number}-{name}"
            jobs[number, name] = score_jobs(run, label, model, episodes, known, full=False)
    noise = score_jobs(run, "on-robot-noise", Baseline.NOISE, episodes, (), full=False)
    report = run.do(
        [*(job for part in jobs.values() for job in part), *noise], "robot's recordings"
    )
    errors = {key: scored(report, part) for key, part in jobs.items()}
    least: Errors | None = scored(report, noise)
    return so_far.model_copy(
        update={
            "on_robot": tuple(
                RobotScore(
                    iteration=number,
                    model=name,
                    minutes=0.0 if name == GIVEN else run.robot_minutes(number),
                    errors=found,
                )
                for (number, name), found in errors.items()
                if found is not None
            ),
            "robot_noise": None if least is None else least.short,
        }
    )
