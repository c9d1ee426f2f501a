"""Training of the network that corrects a plant, from recordings of the robot alone.

The plant predicts windows of the recordings once, from the measured past. The network learns the
residual, measured minus predicted points, over the whole horizon at once. A part of the recordings
is held out: it determines the end of the training, and the applied fraction of the correction. If
no fraction clearly helps there, it is 0 and the model is the plant.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
import torch
from torch import Tensor, nn

from flywheel.dynamics.plant import Reckoning, RestartedPlant
from flywheel.dynamics.residual import (
    Knots,
    Lookout,
    ResidualConfig,
    ResidualDynamics,
    ResidualNetwork,
    Sight,
    displaced,
    mean_offsets,
)
from flywheel.dynamics.threads import one_thread_per_operation
from flywheel.errors import DataError, ModelError
from flywheel.quantities import (
    Bounds,
    Factor,
    HorizonSeconds,
    OptimiserSteps,
    PartialShare,
    Samples,
    Seed,
)
from flywheel.records import Floats, Trajectory
from flywheel.training.batches import generator
from flywheel.training.spans import Present, Span, check_recordings, presents, questions, split
from flywheel.validation import Frozen

SHARES = np.linspace(0.0, 1.0, 21)  # of the correction, that are tried
_SIMULATED = 64  # windows that the plant predicts at a time
_JUDGED = 256  # windows that are judged at a time
_SCALED = 512  # windows that the features' scales are taken from
_ORDER = 7  # what is drawn from a seed: in which order windows come
_LEAST_RATE = 0.02  # where the cosine of the learning rate ends, as a share of the highest

Say = Callable[[float, str], None]
"""Receives the completed fraction, from 0 to 1, and a note."""


class ResidualTraining(Frozen):
    """Settings of the training of a plant's correction.

    Attributes:
      horizon: predicted from each present; less if no recording is as long.
      spacing: between two presents of a recording.
      windows: largest number, of all recordings together.
      held_out: fraction of the recordings used for decisions instead of training.
      steps: of the optimiser, at most.
      batch: windows per step.
      learning_rate: highest one; it rises over the first `warmup_steps` and falls like a cosine.
      warmup_steps: of the optimiser.
      weight_decay: of AdamW.
      clip: largest norm of the gradient.
      averaging: decay per step of the running mean of the weights, which is validated and kept.
      huber: residuals larger than this many times their usual size at their lead time count
        linearly.
      validate_every: steps between two validations.
      patience: validations without a better one before it stops early.
      sure: standard errors by which the correction must help on held-out windows.
      seed: of the weights and of the order of the windows.
    """

    horizon: HorizonSeconds = 2.0
    spacing: HorizonSeconds = 0.2
    windows: Annotated[int, Bounds(1, 100_000)] = 4000
    held_out: Annotated[float, Bounds(0.02, 0.9)] = 0.2
    steps: OptimiserSteps = 400
    batch: Samples = 64
    learning_rate: Factor = 3e-3
    warmup_steps: Annotated[int, Bounds(0, 1_000_000)] = 30
    weight_decay: Annotated[float, Bounds(0, 10)] = 0.02
    clip: Factor = 1.0
    averaging: PartialShare = 0.98
    huber: Factor = 1.5
    validate_every: Annotated[int, Bounds(1, 1_000_000)] = 20
    patience: Annotated[int, Bounds(1, 1_000_000)] = 6
    sure: Annotated[float, Bounds(0, 100)] = 1.0
    seed: Seed = 0


@dataclass(frozen=True)
class ResidualResult:
    """A finished training.

    Attributes:
      model: the plant and its correction.
      plant_error, error: on held-out windows, of the plant and of the model: mean distances, each
        relative to the plant's usual one at its lead time [-].
      steps: optimiser steps done.
      best_step: steps done at the best weights.
      windows, held_out: their numbers.
      horizon: of them [s].
      seconds: of the training, simulations included.
      curve: (step, loss, error on held-out windows with the whole correction).
    """

    model: ResidualDynamics
    plant_error: float
    error: float
    steps: int
    best_step: int
    windows: int
    held_out: int
    horizon: float
    seconds: float
    curve: tuple[tuple[int, float, float], ...]

    def notes(self) -> dict[str, object]:
        """Notes for the side file of the weights; without timings, so that equal trainings give
        equal files.
        """
        return {
            "plant_error": self.plant_error,
            "error": self.error,
            "best_step": self.best_step,
            "windows": self.windows,
            "held_out": self.held_out,
        }


@dataclass(frozen=True)
class PlantWindows:
    """Windows of recordings with the plant's predictions; lengths in L.

    Attributes:
      sight: inputs of the network.
      left: (N, K, P, 3) residual of the plant at each knot, averaged over the steps around it.
      weight: (N, K, P) fraction of those steps with a measurement of the point.
    """

    sight: Sight
    left: Tensor
    weight: Tensor

    def __len__(self) -> int:
        return len(self.left)

    def __getitem__(self, rows: Tensor | slice) -> PlantWindows:
        """Some of the windows."""
        return PlantWindows(self.sight[rows], self.left[rows], self.weight[rows])


def train_residual(
    plant: RestartedPlant,
    recordings: Sequence[Trajectory],
    config: ResidualConfig = ResidualConfig(),
    training: ResidualTraining = ResidualTraining(),
    say: Say = lambda done, note: None,
    stop: Callable[[], bool] = lambda: False,
) -> ResidualResult:
    """Train the correction of a plant. Equal arguments give equal weights, bit by bit, on one machine.

    Args:
      plant: with the known effects beyond its MJCF.
      recordings: unbatched, of the plant's control step; measurements are enough.
      config: of the network.
      training: its settings.
      say: receives the progress.
      stop: asked after each step; True ends the training with the best weights so far.

    Raises:
      DataError: recordings do not fit the plant, or are too short to train and to hold out.
      ModelError: the plant cannot predict them.
    """
    begun = time.monotonic()
    lookout = Lookout(plant, config)
    check_recordings(plant.robot, plant.dt, recordings)
    learned, judged = split(recordings, training.held_out)
    steps = min(horizon_of(lookout, parts, training) for parts in (learned, judged))
    train = windows_of(lookout, learned, steps, training, _part(say, 0.0, 0.2))
    held_out = windows_of(lookout, judged, steps, training, _part(say, 0.2, 0.25))
    with one_thread_per_operation(), torch.random.fork_rng(devices=[]):
        torch.manual_seed(training.seed)
        network = ResidualNetwork(plant.robot, config)
        fitting = _Fitting(network, train, held_out, training)
        fitting.run(_part(say, 0.25, 1.0), stop)
    errors = fitting.errors(fitting.best, held_out)
    share = chosen_share(errors, training)
    return ResidualResult(
        model=ResidualDynamics(plant, fitting.best, float(SHARES[share]), plant.plant.threads),
        plant_error=float(errors[:, 0].mean()),
        error=float(errors[:, share].mean()),
        steps=fitting.step,
        best_step=fitting.best_step,
        windows=len(train),
        held_out=len(held_out),
        horizon=steps * plant.dt,
        seconds=time.monotonic() - begun,
        curve=tuple(fitting.curve),
    )


def horizon_of(lookout: Lookout, parts: Sequence[Span], training: ResidualTraining) -> int:
    """Control steps of the longest windows that fit into the parts, up to the horizon."""
    plant, every = lookout.plant, lookout.every
    longest = max(p.end - max(p.begin, plant.history) for p in parts)
    return max(0, min(round(training.horizon / plant.dt), longest)) // every * every


def windows_of(
    lookout: Lookout,
    parts: Sequence[Span],
    steps: int,
    training: ResidualTraining,
    say: Say = lambda done, note: None,
) -> PlantWindows:
    """Predict windows of parts of recordings with the plant.

    Args:
      lookout: of the plant.
      parts: of recordings.
      steps: control steps of a window.
      training: spacing, and largest number of windows.
      say: receives the progress.

    Raises:
      DataError: no recording is long enough.
    """
    plant = lookout.plant
    found = _presents(plant, parts, steps, training) if steps else []
    if not found:
        least = (plant.history + lookout.every) * plant.dt
        raise DataError(
            "The recordings are too short, or points are missing too often: training needs "
            f"{least:g} s with all points in sight, and validation as much."
        )
    windows: list[PlantWindows] = []
    for first in range(0, len(found), _SIMULATED):
        some = found[first : first + _SIMULATED]
        windows += _predictable(lookout, some, steps)
        done = first + len(some)
        say(done / len(found), f"the plant predicts window {done} of {len(found)}")
    if not windows:
        raise DataError(
            "The plant cannot predict any window of the recordings: all of them diverge."
        )
    return _joined(windows)


def _presents(
    plant: RestartedPlant, parts: Sequence[Span], steps: int, training: ResidualTraining
) -> list[Present]:
    """Starts of windows of so many steps."""
    reckoning = Reckoning(plant.robot, plant.dt, plant.plant.terms)
    stride = max(1, round(training.spacing / plant.dt))
    return presents(
        plant.robot, parts, reckoning.known, plant.history, steps, stride, training.windows
    )


def _predictable(lookout: Lookout, starts: Sequence[Present], steps: int) -> list[PlantWindows]:
    """Windows with the plant's predictions, without those in which it diverges or a point is out of
    sight.
    """
    try:
        return [_predicted(lookout, starts, steps)]
    except ModelError:
        half = len(starts) // 2
        if not half:
            return []
        parts = (starts[:half], starts[half:])
        return [found for part in parts for found in _predictable(lookout, part, steps)]


def _predicted(lookout: Lookout, starts: Sequence[Present], steps: int) -> PlantWindows:
    plant = lookout.plant
    past, controls, measured = questions(plant.robot, starts, lookout.history, steps)
    sight, motion = lookout.look(past, controls)
    left, weight = mean_offsets(motion.observations.points, measured, lookout.every)
    return PlantWindows(
        sight, torch.as_tensor(left / plant.robot.length).float(), torch.as_tensor(weight).float()
    )


def _joined(parts: Sequence[PlantWindows]) -> PlantWindows:
    def knots(each: Sequence[Knots]) -> Knots:
        return Knots(*(torch.cat([getattr(k, f.name) for k in each]) for f in fields(Knots)))

    pasts = [p.sight.past for p in parts if p.sight.past is not None]
    sight = Sight(knots(pasts) if pasts else None, knots([p.sight.ahead for p in parts]))
    return PlantWindows(
        sight, torch.cat([p.left for p in parts]), torch.cat([p.weight for p in parts])
    )


class _Fitting:
    """The loop: its weights, the running mean of them, and the best so far."""

    def __init__(
        self,
        network: ResidualNetwork,
        train: PlantWindows,
        held_out: PlantWindows,
        training: ResidualTraining,
    ) -> None:
        self._network, self._train = network, train
        self._held_out, self._training = held_out, training
        self._scale = usual(train)
        some = train[:: max(1, len(train) // _SCALED)].sight
        network.fit_scales(some.past, some.ahead)
        self._mean = copy.deepcopy(network)
        self.best, self.best_step, self.step = copy.deepcopy(network), 0, 0
        self.curve: list[tuple[int, float, float]] = []
        self._order: list[int] = []
        self._rng = generator(training.seed, 0, _ORDER)

    def run(self, say: Say, stop: Callable[[], bool]) -> None:
        """Train until the budget is spent, nothing improves, or it is stopped."""
        training, network = self._training, self._network
        optimiser = torch.optim.AdamW(network.parameters(), weight_decay=training.weight_decay)
        best, since = math.inf, 0
        for self.step in range(1, training.steps + 1):
            for group in optimiser.param_groups:
                group["lr"] = training.learning_rate * self._rate()
            loss = self._loss(self._next_batch())
            if not math.isfinite(value := float(loss.detach())):
                raise ModelError(f"The training diverged at step {self.step}: lower learning_rate.")
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), training.clip)
            optimiser.step()
            self._average()
            last = self.step == training.steps or stop()
            if self.step % training.validate_every and not last:
                continue
            errors = self.errors(self._mean, self._held_out).mean(axis=0)
            self.curve.append((self.step, value, float(errors[-1])))
            better = float(errors.min()) < best
            since = 0 if better else since + 1
            if better:
                best, self.best_step = float(errors.min()), self.step
                self.best = copy.deepcopy(self._mean)
            gain = 1.0 - best / float(errors[0])
            say(self.step / training.steps, f"step {self.step}, {gain:.0%} of the error removed")
            if last or since >= training.patience:
                return

    def _rate(self) -> float:
        """Present learning rate relative to the highest."""
        training = self._training
        rise = min(1.0, self.step / max(1, training.warmup_steps))
        fall = 0.5 * (1.0 + math.cos(math.pi * self.step / training.steps))
        return rise * (_LEAST_RATE + (1.0 - _LEAST_RATE) * fall)

    def _next_batch(self) -> PlantWindows:
        size = min(self._training.batch, len(self._train))
        if len(self._order) < size:
            self._order = self._rng.permutation(len(self._train)).tolist()
        rows, self._order = self._order[:size], self._order[size:]
        return self._train[torch.tensor(rows)]

    def _loss(self, batch: PlantWindows) -> Tensor:
        off = (correction(self._network, batch) - batch.left) / self._scale
        each = nn.functional.huber_loss(
            off, torch.zeros_like(off), reduction="none", delta=self._training.huber
        )
        return (each.mean(-1) * batch.weight).sum() / batch.weight.sum().clamp(min=1.0)

    @torch.no_grad()
    def _average(self) -> None:
        decay = min(self._training.averaging, self.step / (self.step + 10))
        pairs = zip(self._mean.parameters(), self._network.parameters(), strict=True)
        for mean, now in pairs:
            mean.lerp_(now, 1.0 - decay)

    @torch.no_grad()
    def errors(self, network: ResidualNetwork, windows: PlantWindows) -> Floats:
        """(N, shares) relative mean distance, for each of `SHARES` of the correction."""
        found = []
        for first in range(0, len(windows), _JUDGED):
            some = windows[first : first + _JUDGED]
            moved, count = correction(network, some), some.weight.sum((1, 2)).clamp(min=1e-6)
            rows = []
            for share in SHARES.tolist():
                off = ((share * moved - some.left) / self._scale).norm(dim=-1)
                rows.append((off * some.weight).sum((1, 2)) / count)
            found.append(torch.stack(rows, dim=1))
        return np.asarray(torch.cat(found).double().numpy())


def correction(network: ResidualNetwork, windows: PlantWindows) -> Tensor:
    """(N, K, P, 3) displacement of the points by a network at each knot [L]."""
    layout, ahead = network.layout, windows.sight.ahead
    shift, turn = network(windows.sight.past, ahead)
    body = layout.point_body
    arms = torch.einsum("bknij,nj->bkni", ahead.turn[:, :, body], layout.point_arm)
    return displaced(arms, shift[:, :, body], turn[:, :, body])


def usual(windows: PlantWindows) -> Tensor:
    """(K, 1, 1) root mean square of a coordinate of the plant's residual, by lead time; never
    decreases [L].
    """
    squares = ((windows.left**2).sum(-1) * windows.weight).sum((0, 2))
    by_lead = squares / windows.weight.sum((0, 2)).clamp(min=1e-6) / 3
    return torch.cummax(by_lead, dim=0).values.clamp(min=1e-12).sqrt()[:, None, None]


def chosen_share(errors: Floats, training: ResidualTraining) -> int:
    """Index in `SHARES` with the least error; the first, no correction, unless the gain is significant.

    Overlapping windows count less than their number; one alone shows no chance, and so no gain.
    """
    best = int(errors.mean(axis=0).argmin())
    gain = errors[:, 0] - errors[:, best]
    alone = max(1.0, len(gain) * min(1.0, training.spacing / training.horizon))
    doubt = float(gain.std()) / math.sqrt(alone) if len(gain) > 1 else math.inf
    return best if gain.mean() > training.sure * doubt else 0


def _part(say: Say, begin: float, end: float) -> Say:
    """Progress of a part of the work, as progress of the whole."""
    return lambda done, note: say(begin + done * (end - begin), note)
