"""Snapshot: freeze the training data of each arm."""

from __future__ import annotations

from flywheel.data import Snapshot
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.stages.outcomes import ArmOutcome, Collected, Iteration


def snapshot(run: Run, iteration: Iteration, collected: list[Collected]) -> list[ArmOutcome]:
    """Seal each arm's earlier data together with its new episodes."""
    return [ArmOutcome(new, _sealed(run, iteration, new)) for new in collected]


def _sealed(run: Run, iteration: Iteration, new: Collected) -> Snapshot:
    name = name_of(iteration.number, new.arm)
    if (there := run.snapshot(name)) is not None:
        return there
    recorded = [*run.config.collect.recordings, *run.robot_episodes(iteration.number)]
    if iteration.number == 0:
        segments, parent = recorded, None
    else:
        before = iteration.number - 1
        parent = name_of(before, run.arm_of(before, new.arm))
        segments = [*run.store.snapshot(parent).segments, *recorded]
        if iteration.anew:  # the episodes of the plant before are wrong now
            segments = recorded
    segments = list(dict.fromkeys(segments))
    datasets = list(run.config.dataset_numbers())  # in the order of the network's one-hot
    return run.store.seal(name, [*segments, *new.segments], parent=parent, datasets=datasets)
