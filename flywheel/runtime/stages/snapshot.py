"""Snapshot: freeze what an arm learns from."""

from __future__ import annotations

from flywheel.data import Snapshot
from flywheel.runtime.results import Arm
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.stages.outcomes import Collected


def snapshot(run: Run, iteration: int, collected: dict[Arm, Collected]) -> dict[Arm, Snapshot]:
    """Seal the data each arm had before together with what it has collected."""
    return {arm: _sealed(run, iteration, arm, new) for arm, new in collected.items()}


def _sealed(run: Run, iteration: int, arm: Arm, new: Collected) -> Snapshot:
    name = name_of(iteration, arm)
    if (there := run.snapshot(name)) is not None:
        return there
    if iteration == 0:
        segments, parent = run.config.collect.recordings, None
    else:
        parent = name_of(iteration - 1, run.arm_of(iteration - 1, arm))
        segments = tuple(run.store.snapshot(parent).segments)
        if run.changes_plant(iteration):  # what was simulated on the plant of before is wrong now
            segments = run.config.collect.recordings
    datasets = list(run.config.dataset_numbers())  # in the order of the network's one-hot
    return run.store.seal(name, [*segments, *new.segments], parent=parent, datasets=datasets)
