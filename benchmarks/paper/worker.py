"""The worker of a table: records trajectories, trains or fits a model, and measures it."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.paper.datasets import DataSets
from benchmarks.paper.definition import FLOORS, NETWORK, Cell, Method, TableConfig
from benchmarks.paper.rows import CellRow
from flywheel.data import Snapshot, SplitSource, WindowCache
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.baselines.weights import FITTED, BaselineWeights
from flywheel.dynamics.gnn import LearnedDynamics, load_weights
from flywheel.dynamics.plant import MeasurementModel, Plant, RestartedPlant
from flywheel.dynamics.protocol import Dynamics
from flywheel.errors import ModelError
from flywheel.evaluation import HISTORY_SECONDS, ErrorTable, score, score_full
from flywheel.records import Episode, Split
from flywheel.runtime.config.run_config import RunConfig, config_digest
from flywheel.runtime.pool.heartbeat import Worker
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.workers.episode_plan import EpisodePlan
from flywheel.training import Trainer
from flywheel.training.baselines import fit
from flywheel.training.progress import TrainingProgress

LEARNED: tuple[Split, ...] = ("train", "validation")


class TableWorker(Worker):
    """Makes trajectories and cells of a table.

    Args:
      table: the definition.
      folder: of the results.
    """

    def __init__(self, table: TableConfig, folder: Path) -> None:
        super().__init__()
        self._table, self._folder = table, folder
        self._sets = {robot: DataSets(table, robot, folder) for robot in table.robots}

    def record(self, robot: str, plan: EpisodePlan) -> None:
        """See `DataSets.record`."""
        self._heartbeat.start(plan.id)
        self._sets[robot].record(plan)

    def simulate(self, robot: str, plan: EpisodePlan, dataset: int) -> None:
        """See `DataSets.simulate`."""
        self._heartbeat.start(plan.id)
        self._sets[robot].simulate(plan, dataset)

    def measure(self, cell: Cell) -> CellRow:
        """Train or fit the model of a cell and measure it; a diverging model has no numbers."""
        self._heartbeat.start(cell.name)
        data, method = self._sets[cell.robot], self._table.methods[cell.method]
        config = self._table.config(cell.robot, method)
        train, test = data.snapshots(cell)
        row = CellRow(
            robot=cell.robot,
            dataset=cell.dataset,
            method=cell.method,
            seed=cell.seed,
            length=data.robot.length,
            learned=sum(each.seconds for each in train.episodes),
            tested=sum(each.seconds for each in test.episodes),
            train=train.digest,
            test=test.digest,
            settings=settings_digest(self._table, cell),
        )
        begun = time.process_time()
        try:
            model = self._model(cell, config, train)
        except ModelError as error:
            return replace(row, problem=str(error))
        row = replace(row, fit_cpu=time.process_time() - begun)
        tested = [data.store.read(each.id) for each in test.episodes]
        return _measured(row, model, data, config, tested, train.datasets)

    def _model(self, cell: Cell, config: RunConfig, train: Snapshot) -> Dynamics:
        method = self._table.methods[cell.method]
        if method.model == NETWORK:
            return self._trained(cell, config, train)
        if method.fit is not None:
            return self._fitted(cell, method, train)
        if method.model in FLOORS:
            return self._restarted(cell, method, config)
        return BASELINES[method.model](self._sets[cell.robot].robot, config.network.dt, 1)

    def _trained(self, cell: Cell, config: RunConfig, train: Snapshot) -> Dynamics:
        data = self._sets[cell.robot]
        parts = (
            SplitSource(data.store, train, split, data.robot, data.winches) for split in LEARNED
        )
        caches = [WindowCache.build(part, self._folder / cell.robot / "cache") for part in parts]
        training = config.training.model_copy(update={"seed": cell.seed})
        trainer = Trainer(
            training, config.network, data.robot, caches[0], caches[1], self._place(cell)
        )
        # A worker whose node was lost lives on for some seconds.
        with hold(self._place(cell) / "trainer.lock", f"The model {cell.name}", 60.0):
            weights = trainer.run(self._progress).weights
        return LearnedDynamics(data.robot, load_weights(weights, data.robot))

    def _fitted(self, cell: Cell, method: Method, train: Snapshot) -> Dynamics:
        data = self._sets[cell.robot]
        tracks = [
            data.store.read(each.id).trajectory
            for each in train.episodes
            if each.dataset == cell.dataset
        ]
        kind = FITTED[method.model]
        settings = self._table.fit.model_copy(update={"seed": cell.seed})
        say = self._heartbeat.progress
        dt = self._table.config(cell.robot, method).network.dt
        model = kind(data.robot, dt, kind.Config.model_validate(method.fit))
        found = fit(model, tracks, settings, say)
        self._place(cell).mkdir(parents=True, exist_ok=True)
        BaselineWeights.of(found.model).write(self._place(cell) / "fitted.npz")
        return found.model

    def _restarted(self, cell: Cell, method: Method, config: RunConfig) -> RestartedPlant:
        data = self._sets[cell.robot]
        names = [each.name for each in config.datasets]
        plant = (
            data.recorder.plant(names.index(cell.dataset))
            if method.exact
            else Plant(data.robot, config.network.dt)
        )
        roll = FLOORS[method.model]
        return RestartedPlant(plant, config.evaluate.floor_window, roll=roll)

    def _place(self, cell: Cell) -> Path:
        return self._folder / cell.robot / "models" / cell.name

    def _progress(self, now: TrainingProgress) -> None:
        words = f"step {now.point.step} of {now.steps}, loss {now.point.loss:.3g}"
        self._heartbeat.progress(now.point.step / now.steps, words)


def settings_digest(table: TableConfig, cell: Cell) -> str:
    """Digest of everything but the data that determines the numbers of a cell."""
    method = table.methods[cell.method]
    told = method.model_dump(mode="json", exclude={"published", "run"})
    told |= {"run": config_digest(table.config(cell.robot, method)), "seed": cell.seed}
    told |= {"fit_settings": table.fit.model_dump(mode="json") if method.fit is not None else {}}
    told |= table.trajectories(cell.robot)
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def _measured(
    row: CellRow,
    model: Dynamics,
    data: DataSets,
    config: RunConfig,
    tested: Sequence[Episode],
    datasets: Sequence[str],
) -> CellRow:
    """The row with the errors of a model."""
    evaluate, exact = config.evaluate, config.measurement == MeasurementModel()
    told: dict[str, Any] = {
        "truth": None if exact else data.truth,
        "datasets": {row.dataset: 0} | {name: index for index, name in enumerate(datasets)},
        "winches": data.winches,
    }
    short = partial(
        score,
        model,
        tested,
        horizon_seconds=evaluate.horizon_seconds,
        starts_per_episode=evaluate.starts,
        seed=0,
        **told,
    )
    row, _ = _with_errors(row, "short", short)
    row, seconds = _with_errors(row, "full", partial(score_full, model, tested, **told))
    predicted = row.tested - HISTORY_SECONDS * len(tested)
    return replace(row, rollout_cpu=seconds / predicted)


def _with_errors(
    row: CellRow, part: str, scored: Callable[[], ErrorTable]
) -> tuple[CellRow, float]:
    """The row with one kind of errors, and the processor's seconds."""
    begun = time.process_time()
    try:
        found = scored()
    except ModelError as error:
        return replace(row, problem=f"{part}: {error}"), math.nan
    errors = {"mse": found.e_pos_mse, "rmse": found.e_pos_rmse, "rot": found.e_rot}
    changes: dict[str, Any] = {f"{part}_{name}": value for name, value in errors.items()}
    return replace(row, **changes), time.process_time() - begun
