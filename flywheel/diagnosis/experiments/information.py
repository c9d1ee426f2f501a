"""Information of planned experiments about each candidate, and their ambiguities.

An experiment is a start, commands, and the noise of the measurements. The plant predicts the
measurements; the outcome of a diagnosis follows, without any data, from the same projected
sensitivities as the score test: the smallest visible size of an effect, and the part of it that
another one could explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from flywheel.diagnosis.fitting.model import usual_window
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.projection import DEAD, Projection
from flywheel.diagnosis.fitting.simulation import WindowSimulator
from flywheel.diagnosis.fitting.windows import ChannelNoise, Windows
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.selection.scores import slices_of, smallest_shown
from flywheel.diagnosis.settings import FittingSettings, Limits, Settings
from flywheel.diagnosis.statistics import chance
from flywheel.dynamics.plant import AugmentedPlant, Motion, Plant
from flywheel.effects import Scales
from flywheel.errors import DataError, ModelError
from flywheel.records import Floats, MeasuredChannel, Observation, State, Trajectory

SETTLING = 1.0  # that the robot lies still before an experiment begins [s]
AT_ONCE = 24  # windows whose sensitivities are in memory together


@dataclass(frozen=True)
class Information:
    """Information of each of S experiments.

    Attributes:
      candidates: all of them.
      gram: (S, n, n) products of the projected sensitivities of every size of every shape of every
        candidate, each at its typical size, in `ScoreTest` order [sigma^2].
      slices: candidate -> shape -> its columns.
      usual: candidate -> its shape of typical values.
      threshold: score from which an effect counts as visible.
    """

    candidates: tuple[Candidate, ...]
    gram: Floats
    slices: tuple[tuple[slice, ...], ...]
    usual: tuple[int, ...]
    threshold: float = Limits().threshold

    def __getitem__(self, rows: Sequence[int] | np.ndarray) -> Information:
        """Some of the experiments."""
        return replace(self, gram=self.gram[rows])

    def __add__(self, other: Information) -> Information:
        """The experiments of both, of the same candidates."""
        return replace(self, gram=np.concatenate([self.gram, other.gram]))

    def smallest(self, index: int) -> Floats:
        """(S,) smallest visible size of a candidate, in typical sizes; infinite for none."""
        own = self.slices[index][self.usual[index]]
        return np.array([smallest_shown(gram, self.threshold) for gram in self.gram[:, own, own]])

    def strength(self, index: int) -> Floats:
        """(S,) change by a candidate at its typical size, beyond known influences [sigma].

        Of several sizes, the combination that shows least, converted to one size of the same
        significance.
        """
        own = self.slices[index][self.usual[index]]
        return _weakest(self.gram[:, own, own]) / np.sqrt(
            chance(own.stop - own.start, self.threshold)
        )

    def separation(self, index: int, rival: int) -> Floats:
        """(S,) part of a candidate at its typical size that no size and shape of a rival explains
        [sigma].

        Negative sizes of the rival are allowed, so that the separation is never overstated.
        """
        own = self.slices[index][self.usual[index]]
        left = []
        for other in self.slices[rival]:
            cross = self.gram[:, own, other]
            inverse = np.linalg.pinv(self.gram[:, other, other], rcond=1e-10, hermitian=True)
            explained = cross @ inverse @ cross.swapaxes(1, 2)
            left.append(_weakest(self.gram[:, own, own] - explained))
        return np.asarray(np.min(left, axis=0))

    def cosines(self, first: int, second: int) -> Floats:
        """(S, m) |cosines| between the changes of two candidates, the largest first.

        One of each common direction, of as many as the candidate of fewer sizes has; 0 if one of
        them changes nothing.
        """
        a, b = (self.slices[i][self.usual[i]] for i in (first, second))
        roots = [_inverse_root(self.gram[:, own, own]) for own in (a, b)]
        values = np.linalg.svd(roots[0] @ self.gram[:, a, b] @ roots[1], compute_uv=False)
        return np.minimum(values, 1.0)


def simulate_scripts(
    plant: Plant,
    scripts: Floats,
    start: State | None = None,
    channels: Sequence[ChannelNoise] = (),
) -> Motion:
    """Motion of a plant under command scripts.

    Args:
      plant: with its effects.
      scripts: (S, T, W) commands.
      start: (1,) initial state; None for the keyframe after a second of holding still.
      channels: measured beside the points.
    """
    augmented, count = AugmentedPlant(plant, [each.key for each in channels]), len(scripts)
    state = plant.settle(SETTLING) if start is None else start
    first = state[np.zeros(count, int)]
    terms = [plant.terms] * count
    told = augmented.commands(scripts, terms)
    return augmented.simulate(first, told, terms, steps=scripts.shape[1])


def information_of(
    plant: Plant,
    scripts: Floats,
    motion: Motion,
    library: Sequence[Candidate],
    sigma: float,
    seconds: float | None = None,
    settings: Settings = Settings(),
    channels: Sequence[ChannelNoise] = (),
) -> Information:
    """Information of planned experiments.

    Args:
      plant: with its known effects.
      scripts: (S, T, W) commands.
      motion: of the plant under them, see `simulate_scripts`.
      library: candidates.
      sigma: noise of each coordinate [m].
      seconds: length of the windows [s]; None for one that suits the robot.
      settings: of the following diagnosis.
      channels: measured beside the points; those of the motion.

    Raises:
      DataError: no candidate, no noise, or scripts too short for a window.
      ModelError: the plant diverged.
    """
    if not library:
        raise DataError("There is no effect to look for.")
    if not sigma > 0:
        raise DataError(f"The noise must be a positive length, got {sigma!r} m.")
    if not motion.finite.all():
        which = int(np.argmin(motion.finite))
        raise ModelError(f"The simulation of {plant.robot.name} diverges under script {which}.")
    tracks = [_track(plant, script, motion, row, channels) for row, script in enumerate(scripts)]
    seconds = seconds or usual_window(plant, settings.windows)
    cut = partial(Windows.cut, plant.robot, seconds=seconds, sigma=sigma, settings=settings.windows)
    slices, row = slices_of(library), 0
    columns = slices[-1][-1].stop
    parts = [np.empty((0, columns, columns))]
    while row < len(tracks):
        each = len(cut(tracks[row : row + 1]))
        stop = row + max(1, AT_ONCE // each)
        states = motion.states[row:stop]
        parts.append(_grams(plant, cut(tracks[row:stop]), states, library, settings.fitting))
        row = stop
    scales = Scales.of(plant.robot)
    usual = tuple(_usual(candidate, scales) for candidate in library)
    grams, threshold = np.concatenate(parts), settings.limits.threshold
    return Information(tuple(library), grams, slices, usual, threshold)


def _track(
    plant: Plant, script: Floats, motion: Motion, row: int, channels: Sequence[ChannelNoise]
) -> Trajectory:
    """The measurements without noise. Winch positions are only used for the starts of winches."""
    seen = Observation(motion.points[row], plant.winch(motion.states[row]))
    beside = zip(channels, motion.channels[row].T, strict=True)
    measured = [MeasuredChannel(*each.key, values, each.sigma) for each, values in beside]
    return Trajectory(seen, script, plant.dt, channels=tuple(measured))


def _grams(
    plant: Plant,
    windows: Windows,
    states: State,
    library: Sequence[Candidate],
    settings: FittingSettings,
) -> Floats:
    """(S, n, n) of the candidates; every script by itself, like a single recording."""
    starts = states[windows.recording, windows.first]
    fitter = PlantFitter(WindowSimulator(windows, plant), starts, settings)
    fit = fitter.first_estimate(plant.terms)
    terms = [(*fit.terms, term) for candidate in library for term in candidate.unit_terms()]
    shared = [fitter.step_error(fit), fitter.by_value(fit, fitter.free(fit.terms))]
    nuisances = np.concatenate(shared, axis=2)
    nuisances = _each_recording_its_own(nuisances, windows)
    projection = Projection.of(fitter, fitter.jacobian(fit), nuisances)
    left = projection(fitter.columns(fit, terms)).reshape(len(windows), -1, len(terms))
    grams = np.zeros((len(windows.recordings), len(terms), len(terms)))
    np.add.at(grams, windows.recording, left.swapaxes(1, 2) @ left)
    return grams


def _each_recording_its_own(columns: Floats, windows: Windows) -> Floats:
    """(K, D, n * recordings) of columns (K, D, n): zero in the windows of other recordings."""
    own = windows.recording[:, None] == np.arange(len(windows.recordings))
    apart = columns[:, :, None, :] * own[:, None, :, None]
    return apart.reshape(*columns.shape[:2], -1)


def _usual(candidate: Candidate, scales: Scales) -> int:
    """The shape nearest to the typical values."""
    typical = np.array([shape.typical(scales) for shape in candidate.effect.shapes])
    off = [np.abs(np.log(np.array(shape) / typical)).sum() for shape in candidate.shapes]
    return int(np.argmin(off))


def _weakest(grams: Floats) -> Floats:
    """(S,) root of the least eigenvalue of (S, d, d)."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(grams)[:, 0], 0.0))


def _inverse_root(grams: Floats) -> Floats:
    """(S, d, d) inverse square roots; 0 for empty directions."""
    values, vectors = np.linalg.eigh(grams)
    live = values > np.maximum(DEAD**2, 1e-10 * values[:, -1:])
    roots = np.where(live, 1.0 / np.sqrt(np.where(live, values, 1.0)), 0.0)
    return (vectors * roots[:, None, :]) @ vectors.swapaxes(1, 2)
