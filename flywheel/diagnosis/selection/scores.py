"""The projected score test: which effect explains the residual of the fitted model.

All unknowns of no interest (initial states, the winches' offsets, effects in the model) are
projected out of residuals and sensitivities alike. The rest of an effect's sensitivity, g, and of
the residual, r, gives its size (g'r / g'g), its Lagrange-multiplier statistic ((g'r)^2 / g'g) and
the smallest visible size, without a refit (Rao 1948), in the linearisation of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian
from flywheel.diagnosis.fitting.projection import DEAD, Projection
from flywheel.diagnosis.selection.candidates import Candidate
from flywheel.diagnosis.settings import Limits
from flywheel.diagnosis.statistics import POWER, chance
from flywheel.effects import Parameter, Term
from flywheel.records import Floats

# Change of some window by a typical size [sigma], above which this part of it is tried, too: a rolling robot
# soon rolls elsewhere.
LARGE, PART = 1.0, 0.1


@dataclass(frozen=True)
class Score:
    """Result of the test for one candidate.

    Attributes:
      candidate: the candidate.
      shape: index of its best shape.
      statistic: Lagrange-multiplier (LM) statistic: decrease of the squared residuals in the
        linearisation [sigma^2].
      score: the statistic over the noise, for several sizes that of one size of the same
        significance (`chance`), to compare with the test's threshold.
      sizes: one-step estimates, in multiples of the typical sizes.
      smallest: size visible in these data (95 %), in multiples of the typical one.
    """

    candidate: Candidate
    shape: int
    statistic: float
    score: float
    sizes: tuple[float, ...]
    smallest: float

    @property
    def term(self) -> Term:
        """The effect with these sizes."""
        return self.candidate.term(self.sizes, self.shape)

    def proposes(self, term: Term) -> bool:
        """True for the effect of a term, at its place."""
        candidate = self.candidate
        return candidate.effect.name == term.effect.name and candidate.place == term.place


@dataclass(frozen=True)
class ScoreTest:
    """Residual and sensitivities after the projection.

    Attributes:
      candidates: tested ones.
      residual: (N,).
      columns: (N, n) of every size of every shape of every candidate, in `unit_terms` order.
      shorter: (n,) bool, True for changes by `PART` of a typical size.
      freedom: degrees of freedom of the residual.
      projection: in use.
      whole: the same without quantities that have a prior, with every window in full.
      left: (N,) residual after that: it includes bad windows.
      left_freedom: its degrees of freedom.
      threshold: score from which an effect counts as visible, see `Limits`.
    """

    candidates: tuple[Candidate, ...]
    residual: Floats
    columns: Floats
    shorter: np.ndarray
    freedom: float
    projection: Projection
    whole: Projection
    left: Floats
    left_freedom: float
    threshold: float

    @cached_property
    def slices(self) -> tuple[tuple[slice, ...], ...]:
        """Candidate -> shape -> its columns."""
        return slices_of(self.candidates)

    @cached_property
    def noise(self) -> float:
        """Variance of the residual per degree of freedom."""
        return float(self.residual @ self.residual) / max(self.freedom, 1.0)

    @property
    def left_noise(self) -> float:
        """Variance of the residual per degree of freedom, with every window in full."""
        return float(self.left @ self.left) / max(self.left_freedom, 1.0)

    def beyond_noise(self, fitter: Fitter) -> float:
        """Root mean square of the residual beyond noise [m]."""
        windows = fitter.windows
        square = self.left_noise * windows.sigma**2 - windows.noise**2
        return float(np.sqrt(max(0.0, square)))

    def at(self, residual: Floats) -> ScoreTest:
        """The same sensitivities with residuals (K, D) of another fit nearby, without values with a prior."""
        own, left = (each(residual[..., None])[:, 0] for each in (self.projection, self.whole))
        return replace(self, residual=own, left=left)

    def slice_of(self, score: Score) -> slice:
        """The columns of a score's candidate, in its shape."""
        return self.slices[self.candidates.index(score.candidate)][score.shape]

    def scores(self) -> list[Score]:
        """The score of every candidate, in order."""
        gram, right = self.columns.T @ self.columns, self.columns.T @ self.residual
        noise, found = max(self.noise, 1.0), []
        for candidate, slices in zip(self.candidates, self.slices, strict=True):
            tried = [solved(gram[own, own], right[own], candidate.effect.sizes) for own in slices]
            shape = max(range(len(tried)), key=lambda each: tried[each][1])
            (sizes, statistic), own = tried[shape], slices[shape]
            score = statistic / chance(len(sizes), self.threshold) / noise
            smallest = smallest_shown(gram[own, own], self.threshold, noise)
            found.append(Score(candidate, shape, statistic, score, tuple(sizes), smallest))
        return found


