"""Fits of the baselines to recordings alone: a ridge regression, and contact numbers by gradients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from torch import Tensor

from flywheel.dynamics.baselines import LinearDynamics
from flywheel.dynamics.baselines.engine import CONTACT, LARGEST, LEAST, USUAL, RigidBodyEngine
from flywheel.dynamics.baselines.weights import FitModel
from flywheel.dynamics.plant import Reckoning
from flywheel.dynamics.protocol import Dynamics
from flywheel.dynamics.threads import one_thread_per_operation
from flywheel.errors import DataError, ModelError
from flywheel.quantities import Bounds, Factor, HorizonSeconds, OptimiserSteps, Samples, Seed
from flywheel.records import Floats, Past, Trajectory
from flywheel.training.batches import generator
from flywheel.training.spans import Span, check_recordings, presents, questions, split
from flywheel.validation import Frozen

RIDGES = np.logspace(-8, 0, 9)  # that are tried, beside mean squares of 1
_ROWS = 4096  # of the regression at a time, so that they stay in the memory
_ORDER = 8  # what is drawn from a seed: in which order windows come

Say = Callable[[float, str], None]
"""Receives the completed fraction, from 0 to 1, and a note."""


class FitSettings(Frozen):
    """Settings of the fit of a baseline.

    Attributes:
      horizon: predicted from each present, in decisions and, by the engine, in its loss.
      spacing: between two presents of a recording.
      windows: largest number of windows to fit, and to decide on.
      held_out: fraction of the recordings for decisions: the ridge, the best step.
      steps: of the engine's optimiser.
      batch: windows per step.
      learning_rate: of Adam, on logits of the numbers between their bounds.
      validate_every: steps between two decisions.
      seed: of the order of the windows.
    """

    horizon: HorizonSeconds = 0.5
    spacing: HorizonSeconds = 0.1
    windows: Annotated[int, Bounds(1, 100_000)] = 500
    held_out: Annotated[float, Bounds(0.02, 0.9)] = 0.2
    steps: OptimiserSteps = 120
    batch: Samples = 64
    learning_rate: Factor = 0.1
    validate_every: OptimiserSteps = 10
    seed: Seed = 0


@dataclass(frozen=True)
class Fitted:
    """A fitted baseline.

    Attributes:
      model: the baseline.
      before, error: RMSE / L of the points on held-out windows, before and after [%].
      windows: held-out ones.
      about: further numbers, for people.
    """

    model: FitModel
    before: float
    error: float
    windows: int
    about: dict[str, float]


@dataclass(frozen=True)
class _Windows:
    """Pasts, controls (N, H, W) and measured points (N, H + 1, P, 3) [m]."""

    past: Past
    controls: Floats
    measured: Floats

    @classmethod
    def of(cls, model: Dynamics, parts: Sequence[Span], settings: FitSettings) -> _Windows:
        robot, dt = model.robot, model.dt
        longest = max(part.end - max(part.begin, model.history) for part in parts)
        steps = min(round(settings.horizon / dt), longest)
        stride = max(1, round(settings.spacing / dt))
        known, windows = Reckoning(robot, dt).known, settings.windows
        found = (
            presents(robot, parts, known, model.history, steps, stride, windows)
            if steps > 0
            else []
        )
        if not found:
            raise DataError(
                "The recordings are too short, or points are missing too often: a fit needs more than "
                f"{model.history * dt:g} s with all points in sight, and a decision as much."
            )
        return cls(*questions(robot, found, model.history, steps))

    def error(self, model: Dynamics) -> float:
        """RMSE / L of a model's points [%]; infinite where it diverges."""
        try:
            points = model.rollout(self.past, self.controls).points
        except ModelError:
            return np.inf
        squares = ((points - self.measured)[:, 1:] ** 2).sum(axis=-1)
        return float(100.0 * np.sqrt(np.nanmean(squares)) / model.robot.length)


def fit(
    model: FitModel,
    recordings: Sequence[Trajectory],
    settings: FitSettings = FitSettings(),
    say: Say = lambda done, note: None,
    stop: Callable[[], bool] = lambda: False,
) -> Fitted:
    """Fit a baseline; what is best on held-out windows is kept.

    The linear model by a ridge regression of single steps, with several ridges; the contact numbers of
    the rigid-body engine by gradients through whole windows.

    Args:
      model: its robot, control step and configuration are kept.
      recordings: unbatched.
      settings: of the fit.
      say: receives the progress.
      stop: asked after each ridge or step; True ends the search with the best numbers so far.

    Raises:
      DataError: recordings do not fit the robot, or are too short.
    """
    check_recordings(model.robot, model.dt, recordings)
    learned, judged = split(recordings, settings.held_out)
    held_out = _Windows.of(model, judged, settings)
    if isinstance(model, LinearDynamics):
        return _fit_linear(model, learned, held_out, say, stop)
    return _fit_engine(model, _Windows.of(model, learned, settings), held_out, settings, say, stop)


