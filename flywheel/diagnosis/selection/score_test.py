"""The projected score test: which effect explains what the fitted model cannot.

Everything that is unknown and of no interest (the windows' starts, the winches' offsets, effects that
are already in the model) is projected out of residuals and sensitivities alike. What is left of an
effect's sensitivity, g, and of the residual, r, gives its size, its score and what the data could show
at all, without a refit: Lagrange-multiplier test (Rao 1948), in the linearisation of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flywheel.diagnosis.fitting.jacobian_cache import Linear
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.records import Floats

# A sensitivity is the change that a typical size makes. Where that is large, in some window [sigma], the
# change that a share of it makes may be a better promise: where a robot rolls, it soon rolls elsewhere.
LARGE, SHARE = 1.0, 0.1
DEAD = 1e-6  # a sensitivity below this many sigmas means that the knob is not connected


@dataclass(frozen=True)
class Projection:
    """Takes out of vectors what the nuisances can explain.

    Attributes:
      bases: (K, D + X, X) orthonormal, of the starts with their priors.
      shared: (K, D + X, S) orthonormal over all windows together, of what windows share.
      weights: (K,) of the windows, at most 1; what one bad window says counts less.
    """

    bases: Floats
    shared: Floats
    weights: Floats

    @classmethod
    def of(
        cls, fitter: Fitter, linear: Linear, sizes: Floats | None, weights: Floats
    ) -> Projection:
        """The nuisances of a fit: starts, offsets, and the sizes (K, D, n) already in the model."""
        count, _, entries = linear.by_start.shape
        root = weights[:, None, None]
        prior = np.broadcast_to(np.diag(1.0 / fitter.prior), (count, entries, entries))
        bases = np.linalg.qr(np.concatenate([linear.by_start * root, prior], axis=1))[0]
        shared = fitter.shared(linear, None) * root
        if sizes is not None:
            shared = np.concatenate([shared, sizes * root], axis=2)
        partial = cls(bases, np.zeros((*bases.shape[:2], 0)), weights)
        left = partial._without_starts(partial._padded(shared))
        flat = left.reshape(-1, left.shape[2])
        norms = np.linalg.norm(flat, axis=0)
        flat = flat[:, norms > DEAD] / norms[norms > DEAD]
        vectors, spread, _ = np.linalg.svd(flat, full_matrices=False)
        kept = vectors[:, spread > 1e-8 * max(spread.max(initial=0.0), 1e-300)]
        return cls(bases, kept.reshape(*left.shape[:2], -1), weights)

    def __call__(self, vectors: Floats) -> Floats:
        """(K (D + X), n) what is left of vectors (K, D, n)."""
        left = self.of_starts(vectors)
        left = left.reshape(-1, left.shape[2])
        shared = self.shared.reshape(len(left), -1)
        return left - shared @ (shared.T @ left)

    def of_starts(self, vectors: Floats) -> Floats:
        """(K, D + X, n) what the windows' starts leave of vectors (K, D, n)."""
        return self._without_starts(self._padded(vectors * self.weights[:, None, None]))

    def _padded(self, vectors: Floats) -> Floats:
        missing = self.bases.shape[1] - vectors.shape[1]
        return np.pad(vectors, ((0, 0), (0, missing), (0, 0)))

    def _without_starts(self, vectors: Floats) -> Floats:
        return vectors - self.bases @ (self.bases.swapaxes(1, 2) @ vectors)


@dataclass(frozen=True)
class Score:
    """What the test says of one candidate.

    Attributes:
      candidate: which.
      shape: index of its best shape.
      power: S, fall of the squared residuals in the linearisation [sigma^2].
      score: S per size and per noise, to compare with `Threshold`.
      sizes: one-step estimates, in multiples of the typical sizes.
      errors: their standard deviations.
      smallest: size that these data would have shown (95 %), in multiples of the typical one.
    """

    candidate: Candidate
    shape: int
    power: float
    score: float
    sizes: tuple[float, ...]
    errors: tuple[float, ...]
    smallest: float


@dataclass(frozen=True)
class ScoreTest:
    """Residual and sensitivities after the projection.

    Attributes:
      candidates: that were tested.
      residual: (N,).
      columns: (N, n) of every size of every shape of every candidate, in `unit_terms` order.
      shorter: (n,) bool, those that are what a share of a typical size changes.
      slices: candidate -> shape -> its columns.
      noise: variance of the residual per degree of freedom.
      freedom: degrees of freedom of the residual.
      projection: that was used.
      whole: the same, in which every window counts in full.
      left: (N,) residual after that; what one bad window says shows here.
    """

    candidates: tuple[Candidate, ...]
    residual: Floats
    columns: Floats
    shorter: np.ndarray
    slices: tuple[tuple[slice, ...], ...]
    noise: float
    freedom: float
    projection: Projection
    whole: Projection
    left: Floats

    def scores(self, residual: Floats | None = None) -> list[Score]:
        """Of every candidate, in order; of another residual if one is given."""
        r = self.residual if residual is None else residual
        gram, pull = self.columns.T @ self.columns, self.columns.T @ r
        return [
            self._score(index, candidate, gram, pull)
            for index, candidate in enumerate(self.candidates)
        ]

    def _score(self, index: int, candidate: Candidate, gram: Floats, pull: Floats) -> Score:
        tried = []
        for shape, columns in enumerate(self.slices[index]):
            a, b = gram[columns, columns], pull[columns]
            sizes, power = _solved(a, b, candidate)
            tried.append((power, shape, sizes, a))
        power, shape, sizes, a = max(tried, key=lambda each: each[0])
        inverse = np.linalg.pinv(a)
        noise = max(self.noise, 1.0)
        return Score(
            candidate,
            shape,
            power,
            power / len(sizes) / noise,
            tuple(sizes),
            tuple(np.sqrt(noise * np.diag(inverse).clip(min=0.0))),  # below by rounding only
            smallest_shown(a, noise),
        )


