"""Returns to the state before an iteration: everything later is set aside, nothing is deleted."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from flywheel.data import Receipt, TrajectoryStore
from flywheel.errors import RunError
from flywheel.results import RESULT_FILE
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.run.folder import ARMS, POOLED, SEGMENT, SNAPSHOT, RunFolder
from flywheel.runtime.run.inventory import Fault, Inventory

_BEGINS = re.compile(r"i(\d{4,})-")
_OF_THE_END = re.compile(r"unseen-.*")


def rewind(folder: RunFolder, store: TrajectoryStore, iteration: int) -> list[str]:
    """Set aside a run's work from an iteration on, so that `--resume` repeats it.

    An episode stays if it is undamaged, and was driven without a model or by one that stays.

    Args:
      folder: of the run.
      store: of its episodes.
      iteration: the first to be repeated; one more than the last for the end of the run alone.

    Returns:
      Names of the files set aside.

    Raises:
      ConfigError: the run is in progress.
      RunError: a file that would stay is damaged, or there is no such iteration.
    """
    with hold(folder.lock, f"The run in {folder.path}"):
        look = Inventory(folder, store)
        faults = look.faults()
        _check(folder, iteration, look.end, faults)
        aside = folder.path / "aside" / time.strftime("%Y-%m-%d-%H%M%S")
        moved = []
        for path in _files_since(folder, iteration, faults):
            target = aside / path.relative_to(folder.path)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.rename(target)
            moved.append(str(path.relative_to(folder.path)))
        damaged = {fault.where for fault in faults}
        for name in store.snapshots():
            if _since(name, iteration) or name == POOLED or f"{SNAPSHOT}{name}.json" in damaged:
                store.quarantine_snapshot(name)
                moved.append(f"{SNAPSHOT}{name}.json")
        for name in _segments(folder, store, iteration, damaged):
            store.quarantine(name)
            moved.append(f"{SEGMENT}{name}")
        return moved


def _check(folder: RunFolder, iteration: int, end: int, faults: Iterable[Fault]) -> None:
    if not 0 <= iteration <= end:
        raise RunError(
            f"The run in {folder.path} has the iterations 0 to {end - 1}, and {end} for its end; got "
            f"{iteration}."
        )
    for fault in faults:
        if not fault.idle and (fault.since is None or fault.since < iteration):
            raise RunError(
                f"Nothing was set aside: a file that would stay is damaged. {fault.kind}: {fault} "
                + ("Restore a copy of it." if fault.since is None else f"Go back to {fault.since}.")
            )


def _files_since(folder: RunFolder, iteration: int, faults: Iterable[Fault]) -> Iterator[Path]:
    """The files to set aside. The result comes first: without it the run is not finished."""
    if (folder.path / RESULT_FILE).exists():
        yield folder.path / RESULT_FILE
    foreign = {fault.where for fault in faults if fault.idle and fault.kind == "foreign"}
    for part in ("iterations", "models", "videos"):
        for path in sorted((folder.path / part).glob("*")):
            end = part == "videos" and _OF_THE_END.fullmatch(path.name)
            if end or _since(path.name, iteration) or f"{part}/{path.name}" in foreign:
                yield path


def _segments(
    folder: RunFolder, store: TrajectoryStore, iteration: int, damaged: set[str]
) -> list[str]:
    """Names of the segments that do not stay."""
    turns = [folder.finished(i, arm) for i in range(iteration) for arm in ARMS]
    models = {"", *(turn.model for turn in turns if turn is not None)}
    there = store.committed()
    driven = [name for name, receipt in there.items() if not _models(receipt) <= models]
    wrong = [n for n in [*there, *store.unreadable()] if f"{SEGMENT}{n}" in damaged]
    return sorted({*driven, *wrong})


def _models(receipt: Receipt) -> set[str]:
    return {episode.model for episode in receipt.summaries}


def _since(name: str, iteration: int) -> bool:
    begins = _BEGINS.match(name)
    return begins is not None and int(begins[1]) >= iteration
