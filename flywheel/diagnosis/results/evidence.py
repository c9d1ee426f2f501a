"""Evidence for people: predictions against measurements, and similar candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.statistics import INTERVAL
from flywheel.effects import Term
from flywheel.records import Floats

RIVALS = 8  # candidates in the table of who is like whom
LAGS = 20  # of the autocorrelation


@dataclass(frozen=True)
class Rung:
    """A model of the ladder from the initial plant to the last one.

    Attributes:
      label: addition to the previous one.
      error: root mean square on the recordings [m].
    """

    label: str
    error: float


@dataclass(frozen=True)
class Evidence:
    """Predictions against measurements; K windows, T steps, P points.

    Attributes:
      points, cables: names of the tracked points and channels, and of the cables.
      recording, first: (K,) recording and first step of each window.
      dt: [s].
      sigma: noise [m].
      measured, before, after: (K, T + 1, P, 3) [m].
      noisy: (K, T + 1, P, 3) bool: measured, and not filled in.
      ladder: of models.
      rivals: the best candidates.
      likeness: (n, n) |cosine| between their changes, beyond other influences.
      lags_before, lags_after: autocorrelation of the residuals at lags 1 to LAGS.
      band: 95 % band of white noise.
    """

    points: tuple[str, ...]
    cables: tuple[str, ...]
    recording: np.ndarray
    first: np.ndarray
    dt: float
    sigma: float
    measured: Floats
    noisy: np.ndarray
    before: Floats
    after: Floats
    ladder: tuple[Rung, ...]
    rivals: tuple[Candidate, ...]
    likeness: Floats
    lags_before: Floats
    lags_after: Floats
    band: float

    @classmethod
    def of(
        cls, fitter: Fitter, models: Sequence[ScoredModel], others: Sequence[Fit] = ()
    ) -> Evidence:
        """Collect it from the models of a search, and equally good alternatives."""
        windows = fitter.windows
        first, last = models[0].fit, models[-1].fit
        named = [term for fit in (last, *others) for term in fit.terms if term.asked]
        rivals, likeness = _likeness(models[0], named)
        return cls(
            points=windows.names,
            cables=tuple(cable.name for cable in windows.robot.cables),
            recording=windows.recording,
            first=windows.first,
            dt=windows.dt,
            sigma=windows.noise,
            measured=windows.measured,
            noisy=windows.noisy,
            before=first.points,
            after=last.points,
            ladder=tuple(
                Rung(_label(windows, models, i), fitter.rms(model.fit))
                for i, model in enumerate(models)
            ),
            rivals=rivals,
            likeness=likeness,
            lags_before=_autocorrelation(windows, first),
            lags_after=_autocorrelation(windows, last),
            band=float(INTERVAL / np.sqrt(windows.noisy.sum())),
        )

    @property
    def places(self) -> np.ndarray:
        """(P,) bool: True for points, False for channels, which have one coordinate."""
        return np.asarray(np.isfinite(self.measured).any(axis=(0, 1)).all(axis=-1))

    def squares(self, points: Floats) -> Floats:
        """(K, P) mean square of measured minus these points, in noise variances; NaN of nothing."""
        off = (self.measured - points) / self.sigma
        known = self.noisy & np.isfinite(off)
        count = known.sum(axis=(1, 3))
        whole = np.where(known, off**2, 0.0).sum(axis=(1, 3))
        return np.where(count, whole / np.maximum(count, 1), np.nan)


def _label(windows: Windows, models: Sequence[ScoredModel], index: int) -> str:
    if index == 0:
        return "initial model"
    before, fit = models[index - 1].fit, models[index].fit
    known = {(t.effect.name, t.place) for t in before.terms}
    added = [t for t in fit.terms if (t.effect.name, t.place) not in known]
    names = [t.label(windows.robot) for t in added if t.asked]
    if fit.kept is not None and before.kept is None:
        names.append("numbers as built")
    return "+ " + ", ".join(names)


def _likeness(
    model: ScoredModel, named: Sequence[Term] = ()
) -> tuple[tuple[Candidate, ...], Floats]:
    """The best candidates and the named ones, and the |cosine| between their changes."""
    test = model.test
    chosen, directions = [], []
    further = [s for s in model.scores[RIVALS:] if any(s.proposes(term) for term in named)]
    for score in (*model.scores[:RIVALS], *further):
        columns = test.columns[:, test.slice_of(score)]
        weights = np.array(score.sizes) if any(score.sizes) else np.ones(columns.shape[1])
        direction = columns @ weights
        norm = np.linalg.norm(direction)
        if norm > 0:
            chosen.append(score.candidate)
            directions.append(direction / norm)
    if not directions:
        return (), np.zeros((0, 0))
    stacked = np.stack(directions)
    return tuple(chosen), np.abs(stacked @ stacked.T)


def _autocorrelation(windows: Windows, fit: Fit) -> Floats:
    """(LAGS,) autocorrelation of the residuals along time, over all windows and coordinates together."""
    left = fit.residual.reshape(len(windows), windows.steps + 1, -1)
    squares = (left**2).sum()
    lags = range(1, min(LAGS, windows.steps) + 1)
    return np.array([(left[:, lag:] * left[:, :-lag]).sum() / squares for lag in lags])