@dataclass(frozen=True)
class Linearised:
    """A fitted model, and its sensitivities.

    Attributes:
      fit: the model.
      jacobian: around it.
      by_value: (K, D, n) its sensitivities to its values.
    """

    fit: Fit
    jacobian: Jacobian
    by_value: Floats


@dataclass(frozen=True)
class ScoredModel(Linearised):
    """A fitted model, and the score of every candidate on top of it.

    Attributes:
      test: of every candidate and every probe.
      scores: of every candidate, best first.
      probes: of every probe; see `misspecification`.
    """

    test: ScoreTest
    scores: tuple[Score, ...]
    probes: tuple[Score, ...]

    @property
    def beyond_noise(self) -> float:
        """Squares of the model's residual beyond noise [sigma^2]; may be slightly negative."""
        return (self.test.noise - 1.0) * self.test.freedom

    @property
    def left(self) -> float:
        """The same from the actual cost of the fit, which may be more if it is stuck [sigma^2]."""
        return self.fit.cost - self.test.freedom

    def promises(self, share: float, by_chance: float) -> bool:
        """True if some candidate promises to explain a fraction of the residual beyond noise.

        And more than other initial states of a stuck fit may explain: a fraction `by_chance`.
        """
        best = max(score.statistic for score in self.scores)
        return best >= max(share * self.beyond_noise, by_chance * self.left)


def smallest_shown(gram: Floats, threshold: float, noise: float = 1.0) -> float:
    """Size that reaches the threshold in 95 of 100 recordings, from products (d, d) of sensitivities.

    Noise changes the root of the explained squares by one standard deviation: an effect whose score
    equals the threshold without noise is missed every second time. Of several sizes, in the
    combination that shows least. Infinite for none.
    """
    weakest, sizes = np.linalg.eigvalsh(gram)[0], len(gram)
    if weakest <= DEAD**2:
        return np.inf
    least = np.sqrt(threshold * chance(sizes, threshold)) + POWER
    return float(least * np.sqrt(noise / weakest))


def slices_of(library: Sequence[Candidate]) -> tuple[tuple[slice, ...], ...]:
    """Candidate -> shape -> its columns, in the order of all unit terms."""
    slices, place = [], 0
    for candidate in library:
        size, first = len(candidate.typical), place
        place += size * len(candidate.shapes)
        slices.append(tuple(slice(start, start + size) for start in range(first, place, size)))
    return tuple(slices)


def solved(a: Floats, b: Floats, parameters: Sequence[Parameter]) -> tuple[Floats, float]:
    """Sizes that explain the most, and their explanation; none if one of them cannot be negative.

    From products (d, d), (d,) of sensitivities with each other, and with the residual.
    """
    if np.linalg.eigvalsh(a)[0] < DEAD**2:
        return np.zeros(len(b)), 0.0
    sizes = np.linalg.solve(a, b)
    if any(size < 0 and each.one_sided for size, each in zip(sizes, parameters, strict=True)):
        return np.zeros(len(b)), 0.0
    return sizes, float(b @ sizes)


