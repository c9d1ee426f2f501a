"""`flywheel evaluate`: the models of a run on its stored episodes."""

from __future__ import annotations

from pathlib import Path

from flywheel.cli.runs import OpenRun, open_run
from flywheel.cli.show import console, table
from flywheel.errors import DataError
from flywheel.evaluation import BINS
from flywheel.registry import lookup
from flywheel.runtime.measures import ErrorNumbers
from flywheel.runtime.pool.progress import console_progress
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.run.seeds import derive_seed
from flywheel.runtime.workers.model_weights import Weights
from flywheel.runtime.workers.sim_worker import (
    FLOOR,
    INFORMED_FLOOR,
    PERSISTENCE,
    Scores,
    SimWorker,
)

ERRORS = ("e_pos MSE/L [%]", "e_pos RMSE/L [%]", "e_rot [deg]")
SPLITS = ("train", "validation", "test")


def score_models(
    run: Path,
    split: str,
    horizon: float,
    starts: int,
    full: bool,
    weights: Path | None,
    by: str = "all",
) -> None:
    """Score and print a table.

    Args:
      run: folder of the run.
      split: of its episodes.
      horizon: of the short predictions [s].
      starts: short predictions per episode.
      full: also predict whole episodes.
      weights: score this file instead of the run's own models.
      by: subsets of the episodes that are scored apart, as in `evaluation.BINS`.
    """
    opened = open_run(run)
    episodes = episodes_of(opened, split)
    groups = _groups(opened, episodes, by)
    changed = {"horizon_seconds": horizon, "starts": starts}
    evaluate = opened.config.evaluate.model_copy(update=changed)
    config = opened.config.model_copy(update={"evaluate": evaluate})
    worker = SimWorker(config, opened.folder.store_url(opened.config), opened.robot)
    subjects = subjects_of(opened, weights)
    seed = derive_seed(config.seed, "score")  # of the starts: those that the run itself used
    known = {
        name_of(i.iteration, i.arm): opened.result.effects_before(i.iteration + 1)
        for i in opened.result.iterations
    }
    latest = opened.result.effects_before(opened.config.iterations + 1)
    rows = []
    asked = [(name, group) for group in groups for name in subjects]
    with console_progress().stage("score", len(asked)) as stage:
        for done, (name, group) in enumerate(asked):
            stage.update(done, name if by == "all" else f"{name}, {group}")
            effects = known.get(name, latest)
            found = worker.score(subjects[name], groups[group], seed, full, effects)
            about = (name,) if by == "all" else (group, name)
            rows.append((*about, *_row(found)))
    title = f"{len(episodes)} {split} episodes, {starts} starts each, {horizon:g} s ahead"
    first = ["model"] if by == "all" else [by, "model"]
    columns = [*first, *ERRORS, *(f"full {name}" for name in ERRORS), "#predictions", "problem"]
    out = console()
    out.print(table(title, columns, rows))
    out.say(
        "full: whole episodes, from their start. floor: MuJoCo from the same observations, with a "
        "random roll of each rod. informed floor: with the roll that the cables tell."
    )


def episodes_of(run: OpenRun, split: str) -> list[str]:
    """Ids of the episodes of one split, in every segment that is committed."""
    if split not in SPLITS:
        raise DataError(f"There is no split {split!r}. Known: {', '.join(SPLITS)}.")
    store = run.store
    found = [
        episode.id
        for segment in sorted(store.committed())
        for episode in store.episodes(segment)
        if episode.split == split and episode.iteration >= 0  # not the oracle's
    ]
    if not found:
        raise DataError(f"The run in {run.folder.path} has no {split} episodes.")
    return found


def _groups(run: OpenRun, episodes: list[str], by: str) -> dict[str, list[str]]:
    """Ids of the episodes of each subset."""
    bin_of = lookup(BINS, by, "subset of episodes")
    if by == "all":
        return {"all": episodes}
    groups: dict[str, list[str]] = {}
    for name in episodes:
        groups.setdefault(bin_of(run.store.read(name)), []).append(name)
    return dict(sorted(groups.items()))


def subjects_of(run: OpenRun, weights: Path | None) -> dict[str, Weights | str]:
    """What is scored: one weights file, or the run's models, between persistence and the floors."""
    models: dict[str, Weights | str] = {}
    if weights is not None:
        if not weights.exists():
            raise DataError(f"There is no weights file {weights}.")
        models[weights.stem] = Weights.read(weights, run.robot)
    else:
        models = {name_of(i.iteration, i.arm): run.weights(i) for i in run.result.iterations}
    beside = {name: name for name in (FLOOR, INFORMED_FLOOR)}
    return {PERSISTENCE: PERSISTENCE, **models, **beside}


def _row(scores: Scores) -> tuple[object, ...]:
    """One line of the table; a model that predicts nothing finite says so."""
    short, full = (
        None if errors is None else ErrorNumbers.of(errors)
        for errors in (scores.short, scores.full)
    )
    count = None if short is None else short.windows
    return (*_numbers(short), *_numbers(full), count, scores.problem)


def _numbers(errors: ErrorNumbers | None) -> tuple[float | None, ...]:
    if errors is None:
        return (None,) * len(ERRORS)
    return (errors.e_pos_mse, errors.e_pos_rmse, errors.e_rot)
