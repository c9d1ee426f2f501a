"""Training a network on windows: curriculum, checkpoints, selection by validation rollouts."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from flywheel.data import WindowCache
from flywheel.dynamics.gnn import (
    ChunkNetwork,
    NetworkConfig,
    Simulator,
    check_device,
    fit_normalisation,
    load_weights,
    save_weights,
    seeing,
    weights_digest,
    widen_winches,
)
from flywheel.dynamics.threads import one_thread_per_operation
from flywheel.errors import ConfigError, ModelError
from flywheel.robots import Robot
from flywheel.training.checkpoint import (
    CHECKPOINT,
    Checkpoint,
    damaged,
    read_checkpoint,
    write_checkpoint,
)
from flywheel.training.config import TrainingConfig
from flywheel.training.helper import Helper
from flywheel.training.loss import Losses
from flywheel.training.objective import Objective
from flywheel.training.optimiser import NetworkOptimiser
from flywheel.training.progress import CurvePoint, OnProgress, TrainingProgress, TrainingResult
from flywheel.training.schedules import learning_rate, spans, stage_at
from flywheel.training.validation import (
    Validation,
    ValidationErrors,
    clearly_worse,
    selection_error,
)

WEIGHTS = "weights.npz"


@dataclass
class _State:
    """State of a training in progress; see `Checkpoint` for the fields."""

    network: ChunkNetwork
    optimiser: NetworkOptimiser
    averaged: AveragedModel
    step: int = 0
    best: dict[str, Tensor] = field(default_factory=dict)
    best_error: float = math.inf
    best_step: int = 0
    stale: int = 0
    curve: list[CurvePoint] = field(default_factory=list)

    @property
    def served(self) -> ChunkNetwork:
        """The network whose weights are validated and kept: that of averaged weights."""
        network = self.averaged.module
        assert isinstance(network, ChunkNetwork)
        return network


class Trainer:
    """Trains one network on one data set, in one folder.

    `run` may be killed at any instant and called again: it continues from the folder's checkpoint
    and, on the CPU with the same number of processes, ends with the same weights bit by bit.

    Args:
      config: recipe and budget.
      network_config: of the network to be trained.
      robot: of the episodes.
      train, validation: windows of the two splits.
      folder: for the checkpoint and the weights; made if necessary.
      initial_weights: file of weights to start from, by the fine-tuning schedule; they are returned
        if the trained ones are significantly worse.

    Raises:
      DataError: a split has no window of the required length.
      ConfigError: `mix` names an unknown data set, the folder contains another training, or there is
        no such device.
    """

    @one_thread_per_operation()
    def __init__(
        self,
        config: TrainingConfig,
        network_config: NetworkConfig,
        robot: Robot,
        train: WindowCache,
        validation: WindowCache,
        folder: Path,
        initial_weights: Path | None = None,
    ) -> None:
        check_device(config.device, "training.device")
        self._config, self._robot, self._folder = config, robot, Path(folder)
        self._network_config = network_config
        self._initial_weights = initial_weights
        self._schedule = config.fine_tuning if initial_weights else config.initial
        self._train = train
        self._simulator = Simulator(robot, network_config, precision=config.precision)
        self._objective = Objective(config, self._schedule, self._simulator, train)
        self._validation = Validation(
            robot,
            validation,
            history=network_config.history,
            chunk=network_config.chunk,
            dt=network_config.dt,
            seconds=config.validation_seconds,
            windows=config.validation_windows,
            seed=config.seed,
        )
        self._key = self._fingerprint(validation)

    @one_thread_per_operation()
    def run(self, on_progress: OnProgress | None = None) -> TrainingResult:
        """Train, or continue training, to the end of the budget.

        Args:
          on_progress: called with every new point of the curve.

        Raises:
          ModelError: the loss, its gradient or a weight is not finite; the message names the step,
            and the last checkpoint is kept.
          ConfigError, DataError: the folder's checkpoint cannot be continued.
          RunError: a process for a part of the batches cannot start.
        """
        with ExitStack() as stack:
            state = self._start()
            helpers = [stack.enter_context(each) for each in self._objective.helpers(state.network)]
            return self._run(state, helpers, on_progress or (lambda progress: None))

    def _run(
        self, state: _State, helpers: Sequence[Helper], on_progress: OnProgress
    ) -> TrainingResult:
        config, steps = self._config, self._schedule.steps
        kept_at = {span.stop for span in spans(self._schedule)}
        began, first = time.perf_counter(), state.step
        while state.step < steps and not self._stale(state):
            losses = self._train_step(state, helpers)
            last = state.step == steps
            if last or state.step % config.validate_every == 0:
                self._validate(state, self._point(state, losses))
            elif state.step % config.report_every == 0:
                state.curve.append(self._point(state, losses))
            if state.curve and state.curve[-1].step == state.step:
                rate = (state.step - first) / (time.perf_counter() - began)
                on_progress(TrainingProgress(state.curve[-1], steps, rate, state.best_error))
            if state.step in kept_at or state.step % config.checkpoint_every == 0:
                self._keep(state)
        self._keep(state)
        return self._result(state)

    def _start(self) -> _State:
        """Initial state: the folder's checkpoint, else the initial weights, else random ones."""
        config = self._config
        network = self._first_network().to(config.device)
        optimiser = NetworkOptimiser(network, config)
        average = get_ema_multi_avg_fn(config.averaging)
        state = _State(network, optimiser, AveragedModel(network, multi_avg_fn=average))
        kept = read_checkpoint(self._folder, self._key, config.device)
        if kept is not None:
            try:
                _restore(state, kept)
            except (RuntimeError, ValueError, TypeError, LookupError, AttributeError) as error:
                raise damaged(self._folder / CHECKPOINT, error) from None
        return state

    def _first_network(self) -> ChunkNetwork:
        if self._initial_weights is not None:
            given = load_weights(self._initial_weights, self._robot)
            network = seeing(given, self._robot, self._network_config.surfaces)
            if network.config != self._network_config:
                raise ConfigError(
                    f"The weights in {self._initial_weights} are of another network: "
                    f"{network.config}, wanted {self._network_config}."
                )
            widen_winches(self._simulator, network, [self._objective.measured()])
            return network
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._config.seed)
            network = ChunkNetwork(self._robot, self._network_config)
        fit_normalisation(self._simulator, network, [self._objective.measured()])
        return network

    def _train_step(self, state: _State, helpers: Sequence[Helper]) -> Losses:
        rate = learning_rate(self._schedule, state.step)
        state.network.train()
        losses = self._objective.backward(state.network, state.step, helpers)
        norm = torch.nn.utils.clip_grad_norm_(state.network.parameters(), self._config.clip)
        state.step += 1
        if not (math.isfinite(losses.total.item()) and math.isfinite(norm.item())):
            raise ModelError(
                f"Training step {state.step}: the loss is {losses.total.item()} and its gradient's "
                f"norm {norm.item()}. {self._kept()}"
            )
        state.optimiser.step(rate)
        state.averaged.update_parameters(state.network)
        return losses

    def _point(self, state: _State, losses: Losses) -> CurvePoint:
        return CurvePoint(
            step=state.step,
            chunks=stage_at(self._schedule, state.step - 1).chunks,
            learning_rate=learning_rate(self._schedule, state.step - 1),
            loss=losses.total.item(),
            velocity=losses.velocity.item(),
            position=losses.position.item(),
            rest=losses.rest.item(),
        )

    def _validate(self, state: _State, point: CurvePoint) -> None:
        """Add the validation errors to `point`, and keep the weights if they are the best."""
        errors = self._measured(state.served)
        table, error = errors.table, selection_error(errors)
        state.curve.append(
            dataclasses.replace(
                point,
                e_pos_mse=table.e_pos_mse,
                e_pos_rmse=table.e_pos_rmse,
                e_rot=table.e_rot,
                error=error,
            )
        )
        self._consider(state, error)

    def _measured(self, network: ChunkNetwork) -> ValidationErrors:
        return self._validation(self._simulator, network.eval(), self._config.device)

    def _consider(self, state: _State, error: float) -> None:
        if error < state.best_error or not state.best:
            weights = state.served.state_dict()
            state.best = {name: value.detach().clone() for name, value in weights.items()}
            state.best_error, state.best_step, state.stale = error, state.step, 0
        elif state.step > spans(self._schedule)[-1].start:
            state.stale += 1

    def _stale(self, state: _State) -> bool:
        return 0 < self._config.patience <= state.stale

    def _keep(self, state: _State) -> None:
        for name, value in state.network.state_dict().items():
            if not torch.isfinite(value).all():
                raise ModelError(
                    f"Training step {state.step}: weight {name} is not finite. {self._kept()}"
                )
        kept = Checkpoint(
            key=self._key,
            step=state.step,
            weights=state.network.state_dict(),
            optimiser=state.optimiser.state_dict(),
            averaged=state.averaged.state_dict(),
            best=state.best,
            best_error=state.best_error,
            best_step=state.best_step,
            stale=state.stale,
            curve=[dataclasses.asdict(point) for point in state.curve],
        )
        write_checkpoint(kept, self._folder)

    def _kept(self) -> str:
        return (
            f"The last checkpoint in {self._folder} is kept; a lower learning rate or other data "
            "may help."
        )

    def _result(self, state: _State) -> TrainingResult:
        network = state.network
        network.load_state_dict(state.best)
        if self._initial_weights is not None:
            first = self._first_network().to(self._config.device)
            before, after = self._measured(first), self._measured(network)
            if clearly_worse(after, before):
                network, state.best_error, state.best_step = first, selection_error(before), 0
        path = self._folder / WEIGHTS
        digest = save_weights(network.to("cpu"), path, self._train.digest)
        return TrainingResult(
            path, digest, state.best_error, state.best_step, state.step, tuple(state.curve)
        )

    def _fingerprint(self, validation: WindowCache) -> str:
        """Digest of everything that determines the final weights."""
        first = self._initial_weights
        parts = {
            "training": self._config.model_dump(mode="json"),
            "network": self._network_config.model_dump(mode="json"),
            "robot": self._robot.digest,
            "data": [self._train.digest, validation.digest],
            "first": weights_digest(load_weights(first, self._robot)) if first else "",
        }
        if self._train.belief:
            parts["belief"] = self._train.belief
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _restore(state: _State, kept: Checkpoint) -> None:
    state.network.load_state_dict(kept.weights)
    state.optimiser.load_state_dict(kept.optimiser)
    state.averaged.load_state_dict(kept.averaged)
    state.step, state.stale = kept.step, kept.stale
    state.best, state.best_error, state.best_step = kept.best, kept.best_error, kept.best_step
    state.curve = [CurvePoint(**point) for point in kept.curve]
