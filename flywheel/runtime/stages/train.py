"""Train: a model per arm, on its snapshot."""

from __future__ import annotations

from dataclasses import replace

from flywheel.dynamics.gnn import load_weights
from flywheel.errors import RunError
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.run.context import Model, Run
from flywheel.runtime.stages.outcomes import ArmOutcome, Iteration
from flywheel.runtime.tracking.pyfunc_model import write_model
from flywheel.runtime.workers.episode_plan import ceiling, derive_seed
from flywheel.runtime.workers.trainer_worker import ResidualOrder, TrainingNote, TrainingOrder

SECONDS_PER_STEP = 0.15  # of the optimiser, roughly; for the remaining time that is shown


def train(run: Run, iteration: Iteration, outcomes: list[ArmOutcome]) -> list[ArmOutcome]:
    """Train each arm from its latest weights, else from those of `training.from`, else from random ones.

    While the first model trains, idle cores record the ceiling's episodes, if the plant for these
    is known already.

    Raises:
      RunError: a training killed three trainers, or the first one diverged.
    """
    jobs = [_job(run, iteration, outcome) for outcome in outcomes]
    plant_stays = iteration.number == 0 and not run.config.diagnose.on
    ahead = run.episode_jobs(ceiling(run.config, run.config.effects)) if plant_stays else []
    residual = _residual_jobs(run, iteration)
    report = iteration.add(run.do([*jobs, *residual, *ahead], f"{iteration.number}: train"))
    iteration.problems += [problem for job in residual if (problem := report.results.get(job.id))]
    trained = []
    for outcome, job in zip(outcomes, jobs, strict=True):
        note: TrainingNote | None = report.results.get(job.id)
        if note is None:
            raise RunError(f"Training {job.id} failed: {iteration.problems[-1]}")
        if note.problem:
            iteration.problems.append(note.problem)
            if iteration.number == 0:
                raise RunError(f"The first training failed, there is no model: {note.problem}")
        model = None if note.problem else _kept(run, iteration.number, outcome, note)
        trained.append(replace(outcome, model=model, training=note))
    return trained


def _kept(run: Run, number: int, outcome: ArmOutcome, note: TrainingNote) -> Model:
    """Write the trained weights into a self-contained folder."""
    path = run.folder.weights(number, outcome.arm)
    network = load_weights(note.weights, run.robot)
    write_model(path.parent, run.robot, network, outcome.snapshot.digest)
    return Model(outcome.arm, number, note.digest, path)


def _residual_jobs(run: Run, iteration: Iteration) -> list[Job]:
    """The training of the residual model, in parallel with the network's."""
    if not run.config.residual.on:
        return []
    number = iteration.number
    learned = (*run.recordings("train", number), *run.recordings("validation", number))
    order = ResidualOrder(
        recordings=learned,
        path=run.folder.residual(number),
        seed=derive_seed(run.config.seed, "residual", number),
        effects=iteration.effects,
    )
    size = SECONDS_PER_STEP * run.config.residual.training.steps
    return [Job(f"residual-{number:04d}", "trainer", "train_residual", (order,), size)]


def _job(run: Run, iteration: Iteration, outcome: ArmOutcome) -> Job:
    before, snapshot = iteration.models.get(outcome.arm), outcome.snapshot.name
    initial = run.folder.initial_weights if before is None else before.path
    order = TrainingOrder(
        snapshot=snapshot,
        folder=run.folder.model(iteration.number, outcome.arm),
        cache=run.folder.cache / snapshot,
        initial=initial,
        seed=derive_seed(run.config.seed, "train", iteration.number),
        effects=iteration.effects,
    )
    training = run.config.training
    schedule = training.initial if initial is None else training.fine_tuning
    return Job(f"train-{snapshot}", "trainer", "train", (order,), SECONDS_PER_STEP * schedule.steps)
