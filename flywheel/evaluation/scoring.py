"""Scoring a dynamics model on recorded episodes: short horizons, and whole episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import DataError
from flywheel.evaluation.errors import ErrorTable
from flywheel.evaluation.pasts import past_at, stacked
from flywheel.records import Episode, Floats, KnownWinch
from flywheel.terrain import is_level

Truth = Callable[[Episode], Floats]

HISTORY_SECONDS = 0.5  # no prediction starts earlier in an episode that is long enough
WHOLE = 64  # whole episodes per rollout call
SEEN_SECONDS = 0.1  # before a start each point was seen: as long as any model's memory at least

BINS: dict[str, Callable[[Episode], str]] = {
    "all": lambda episode: "all",
    "controller": lambda episode: episode.provenance.controller,
    "dataset": lambda episode: episode.provenance.dataset,
    "iteration": lambda episode: str(episode.provenance.iteration),
    "source": lambda episode: episode.provenance.source,
    "ground": lambda episode: "plane" if is_level(episode.terrain) else "terrain",
}


@dataclass(frozen=True)
class Window:
    """Start and length of a scored prediction.

    Attributes:
      episode: of the window.
      start: index of the model's present observation.
      steps: control steps predicted.
    """

    episode: Episode
    start: int
    steps: int


def score(
    dynamics: Dynamics,
    episodes: Iterable[Episode],
    *,
    horizon_seconds: float = 2.0,
    starts_per_episode: int = 14,
    seed: int,
    truth: Truth | None = None,
    datasets: Mapping[str, int] | None = None,
    winches: KnownWinch | None = None,
    batch: int = 256,
) -> ErrorTable:
    """Errors over short horizons from random starts.

    The starts depend on the seed and the episode alone, so that every model is scored on the same
    ones. No prediction starts while a point has been out of sight for some time.

    Args:
      dynamics: the model.
      episodes: recorded on the model's robot, at its dt.
      horizon_seconds: predicted from each start [s].
      starts_per_episode: drawn uniformly, with repetition; none for an episode without a place for
        one (see `places`).
      seed: of the starts.
      truth: points (T + 1, P, 3) to score against instead of the measured ones, e.g. the noise-free
        ones of a simulated episode. The model always starts from the measured ones.
      datasets: index of each data set for the network's one-hot; 0 for all if None.
      winches: best known positions; None for `Robot.winches_of`.
      batch: windows per rollout call.

    Raises:
      DataError: an episode does not fit the model, or no window fits any episode.
      ModelError: a prediction is not finite.
    """
    steps = round(horizon_seconds / dynamics.dt)
    if steps < 1:
        raise DataError(
            f"horizon_seconds must be at least 1 step of {dynamics.dt} s, got {horizon_seconds!r} s."
        )
    earliest = round(HISTORY_SECONDS / dynamics.dt)
    windows = []
    for episode in episodes:
        allowed = places(episode, steps, earliest)
        if len(allowed) == 0:
            continue
        rng = np.random.default_rng([seed, *episode.id.encode()])
        for start in allowed[rng.integers(0, len(allowed), starts_per_episode)]:
            windows.append(Window(episode, int(start), steps))
    if not windows:
        raise DataError(
            f"No episode is long enough to predict {horizon_seconds} s ({steps} steps of "
            f"{dynamics.dt} s) from where all points are in sight; give longer episodes or a shorter "
            "horizon."
        )
    return _score_windows(dynamics, windows, truth, datasets, winches, batch)


def score_full(
    dynamics: Dynamics,
    episodes: Iterable[Episode],
    *,
    truth: Truth | None = None,
    datasets: Mapping[str, int] | None = None,
    winches: KnownWinch | None = None,
) -> ErrorTable:
    """Errors of one prediction over each whole episode, from `HISTORY_SECONDS` to its end.

    If a point is out of sight then, it starts when all have come into sight. Episodes of different
    lengths share a rollout call; steps after an episode's end have no weight. Other arguments and
    errors as in `score`.
    """
    earliest = round(HISTORY_SECONDS / dynamics.dt)
    windows = [
        Window(episode, int(allowed[0]), episode.trajectory.steps - int(allowed[0]))
        for episode in episodes
        if episode.trajectory.steps > earliest and len(allowed := places(episode, 1, earliest))
    ]
    if not windows:
        raise DataError(
            f"No episode is longer than {HISTORY_SECONDS} s, where predictions start, with all points "
            "in sight."
        )
    windows.sort(key=lambda window: window.steps)  # so that little of a batch is padding
    return _score_windows(dynamics, windows, truth, datasets, winches, WHOLE)


def places(episode: Episode, steps: int, earliest: int = 0) -> NDArray[np.int64]:
    """Possible starts of predictions of so many control steps in an episode, ascending.

    Not before step `earliest` in a sufficiently long episode; and only if each point was seen
    within `SEEN_SECONDS`.
    """
    trajectory = episode.trajectory
    last = trajectory.steps - steps
    starts = np.arange(min(earliest, last), last + 1) if last >= 0 else np.arange(0)
    valid = trajectory.observations.valid
    if valid.all():
        return starts
    recent = round(SEEN_SECONDS / trajectory.dt)
    seen = np.concatenate([np.zeros((1, valid.shape[1]), np.int64), np.cumsum(valid, axis=0)])
    in_sight = (seen[starts + 1] > seen[np.maximum(starts - recent, 0)]).all(axis=1)
    return starts[in_sight]


def score_by(
    bin: Callable[[Episode], str], episodes: Iterable[Episode], scorer: Callable[..., ErrorTable]
) -> dict[str, ErrorTable]:
    """One table per named subset of the episodes, e.g. `score_by(BINS["dataset"], ...)`.

    Args:
      bin: the subset that an episode belongs to (see `BINS`).
      episodes: to be scored.
      scorer: called with the episodes of each subset, e.g. a `functools.partial` of `score`.
    """
    groups: dict[str, list[Episode]] = {}
    for episode in episodes:
        groups.setdefault(bin(episode), []).append(episode)
    return {name: scorer(group) for name, group in sorted(groups.items())}


def _score_windows(
    dynamics: Dynamics,
    windows: Sequence[Window],
    truth: Truth | None,
    datasets: Mapping[str, int] | None,
    winches: KnownWinch | None,
    batch: int,
) -> ErrorTable:
    """Errors over given windows; in as few rollout calls as `batch` and the data sets allow."""
    table = ErrorTable.empty(dynamics.robot, dynamics.dt)
    groups: dict[int, list[Window]] = {}
    for window in windows:
        _check_fits(window.episode, dynamics)
        groups.setdefault(_dataset(window.episode, datasets), []).append(window)
    for dataset, group in sorted(groups.items()):
        for i in range(0, len(group), batch):
            part = group[i : i + batch]
            table = table + _score_batch(dynamics, part, dataset, truth, winches)
    return table


def _score_batch(
    dynamics: Dynamics,
    windows: Sequence[Window],
    dataset: int,
    truth: Truth | None,
    winches: KnownWinch | None,
) -> ErrorTable:
    robot, longest = dynamics.robot, max(window.steps for window in windows)
    known: dict[str, Floats] = {}
    pasts, controls, targets = [], [], []
    for window in windows:
        trajectory = window.episode.trajectory
        if window.episode.id not in known:
            known[window.episode.id] = (winches or robot.winches_of)(window.episode)
        winch = known[window.episode.id]
        pasts.append(past_at(window.episode, robot, window.start, dynamics.history, winch, dataset))
        end = window.start + window.steps
        hold = robot.holding(winch[end])
        controls.append(_padded(trajectory.controls[window.start : end], longest, hold))
        points = trajectory.observations.points if truth is None else truth(window.episode)
        targets.append(_padded(points[window.start + 1 : end + 1], longest, np.nan))
    predicted = dynamics.rollout(stacked(pasts), np.stack(controls)).points[:, 1:]
    return ErrorTable.between(robot, dynamics.dt, np.stack(targets), predicted)


def _padded(array: Floats, length: int, value: Floats | float) -> Floats:
    filled = np.empty((length, *array.shape[1:]))
    filled[: len(array)] = array
    filled[len(array) :] = value
    return filled


def _dataset(episode: Episode, datasets: Mapping[str, int] | None) -> int:
    if datasets is None:
        return 0
    name = episode.provenance.dataset
    if name not in datasets:
        known = ", ".join(sorted(datasets))
        raise DataError(f"Episode {episode.id}: no data set {name!r} is known. Known: {known}.")
    return datasets[name]


def _check_fits(episode: Episode, dynamics: Dynamics) -> None:
    trajectory, robot = episode.trajectory, dynamics.robot
    if abs(trajectory.dt - dynamics.dt) > 1e-9:
        raise DataError(
            f"Episode {episode.id} has dt {trajectory.dt} s, the model predicts at {dynamics.dt} s."
        )
    got = (trajectory.observations.points.shape[-2], trajectory.controls.shape[-1])
    wanted = (len(robot.points), len(robot.winches))
    if got != wanted:
        raise DataError(
            f"Episode {episode.id} has (points, winches) = {got}; robot {robot.name} has {wanted}."
        )