CRITICAL = 25.0  # score of an effect that counts as shown, where smallest sizes are stated
SURE = 1.645  # standard deviations by which its root is exceeded in 95 of 100 recordings


def smallest_shown(gram: Floats, noise: float = 1.0) -> float:
    """Size that scores `CRITICAL` in 95 of 100 recordings, from products (d, d) of sensitivities.

    Noise adds to the root of what is explained, or takes away, one standard deviation: an effect that
    would score exactly that much without noise is missed every second time. Of several sizes, in the
    combination that shows least; a score is what is explained per size. Infinite for none.
    """
    weakest, sizes = np.linalg.eigvalsh(gram)[0], len(gram)
    if weakest <= DEAD**2:
        return np.inf
    return float((np.sqrt(CRITICAL * sizes) + SURE) * np.sqrt(noise / weakest))


def slices_of(library: Sequence[Candidate]) -> tuple[tuple[slice, ...], ...]:
    """Candidate -> shape -> its columns, where those of all unit terms stand side by side."""
    slices, place = [], 0
    for candidate in library:
        size = len(candidate.typical)
        starts = [place + size * shape for shape in range(len(candidate.shapes))]
        slices.append(tuple(slice(start, start + size) for start in starts))
        place += size * len(candidate.shapes)
    return tuple(slices)


def _solved(a: Floats, b: Floats, candidate: Candidate) -> tuple[Floats, float]:
    """Sizes that explain the most, and how much; a size that cannot be negative is zero instead."""
    if np.linalg.eigvalsh(a)[0] < DEAD**2:
        return np.zeros(len(b)), 0.0
    sizes = np.linalg.solve(a, b)
    one_sided = np.array([parameter.one_sided for parameter in candidate.effect.sizes])
    if (sizes[one_sided] < 0).any():
        return np.zeros(len(b)), 0.0
    return sizes, float(b @ sizes)


def secants(fitter: Fitter, fit: Fit, chosen: Sequence[Candidate], share: float = 1.0) -> Floats:
    """(K, D, n) what that share of every typical size of every shape changes, per typical size."""
    terms = [(*fit.terms, term) for c in chosen for term in c.unit_terms(share)]
    return fitter.columns(fit, terms) / share


def sensitivities(
    fitter: Fitter,
    fit: Fit,
    library: Sequence[Candidate],
    projection: Projection,
    residual: Floats,
) -> tuple[Floats, np.ndarray]:
    """(N, n) with every size of every shape, projected: of two secants the one that promises more.

    And (n,) bool, where that is the shorter one.
    """
    raw, slices = secants(fitter, fit, library), slices_of(library)
    change = np.sqrt(fitter.windows.mean_square(raw)).max(axis=0)
    found, taken = projection(raw), np.zeros(raw.shape[2], bool)
    large = [i for i, own in enumerate(slices) if any(change[s].max() > LARGE for s in own)]
    if not large:
        return found, taken
    again = [library[i] for i in large]
    shorter = projection(secants(fitter, fit, again, SHARE))
    for candidate, whole, part in zip(
        again, (slices[i] for i in large), slices_of(again), strict=True
    ):
        for own, other in zip(whole, part, strict=True):
            if _promise(shorter[:, other], residual, candidate) > _promise(
                found[:, own], residual, candidate
            ):
                found[:, own], taken[own] = shorter[:, other], True
    return found, taken


def _promise(columns: Floats, residual: Floats, candidate: Candidate) -> float:
    """How much of a residual (N,) sizes with these sensitivities (N, d) explain."""
    return _solved(columns.T @ columns, columns.T @ residual, candidate)[1]


def score_test(
    fitter: Fitter,
    fit: Fit,
    library: Sequence[Candidate],
    known: Floats | None = None,
    linear: Linear | None = None,
) -> ScoreTest:
    """Test candidates on top of a fit.

    Args:
      fitter, fit: the model so far.
      library: candidates.
      known: (K, D, n) sensitivities of sizes that were fitted, to be projected out.
      linear: of the fit, where it is at hand.
    """
    linear = linear or fitter.linear(fit)
    mean = fitter.mean_squares(fit)
    entries = linear.by_start.shape[2]
    # Windows that saw less than their starts have unknowns fit however wrong the model is.
    tells = np.isfinite(fitter.windows.measured).sum(axis=(1, 2, 3)) > entries
    usual = max(
        float(np.median(mean[tells] if tells.any() else mean)), 1e-9
    )  # 0 where all diverged
    weights = 1.0 / np.sqrt(np.maximum(1.0, mean / usual))
    projection = Projection.of(fitter, linear, known, weights)
    whole = Projection.of(fitter, linear, known, np.ones(len(mean)))
    residual = projection(fit.residual[..., None])[:, 0]
    measured = int(np.isfinite(fitter.windows.measured).sum())
    freedom = float(measured - len(mean) * entries - projection.shared.shape[2])
    noise = float(residual @ residual) / max(freedom, 1.0)
    columns, shorter = sensitivities(fitter, fit, library, projection, residual)
    return ScoreTest(
        tuple(library),
        residual,
        columns,
        shorter,
        slices_of(library),
        noise,
        freedom,
        projection,
        whole,
        whole(fit.residual[..., None])[:, 0],
    )
