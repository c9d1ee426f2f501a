"""Train: a model per arm, on its snapshot."""

from __future__ import annotations

from flywheel.data import Snapshot
from flywheel.dynamics.gnn import load_weights
from flywheel.errors import RunError
from flywheel.runtime.pool.jobs import Job
from flywheel.runtime.results import Arm
from flywheel.runtime.run.context import Model, Run
from flywheel.runtime.stages.outcomes import Tally, Trained
from flywheel.runtime.tracking.pyfunc_model import write_served
from flywheel.runtime.workers.episode_plan import ceiling, derive_seed
from flywheel.runtime.workers.trainer_worker import TrainingNote, TrainingOrder

SECONDS_PER_STEP = 0.15  # roughly; for the time left that is shown


def train(
    run: Run, iteration: int, snapshots: dict[Arm, Snapshot], tally: Tally
) -> dict[Arm, Trained]:
    """Train from the arm's latest weights if there are any, else from new ones.

    While the very first model trains, cores that it leaves idle record the ceiling's episodes, if the
    plant that these are on is known already.

    Raises:
      RunError: a training took three trainers down with it, or the very first one diverged.
    """
    jobs = {arm: _job(run, iteration, arm, frozen) for arm, frozen in snapshots.items()}
    plant_stays = iteration == 0 and not run.config.diagnose.on
    ahead = run.recordings(ceiling(run.config, run.config.effects)) if plant_stays else []
    report = tally.add(run.do([*jobs.values(), *ahead], f"{iteration}: train"))
    trained: dict[Arm, Trained] = {}
    for arm, job in jobs.items():
        note: TrainingNote | None = report.results.get(job.id)
        if note is None:
            raise RunError(f"Training {job.id} failed: {tally.problems[-1]}")
        if note.problem:
            tally.problems.append(note.problem)
            if iteration == 0:
                raise RunError(f"The first training failed, there is no model: {note.problem}")
        model = None if note.problem else _kept(run, iteration, arm, note, snapshots[arm].digest)
        trained[arm] = Trained(model, note)
    return trained


def _kept(run: Run, iteration: int, arm: Arm, note: TrainingNote, snapshot: str) -> Model:
    """The weights in a folder that explains itself."""
    path = run.folder.weights(iteration, arm)
    write_served(path.parent, run.robot, load_weights(note.weights, run.robot), snapshot)
    return Model(arm, iteration, note.digest, path)


def _job(run: Run, iteration: int, arm: Arm, frozen: Snapshot) -> Job:
    before = run.latest_model(arm)
    order = TrainingOrder(
        snapshot=frozen.name,
        folder=run.folder.model(iteration, arm),
        cache=run.folder.cache / frozen.name,
        initial=None if before is None else before.path,
        seed=derive_seed(run.config.seed, "train", iteration),
        effects=run.effects(iteration),
    )
    schedule = run.config.training.fine_tuning if before else run.config.training.initial
    size = SECONDS_PER_STEP * schedule.steps
    return Job(f"train-{frozen.name}", "trainer", "train", (order,), size)