def _fit_linear(
    model: LinearDynamics,
    learned: Sequence[Span],
    held_out: _Windows,
    say: Say,
    stop: Callable[[], bool],
) -> Fitted:
    squares, products, count = _sums(model, learned)
    size = np.sqrt(np.diag(squares) / count)
    size = np.where(size > 0, size, 1.0)
    gram, target = squares / count / np.outer(size, size), products / count / size[:, None]
    best, least, chosen = model, (before := held_out.error(model)), np.inf
    for number, ridge in enumerate(RIDGES):
        solved = np.linalg.solve(gram + ridge * np.eye(len(gram)), target) / size[:, None]
        tried = LinearDynamics(model.robot, model.dt, model.config, solved)
        if (error := held_out.error(tried)) < least:
            best, least, chosen = tried, error, float(ridge)
        say((number + 1) / len(RIDGES), f"ridge {ridge:g}: {error:.3g} %")
        if stop():
            break
    numbers = {"ridge": chosen, "samples": float(count)}
    return Fitted(best, before, least, len(held_out.controls), numbers)


def _sums(model: LinearDynamics, parts: Sequence[Span]) -> tuple[Floats, Floats, int]:
    """Sums of products of a step's inputs with themselves and with its outputs, and their number."""
    robot, history = model.robot, model.history
    inputs, outputs = model.coefficients.shape
    squares, products, count = np.zeros((inputs, inputs)), np.zeros((inputs, outputs)), 0
    for part in parts:
        track = part.track
        points = track.observations.points
        winch = Reckoning(robot, track.dt).known(track)
        recent = _runs(points, model.config.pose_lags + 2)  # the step's result, too
        told = _runs(track.controls, model.config.input_lags)
        at = np.arange(max(part.begin, history), part.end)
        at = at[np.isfinite(recent[at - model.config.pose_lags]).all(axis=(1, 2, 3))]
        for rows in np.split(at, range(_ROWS, len(at), _ROWS)):
            seen = recent[rows - model.config.pose_lags]
            commands = told[rows - model.config.input_lags + 1]
            x, turn = model.inputs(seen[:, :-1], winch[rows], commands)
            step = (seen[:, -1] - seen[:, -2]) @ turn.swapaxes(-1, -2)
            y = step.reshape(len(rows), -1) / robot.length
            squares += x.T @ x
            products += x.T @ y
            count += len(rows)
    if not count:
        raise DataError(
            f"No recording has {history + 2} successive observations of all points to learn from."
        )
    return squares, products, count


def _runs(array: Floats, length: int) -> Floats:
    """(N - length + 1, length, ...) runs of successive rows of (N, ...)."""
    return np.moveaxis(sliding_window_view(array, length, axis=0), -1, 1)


def _fit_engine(
    model: RigidBodyEngine,
    train: _Windows,
    held_out: _Windows,
    settings: FitSettings,
    say: Say,
    stop: Callable[[], bool],
) -> Fitted:
    robot, best, least = model.robot, model, (before := held_out.error(model))
    begun, winch = model.started(train.past, train.controls)
    rest, ground = model.rest(winch), model.ground(train.past)
    measured = torch.as_tensor(train.measured / robot.length)
    raw = torch.tensor(np.log((USUAL - LEAST) / (LARGEST - USUAL)), requires_grad=True)
    optimiser = torch.optim.Adam([raw], settings.learning_rate)
    rng = generator(settings.seed, 0, _ORDER)
    size = min(settings.batch, len(measured))
    for step in range(1, settings.steps + 1):
        rows = rng.choice(len(measured), size, replace=False)
        optimiser.zero_grad()
        with one_thread_per_operation():
            points = model.simulate(begun[rows], rest[..., rows], _between(raw), ground)
            loss = _distance(points.permute(3, 0, 2, 1) / robot.length, measured[rows])
            loss.backward()
        if raw.grad is not None and torch.isfinite(raw.grad).all():
            torch.nn.utils.clip_grad_norm_([raw], 1.0)
            optimiser.step()
        last = step == settings.steps or stop()
        if last or step % settings.validate_every == 0:
            contact = _between(raw).detach().numpy()
            tried = RigidBodyEngine(robot, model.dt, model.config, contact)
            if (error := held_out.error(tried)) < least:
                best, least = tried, error
        say(step / settings.steps, f"loss {loss.item():.3g}")
        if last:
            break
    numbers = dict(zip(CONTACT, best.contact.tolist(), strict=True))
    return Fitted(best, before, least, len(held_out.controls), numbers)


def _between(raw: Tensor) -> Tensor:
    """Contact numbers within their bounds."""
    least, largest = torch.tensor(LEAST), torch.tensor(LARGEST)
    return least + (largest - least) * torch.sigmoid(raw)


def _distance(predicted: Tensor, measured: Tensor) -> Tensor:
    """Mean distance of points (N, H + 1, P, 3), without those that were not measured."""
    seen = torch.isfinite(measured).all(-1)
    off = torch.where(seen[..., None], predicted - measured, 0.0)[:, 1:]
    return (off * off).sum(-1).clamp(min=1e-18).sqrt().sum() / seen[:, 1:].sum().clamp(min=1)