def secants(fitter: Fitter, fit: Fit, library: Sequence[Candidate], part: float = 1.0) -> Floats:
    """(K, D, n) change by that part of every typical size of every shape, per typical size."""
    terms = [(*fit.terms, term) for each in library for term in each.unit_terms(part)]
    return fitter.columns(fit, terms) / part


def sensitivities(
    fitter: Fitter,
    fit: Fit,
    library: Sequence[Candidate],
    projection: Projection,
    residual: Floats,
) -> tuple[Floats, np.ndarray]:
    """(N, n) with every size of every shape, projected: of two secants the one that promises more.

    And (n,) bool, True for the shorter one.
    """
    raw, slices = secants(fitter, fit, library), slices_of(library)
    change = np.sqrt(fitter.windows.mean_square(raw)).max(axis=0)
    found, taken = projection(raw), np.zeros(raw.shape[2], bool)
    large = [i for i, own in enumerate(slices) if any(change[s].max() > LARGE for s in own)]
    if not large:
        return found, taken
    again = [library[i] for i in large]
    shorter = projection(secants(fitter, fit, again, PART))
    for index, part in zip(large, slices_of(again), strict=True):
        for own, other in zip(slices[index], part, strict=True):
            by_whole, by_part = (
                solved(each.T @ each, each.T @ residual, library[index].effect.sizes)[1]
                for each in (found[:, own], shorter[:, other])
            )
            if by_part > by_whole:
                found[:, own], taken[own] = shorter[:, other], True
    return found, taken


def score_test(
    fitter: Fitter,
    fit: Fit,
    library: Sequence[Candidate],
    known: Floats | None = None,
    jacobian: Jacobian | None = None,
    prior: Sequence[tuple[float, float]] = (),
    threshold: float = Limits().threshold,
) -> ScoreTest:
    """Test candidates on top of a fit.

    Args:
      known: (K, D, n) sensitivities of fitted sizes, to be projected out.
      jacobian: of the fit, if available.
      prior: of the last of the `known` sizes: fitted value, and standard deviation around zero, infinite
        without one.
      threshold: score from which an effect counts as visible.
    """
    jacobian = jacobian or fitter.jacobian(fit)
    mean = fitter.mean_squares(fit)
    # Windows that saw less than they have local parameters fit however wrong the model is.
    tells = fitter.windows.noisy_in_each > fitter.taken
    usual = max(float(np.median(mean[tells] if tells.any() else mean)), 1e-9)  # 0: all diverged
    weights = 1.0 / np.sqrt(np.maximum(1.0, mean / usual))
    known = np.zeros((*fit.residual.shape, 0)) if known is None else known
    values, last = np.reshape(prior, (-1, 2)).T
    before = known.shape[2] - len(prior)
    deviations = np.concatenate([np.full(before, np.inf), last])
    projection = Projection.of(fitter, jacobian, known, weights, deviations)
    full = Projection.of(fitter, jacobian, known, np.ones(len(mean)), deviations)
    # Of what something is known the residual without it is asked: what is known tells how much it is.
    off = fit.residual + known[..., before:] @ np.where(np.isfinite(last), values, 0.0)
    residual = projection(off[..., None])[:, 0]
    columns, shorter = sensitivities(fitter, fit, library, projection, residual)
    return ScoreTest(
        candidates=tuple(library),
        residual=residual,
        columns=columns,
        shorter=shorter,
        freedom=fitter.freedom - float((projection.shares == 1.0).sum()),
        projection=projection,
        whole=full.unknown,
        left=full.unknown(fit.residual[..., None])[:, 0],
        left_freedom=fitter.freedom - full.taken,
        threshold=threshold,
    )


def further_scores(
    fitter: Fitter, fit: Fit, test: ScoreTest, library: Sequence[Candidate]
) -> list[Score]:
    """Scores of other candidates on top of the fit of a test, in order."""
    columns, shorter = sensitivities(fitter, fit, library, test.projection, test.residual)
    return replace(test, candidates=tuple(library), columns=columns, shorter=shorter).scores()
