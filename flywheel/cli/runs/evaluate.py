"""`flywheel evaluate`: the models of a run on its stored episodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flywheel.cli.console import console, table
from flywheel.cli.options import RunArgument
from flywheel.quantities import HorizonSeconds, Samples

if TYPE_CHECKING:
    from flywheel.cli.runs.opening import OpenRun
    from flywheel.data.catalogue import EpisodeSummary
    from flywheel.records import Episode
    from flywheel.results import ErrorNumbers
    from flywheel.runtime.workers.model_weights import AnyWeights
    from flywheel.runtime.workers.sim_worker import Baseline, Scores

ERRORS = ("e_pos MSE/L [%]", "e_pos RMSE/L [%]", "e_rot [deg]")
SPLITS = ("train", "validation", "test")


def evaluate(
    run: RunArgument,
    *,
    split: str = "test",
    horizon: HorizonSeconds = 2.0,
    starts: Samples = 10,
    full: bool = True,
    weights: Path | None = None,
    by: str = "all",
) -> None:
    """Score the models of a run on its stored episodes, compared with no motion.

    [bold]Examples[/bold]

    flywheel evaluate runs/prism3 --split validation

    flywheel evaluate runs/prism3 --by controller [dim](where it fails)[/dim]

    Args:
      split: Split of the episodes: test, validation or train.
      horizon: Length of the short predictions, in seconds.
      starts: Short predictions per episode.
      full: Also predict whole episodes.
      weights: Score this weights file instead of the run's own models.
      by: Group the scores by: controller, dataset, iteration, source, ground.
    """
    from flywheel.cli.runs.opening import open_run
    from flywheel.evaluation import BINS
    from flywheel.registry import lookup

    opened, bin_of = open_run(run), lookup(BINS, by, "subset of episodes")
    episodes = _episodes_of(opened, split, horizon)
    groups = {"all": episodes} if by == "all" else _groups(opened, episodes, bin_of)
    changed = {"horizon_seconds": horizon, "starts": starts}
    evaluate = opened.config.evaluate.model_copy(update=changed)
    scored = replace(opened, config=opened.config.model_copy(update={"evaluate": evaluate}))
    rows = _rows(scored, groups, _subjects(opened, weights), full)
    title = f"{len(episodes)} {split} episodes, {starts} starts each, {horizon:g} s ahead"
    first = ["model"] if by == "all" else [by, "model"]
    columns = [*first, *ERRORS, *(f"full {name}" for name in ERRORS), "#predictions", "problem"]
    out = console()
    out.print(table(title, columns, rows))
    out.say(
        "full: whole episodes, from their start. floor: MuJoCo from the same observations, with "
        "a random roll of each rod. informed floor: with the roll computed from the cables. noise: of "
        "recordings, a perfect model's errors."
    )


def _rows(
    run: OpenRun,
    groups: dict[str, list[EpisodeSummary]],
    subjects: dict[str, AnyWeights | Baseline],
    full: bool,
) -> list[tuple[object, ...]]:
    """One row per group of episodes and subject; the group is named unless it is the only one."""
    from flywheel.records import RECORDING
    from flywheel.runtime.pool.progress import console_progress
    from flywheel.runtime.run.folder import name_of
    from flywheel.runtime.workers.episode_plan import derive_seed
    from flywheel.runtime.workers.sim_worker import Baseline, SimWorker

    config, apart = run.config, list(groups) != ["all"]
    worker = SimWorker(config, run.folder.store_url(config), run.robot)
    seed = derive_seed(config.seed, "score")  # of the starts: those that the run itself used
    known = {
        name_of(i.iteration, i.arm): run.result.effects_before(i.iteration + 1)
        for i in run.result.iterations
    }
    latest = run.result.effects_before(config.iterations + 1)
    rows: list[tuple[object, ...]] = []
    asked = [
        (name, group)
        for group, episodes in groups.items()
        for name in subjects  # a simulated episode is compared with its true states, which have no noise
        if subjects[name] is not Baseline.NOISE
        or all(each.source == RECORDING for each in episodes)
    ]
    with console_progress().stage("score", len(asked)) as stage:
        for done, (name, group) in enumerate(asked):
            stage.update(done, f"{name}, {group}" if apart else name)
            effects = known.get(name, latest)
            ids = [each.id for each in groups[group]]
            found = worker.score(subjects[name], ids, seed, full, effects)
            rows.append((*((group,) if apart else ()), name, *_row(found)))
    return rows


def _episodes_of(run: OpenRun, split: str, horizon: float) -> list[EpisodeSummary]:
    """The episodes of one split, in every committed segment; one at least is as long as the horizon [s]."""
    from flywheel.errors import DataError

    if split not in SPLITS:
        raise DataError(f"There is no split {split!r}. Known: {', '.join(SPLITS)}.")
    store = run.store
    found = [
        episode
        for segment in sorted(store.committed())
        for episode in store.episodes(segment)
        if episode.split == split and episode.iteration >= 0  # not the oracle's
    ]
    if not found:
        raise DataError(f"The run in {run.folder.path} has no {split} episodes.")
    if horizon > (longest := max(episode.seconds for episode in found)):
        raise DataError(
            f"No {split} episode has {horizon:g} s to predict; the longest is of {longest:g} s (--horizon)."
        )
    return found


def _groups(
    run: OpenRun, episodes: list[EpisodeSummary], bin_of: Callable[[Episode], str]
) -> dict[str, list[EpisodeSummary]]:
    """The episodes of each subset."""
    groups: dict[str, list[EpisodeSummary]] = {}
    for each in episodes:
        groups.setdefault(bin_of(run.store.read(each.id)), []).append(each)
    return dict(sorted(groups.items()))


def _subjects(run: OpenRun, weights: Path | None) -> dict[str, AnyWeights | Baseline]:
    """Scored models: one weights file, or the run's models, between persistence and the floors."""
    from flywheel.errors import DataError
    from flywheel.runtime.run.folder import name_of
    from flywheel.runtime.workers.model_weights import read_weights
    from flywheel.runtime.workers.sim_worker import Baseline

    models: dict[str, AnyWeights | Baseline] = {}
    if weights is not None:
        if not weights.exists():
            raise DataError(f"There is no weights file {weights}.")
        models[weights.stem] = read_weights(weights, run.robot)
    else:
        models = {name_of(i.iteration, i.arm): run.weights(i) for i in run.result.iterations}
    still, *floors = Baseline
    return {still: still, **models, **{floor: floor for floor in floors}}


def _row(scores: Scores) -> tuple[object, ...]:
    """One line of the table; a model without finite predictions is marked."""
    from flywheel.results import ErrorNumbers

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
