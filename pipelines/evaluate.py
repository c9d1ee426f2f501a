"""`flywheel evaluate`: the models of a run on its stored episodes."""

from __future__ import annotations

from pathlib import Path

from flywheel.errors import DataError
from flywheel.runtime.measures import ErrorNumbers
from flywheel.runtime.progress import console_progress
from flywheel.runtime.run_folder import name_of
from flywheel.runtime.weights import Weights
from flywheel.runtime.workers import FLOOR, PERSISTENCE, Scores, SimWorker
from pipelines.runs import WEIGHTS, OpenRun, open_run
from pipelines.show import console, table

SEED = 0  # of the starts: the same for every model, so that they are compared on the same windows
SPLITS = ("train", "validation", "test")


def score_models(
    run: Path, split: str, horizon: float, starts: int, full: bool, weights: Path | None
) -> None:
    """Score and print a table.

    Args:
      run: folder of the run.
      split: of its episodes.
      horizon: of the short predictions [s].
      starts: short predictions per episode.
      full: also predict whole episodes.
      weights: score this file instead of the run's own models.
    """
    opened = open_run(run)
    episodes = episodes_of(opened, split)
    changed = {"horizon_seconds": horizon, "starts": starts}
    evaluate = opened.config.evaluate.model_copy(update=changed)
    config = opened.config.model_copy(update={"evaluate": evaluate})
    worker = SimWorker(config, opened.folder.store_url(opened.config))
    subjects = subjects_of(opened, weights)
    rows = []
    with console_progress().stage("score", len(subjects)) as stage:
        for done, (name, subject) in enumerate(subjects.items()):
            stage.update(done, name)
            rows.append(_row(name, worker.score(subject, episodes, SEED, full)))
    title = f"{len(episodes)} {split} episodes, {starts} starts each, {horizon:g} s ahead"
    short = ["e_pos MSE/L [%]", "e_pos RMSE/L [%]", "e_rot [deg]"]
    whole = [f"full {column}" for column in short] if full else []
    out = console()
    out.print(table(title, ["model", *short, *whole, "#predictions", "problem"], rows))
    out.print("full: whole episodes, from their start. floor: MuJoCo from the same observations.")


def episodes_of(run: OpenRun, split: str) -> list[str]:
    """Ids of the episodes of one split, in every segment that is committed."""
    if split not in SPLITS:
        raise DataError(f"There is no split {split!r}. Known: {', '.join(SPLITS)}.")
    store = run.store
    found = [e.id for segment in sorted(store.committed()) for e in store.episodes(segment)]
    if not found:
        raise DataError(f"The run in {run.folder.path} has no {split} episodes.")
    return found


def subjects_of(run: OpenRun, weights: Path | None) -> dict[str, Weights | str]:
    """What is scored: one weights file, or the run's models, between floor and persistence."""
    models: dict[str, Weights | str] = {}
    if weights is not None:
        if not weights.exists():
            raise DataError(f"There is no weights file {weights}; a run has models/*/{WEIGHTS}.")
        models[weights.stem] = Weights.read(weights, str(weights))
    else:
        models = {name_of(i.iteration, i.arm): run.weights(i) for i in run.result.iterations}
    return {PERSISTENCE: PERSISTENCE, **models, FLOOR: FLOOR}


def _row(name: str, scores: Scores) -> tuple[object, ...]:
    """One line of the table; a model that predicts nothing finite says so."""
    cells: list[object] = [name]
    for table_ in (scores.short, scores.full):
        if table_ is None:
            continue
        numbers = ErrorNumbers.of(table_)
        cells += [numbers.e_pos_mse, numbers.e_pos_rmse, numbers.e_rot]
    return tuple(cells)
