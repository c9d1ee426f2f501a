"""The score test is least squares: a model that is linear in all its parameters says so exactly."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import chi2

from flywheel.diagnosis.checks.adequacy import adequacy
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter, Jacobian
from flywheel.diagnosis.fitting.projection import Projection
from flywheel.diagnosis.fitting.windows import Recording, Windows
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.scores import (
    LARGE,
    PART,
    ScoredModel,
    ScoreTest,
    score_test,
    smallest_shown,
)
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import Limits
from flywheel.diagnosis.statistics import chance
from flywheel.effects import EFFECTS, Terms
from flywheel.records import Floats
from flywheel.robots import Robot

# Windows of two recordings, steps after the first, points, local parameters of each, and winches.
WINDOWS, STEPS, POINTS, LOCAL, WINCHES = 5, 4, 3, 2, 2
COORDINATES = (STEPS + 1) * POINTS * 3
CRITICAL = Limits().threshold
PRIOR, SIGMA = np.array([0.5, 2.0]), 0.01


@dataclass
class LinearModel(Fitter):
    """Every parameter moves the predictions by as much as it is large; one effect bends with its size.

    Attributes:
      windows, local_prior, winch_prior: see `Fitter`.
      by_local, by_winch: sensitivities, see `Jacobian` [sigma].
      by_effect: (name, number of the size, shape) -> (K, D) change by a typical size [sigma].
      bent: name of the effect whose first size moves less and in another way at a whole typical size.
      bend: (K, D) change by that [sigma].
    """

    windows: Windows
    local_prior: Floats
    winch_prior: float
    by_local: Floats
    by_winch: Floats
    by_effect: dict[tuple[str, int, tuple[float, ...]], Floats]
    typical: dict[str, tuple[float, ...]]
    bent: str = ""
    bend: Floats | float = 0.0

    def jacobian(self, fit: Fit) -> Jacobian:
        return Jacobian(self.by_local, self.by_winch)

    def predictions(self, fit: Fit, terms: Sequence[Terms]) -> Floats:
        return fit.points + SIGMA * np.stack([self._change(each) for each in terms]).reshape(
            len(terms), *fit.points.shape
        )

    def _change(self, terms: Terms) -> Floats:
        change = np.zeros((WINDOWS, COORDINATES))
        for term in terms:
            name, typical = term.effect.name, self.typical[term.effect.name]
            shape = tuple(term.values[len(typical) :])
            for number, usual in enumerate(typical):
                size = term.values[number] / usual
                change = change + size * self.by_effect[name, number, shape]
                if name == self.bent and number == 0:
                    change = change + size**2 * self.bend
        return change

    time_steps = starts_are_free = own_errors = None  # type: ignore[assignment]
    first_estimate = with_terms = with_local = rough_jacobian = None  # type: ignore[assignment]
    step_error = stepped = rms = finer = restarted = best_of = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Case:
    """A model, what it leaves, and what could explain that."""

    model: LinearModel
    fit: Fit
    library: tuple[Candidate, ...]

    def test(self, **more: object) -> ScoreTest:
        return score_test(self.model, self.fit, self.library, **more)  # type: ignore[arg-type]

    def column(self, index: int, number: int = 0, shape: int = 0) -> Floats:
        """(K, D) change by a typical size of a candidate."""
        candidate = self.library[index]
        return self.model.by_effect[candidate.effect.name, number, candidate.shapes[shape]]


def windows_of(robot: Robot, rng: np.random.Generator) -> Windows:
    """Three windows of one recording and two of another; some points are missing."""
    measured = rng.normal(size=(WINDOWS, STEPS + 1, POINTS, 3))
    measured[rng.random(measured.shape[:3]) < 0.2] = np.nan
    nothing = np.zeros((0, WINCHES))
    recording = Recording(np.zeros((0, POINTS, 3)), nothing, nothing)
    return Windows(
        robot,
        (recording, recording),
        0.01,
        STEPS,
        np.array([0, 0, 0, 1, 1]),
        np.arange(5),
        measured,
        np.zeros((WINDOWS, POINTS, 3), bool),
        SIGMA,
    )


@pytest.fixture(scope="module")
def case(robot: Robot) -> Case:
    """Everything is drawn; all windows are equally far off."""
    rng = np.random.default_rng(20)
    windows = windows_of(robot, rng)
    seen = np.isfinite(windows.measured).reshape(WINDOWS, -1)
    library = candidates(
        robot, {n: EFFECTS[n] for n in ("slope", "creep", "winch_gain", "capstan")}
    )

    def drawn(*more: int) -> Floats:
        return rng.normal(size=(WINDOWS, COORDINATES, *more)) * seen.reshape(
            *seen.shape, *(1,) * len(more)
        )

    model = LinearModel(
        windows,
        PRIOR,
        0.1,
        drawn(LOCAL),
        drawn(WINCHES),
        {
            (c.effect.name, n, s): drawn()
            for c in library
            for n in range(len(c.typical))
            for s in c.shapes
        },
        {c.effect.name: c.typical for c in library},
    )
    residual = 3.0 * drawn()
    residual /= np.sqrt(windows.mean_square(residual))[:, None]
    points = np.zeros((WINDOWS, STEPS + 1, POINTS, 3))
    local = np.zeros((WINDOWS, LOCAL))
    return Case(model, Fit(None, (), local, points, residual, None, 0.0), library)  # type: ignore[arg-type]


def stacked(model: LinearModel, weights: Floats, by_value: Floats | None = None) -> Floats:
    """(K (D + X), K X + S): all windows' equations below each other, with those of the priors."""
    shared = model.by_shared(model.jacobian(None), by_value)  # type: ignore[arg-type]
    rows = COORDINATES + LOCAL
    whole = np.zeros((WINDOWS * rows, WINDOWS * LOCAL + shared.shape[2]))
    for k in range(WINDOWS):
        here, own = k * rows, slice(k * LOCAL, (k + 1) * LOCAL)
        whole[here : here + COORDINATES, own] = weights[k] * model.by_local[k]
        whole[here + COORDINATES : here + rows, own] = np.diag(1.0 / PRIOR)
        whole[here : here + COORDINATES, WINDOWS * LOCAL :] = weights[k] * shared[k]
    return whole


def below(vectors: Floats, weights: Floats) -> Floats:
    """(K (D + X), n) of (K, D, n): nothing is asked of the priors."""
    padded = np.pad(weights[:, None, None] * vectors, ((0, 0), (0, LOCAL), (0, 0)))
    return padded.reshape(-1, vectors.shape[2])


def left_by(columns: Floats, vectors: Floats) -> Floats:
    """What the best combination of columns leaves of vectors."""
    return vectors - columns @ np.linalg.lstsq(columns, vectors, rcond=None)[0]


WEIGHTS = np.array([1.0, 0.5, 0.9, 0.2, 0.7])
EVERY = np.ones(WINDOWS)


@pytest.mark.parametrize("weights", [EVERY, WEIGHTS])
@pytest.mark.parametrize("sizes", [0, 3])
def test_a_projection_leaves_what_a_fit_of_all_nuisances_leaves(case, weights, sizes):
    rng = np.random.default_rng(1)
    known = rng.normal(size=(WINDOWS, COORDINATES, sizes)) if sizes else None
    vectors = rng.normal(size=(WINDOWS, COORDINATES, 4))
    projection = Projection.of(case.model, case.model.jacobian(case.fit), known, weights)
    expected = left_by(stacked(case.model, weights, known), below(vectors, weights))
    np.testing.assert_allclose(projection(vectors), expected, atol=1e-9)
    local = stacked(case.model, weights)[:, : WINDOWS * LOCAL]
    left = projection.without_local(vectors).reshape(-1, 4)
    np.testing.assert_allclose(left, left_by(local, below(vectors, weights)), atol=1e-9)


def test_nuisances_that_say_the_same_or_nothing_count_once(case: Case) -> None:
    rng = np.random.default_rng(2)
    one = rng.normal(size=(WINDOWS, COORDINATES, 1))
    jacobian = case.model.jacobian(case.fit)
    thrice = np.concatenate([one, -2.0 * one, 1e-9 * one, 0.0 * one], axis=2)
    projections = [Projection.of(case.model, jacobian, known, EVERY) for known in (one, thrice)]
    offsets = 2 * WINCHES  # two recordings
    assert [p.shared.shape[1] for p in projections] == [offsets + 1, offsets + 1]
    vectors = rng.normal(size=(WINDOWS, COORDINATES, 2))
    np.testing.assert_allclose(projections[0](vectors), projections[1](vectors), atol=1e-9)


def test_nuisances_in_other_units_are_the_same_nuisances(case: Case) -> None:
    rng = np.random.default_rng(3)
    known, vectors = rng.normal(size=(2, WINDOWS, COORDINATES, 2))
    jacobian = case.model.jacobian(case.fit)
    expected = Projection.of(case.model, jacobian, known, EVERY)(vectors)
    for unit in (np.array([1e5, 1.0]), np.array([1e-3, 1e3])):
        found = Projection.of(case.model, jacobian, known * unit, EVERY)(vectors)
        np.testing.assert_allclose(found, expected, atol=1e-8)


DEVIATIONS = np.array([0.3, np.inf, 1.5])  # of three values: the second may be anything


def test_what_is_known_of_values_is_marginalised(case: Case) -> None:
    """Products of what is left are those of the inverse covariance, and its determinant is the price."""
    rng = np.random.default_rng(4)
    known = rng.normal(size=(WINDOWS, COORDINATES, 3))
    vectors = rng.normal(size=(WINDOWS, COORDINATES, 4))
    jacobian = case.model.jacobian(case.fit)
    projection = Projection.of(case.model, jacobian, known, WEIGHTS, DEVIATIONS)

    free, told = stacked(case.model, WEIGHTS, known[..., 1:2]), below(known, WEIGHTS)[:, [0, 2]]
    spread = left_by(free, told) * DEVIATIONS[[0, 2]]
    covariance = np.eye(len(spread)) + spread @ spread.T
    left = left_by(free, below(vectors, WEIGHTS))
    expected = left.T @ np.linalg.solve(covariance, left)
    found = projection(vectors)
    np.testing.assert_allclose(found.T @ found, expected, rtol=1e-8, atol=1e-8)
    assert projection.price == pytest.approx(np.linalg.slogdet(covariance)[1])
    np.testing.assert_allclose(projection.unknown(vectors), left, atol=1e-9)
    taken = (
        free.shape[1] - WINDOWS * LOCAL + np.trace(np.eye(len(spread)) - np.linalg.inv(covariance))
    )
    assert projection.taken == pytest.approx(taken)


@pytest.mark.parametrize("factor", [0.25, 1.0, 3.0])
def test_priors_are_scaled_without_asking_the_model_again(case: Case, factor: float) -> None:
    rng = np.random.default_rng(4)
    known = rng.normal(size=(WINDOWS, COORDINATES, 3))
    vectors = rng.normal(size=(WINDOWS, COORDINATES, 4))
    jacobian = case.model.jacobian(case.fit)
    usual, expected = (
        Projection.of(case.model, jacobian, known, WEIGHTS, share * DEVIATIONS)
        for share in (1.0, factor)
    )
    found = usual.with_priors_scaled(factor)
    left = found(vectors)
    np.testing.assert_allclose(left.T @ left, expected(vectors).T @ expected(vectors), rtol=1e-8)
    assert found.price == pytest.approx(expected.price)


def test_a_score_does_not_depend_on_what_known_values_were_fitted_to(case: Case) -> None:
    """They are put back: a score is that of the residual without them, by their covariance."""
    rng = np.random.default_rng(5)
    known, values = rng.normal(size=(WINDOWS, COORDINATES, 2)), np.array([0.7, -1.2])
    before = case.fit.residual
    axis = np.where(before != 0.0, rng.normal(size=before.shape), 0.0)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    # What the values make is a reflection, so that all windows stay equally loud and weigh the same.
    made = 2.0 * (before * axis).sum(axis=1, keepdims=True) * axis
    known[..., 0] = (made - known[..., 1] * values[1]) / values[0]
    scores = []
    for share in (0.0, 1.0):
        fit = replace(case.fit, residual=before - share * known @ values)
        prior = [(float(share * value), 0.5) for value in values]
        test = replace(case, fit=fit).test(known=known, prior=prior)
        scores.append([(s.score, s.sizes) for s in test.scores()])
    for (one, sizes), (other, others) in zip(*scores, strict=True):
        assert one == pytest.approx(other)
        assert sizes == pytest.approx(others)


def test_a_score_is_what_a_fit_with_the_candidate_explains(case: Case) -> None:
    """Sizes and the fall of the squares are those of the regression of everything."""
    test = case.test()
    np.testing.assert_allclose(test.projection.weights, 1.0)
    nuisances, target = stacked(case.model, EVERY), below(case.fit.residual[..., None], EVERY)[:, 0]
    before = np.sum(left_by(nuisances, target) ** 2)
    for index, score in enumerate(test.scores()):
        candidate, count = case.library[index], len(case.library[index].typical)
        falls = []
        for shape in range(len(candidate.shapes)):
            own = np.stack([case.column(index, n, shape) for n in range(count)], axis=2)
            every = np.concatenate([below(own, EVERY), nuisances], axis=1)
            sizes = np.linalg.lstsq(every, target, rcond=None)[0][:count]
            fall = before - np.sum(left_by(every, target) ** 2)
            one_sided = candidate.effect.sizes[0].one_sided
            falls.append(0.0 if one_sided and sizes[0] < 0 else fall)
            if shape == score.shape:
                expected = np.zeros(count) if falls[-1] == 0.0 else sizes
        assert score.candidate is candidate
        assert score.statistic == pytest.approx(max(falls), abs=1e-9)
        assert score.sizes == pytest.approx(expected, abs=1e-9)
        assert score.score == pytest.approx(
            score.statistic / chance(count, CRITICAL) / max(test.noise, 1.0)
        )
    assert sum(score.statistic > 0 for score in test.scores()) >= 2


def test_of_several_shapes_the_one_that_explains_most_counts(case: Case) -> None:
    creep = next(i for i, c in enumerate(case.library) if c.effect.name == "creep")
    test = case.test()
    for shape in range(len(case.library[creep].shapes)):
        planted = test.columns[:, test.slices[creep][shape]] @ [30.0]
        (found,) = (
            s
            for s in replace(test, residual=planted).scores()
            if s.candidate is case.library[creep]
        )
        assert (found.shape, found.sizes) == (shape, pytest.approx((30.0,)))


@pytest.mark.parametrize("size", [-3.0, -0.2, 0.2])
def test_a_size_that_cannot_be_negative_explains_nothing_in_its_place(case, size):
    test = case.test()
    for index, candidate in enumerate(case.library):
        one_sided = candidate.effect.sizes[0].one_sided
        if len(candidate.shapes) > 1:  # of which another may go the other way
            continue
        planted = test.columns[:, test.slices[index][0]][:, 0] * size
        found = replace(test, residual=planted).scores()[index]
        if one_sided and size < 0:
            assert found.statistic == 0.0 and set(found.sizes) == {0.0}
        else:
            assert found.sizes[0] == pytest.approx(size) and found.statistic > 0.0


def test_a_noisy_recording_makes_scores_smaller_and_smallest_sizes_larger(case: Case) -> None:
    """Four times the noise: a quarter of the score, twice the size. Less than was said changes nothing."""
    test = case.test()
    quiet, usual, loud = (
        replace(test, freedom=test.residual @ test.residual / noise).scores()[2]
        for noise in (0.1, 1.0, 4.0)
    )
    assert loud.score == pytest.approx(usual.score / 4)
    assert loud.smallest == pytest.approx(2 * usual.smallest)
    assert (loud.statistic, loud.sizes) == (usual.statistic, usual.sizes)
    assert quiet == usual


def test_columns_stand_where_their_candidate_says(case: Case) -> None:
    test = case.test()
    seen = []
    for index, candidate in enumerate(case.library):
        for shape, own in enumerate(test.slices[index]):
            raw = [case.column(index, n, shape) for n in range(len(candidate.typical))]
            np.testing.assert_allclose(
                test.columns[:, own], test.projection(np.stack(raw, axis=2)), atol=1e-6
            )
            seen += range(own.start, own.stop)
    assert sorted(seen) == list(range(test.columns.shape[1]))


def test_what_is_in_the_model_already_explains_nothing_more(case: Case) -> None:
    known = np.stack([case.column(2), case.column(0)], axis=2)
    scores = case.test(known=known).scores()
    assert scores[2].statistic == pytest.approx(0.0, abs=1e-9)
    assert scores[2].smallest == np.inf
    assert scores[0].smallest == np.inf  # of two sizes, one is known
    assert np.isfinite(scores[3].smallest)


def test_a_window_that_is_far_off_counts_less(case: Case) -> None:
    """By the root of how far; what it says is kept beside that."""
    loud = case.fit.residual.copy()
    loud[3] *= 3.0
    test = replace(case, fit=replace(case.fit, residual=loud)).test()
    np.testing.assert_allclose(test.projection.weights, [1.0, 1.0, 1.0, 1.0 / 3.0, 1.0])
    np.testing.assert_array_equal(test.whole.weights, 1.0)
    expected = left_by(stacked(case.model, EVERY), below(loud[..., None], EVERY))[:, 0]
    np.testing.assert_allclose(test.left, expected, atol=1e-9)
    weighted = test.projection.weights
    expected = left_by(stacked(case.model, weighted), below(loud[..., None], weighted))[:, 0]
    np.testing.assert_allclose(test.residual, expected, atol=1e-9)


def test_windows_that_are_all_far_off_count_in_full(case: Case) -> None:
    far = replace(case, fit=replace(case.fit, residual=7.0 * case.fit.residual)).test()
    np.testing.assert_allclose(far.projection.weights, 1.0)
    np.testing.assert_allclose(far.residual, 7.0 * case.test().residual)


def test_windows_that_saw_less_than_they_have_parameters_do_not_say_what_is_usual(case):
    """Their local parameters fit anything: as the usual ones, they would make all others suspect."""
    windows = case.model.windows
    measured = windows.measured.copy()
    measured[:3] = np.nan
    measured[:3, 0, 0, :LOCAL] = 0.0  # as many as there are local parameters
    model = replace(case.model, windows=replace(windows, measured=measured))
    residual = case.fit.residual.copy()
    residual[:3] = 0.0
    residual[:3, :LOCAL] = 1e-3
    test = replace(case, model=model, fit=replace(case.fit, residual=residual)).test()
    np.testing.assert_allclose(test.projection.weights, 1.0)


def test_where_no_window_saw_enough_all_say_what_is_usual(case: Case) -> None:
    windows = case.model.windows
    measured = np.full_like(windows.measured, np.nan)
    measured[:, 0, 0, 0] = 0.0
    model = replace(case.model, windows=replace(windows, measured=measured))
    residual = np.zeros_like(case.fit.residual)
    residual[:, 0] = [1.0, 1.0, 1.0, 2.0, 0.5]
    test = replace(case, model=model, fit=replace(case.fit, residual=residual)).test()
    np.testing.assert_allclose(test.projection.weights, [1.0, 1.0, 1.0, 0.5, 1.0])


def test_noise_is_what_is_left_per_degree_of_freedom(case: Case) -> None:
    """A residual of pure noise has a variance near 1, with every parameter paid for."""
    test = case.test()
    measured = int(np.isfinite(case.model.windows.measured).sum())
    parameters = WINDOWS * LOCAL + 2 * WINCHES
    assert test.freedom == measured - parameters
    assert test.noise == pytest.approx(test.residual @ test.residual / test.freedom)
    known = np.random.default_rng(4).normal(size=(WINDOWS, COORDINATES, 2))
    assert case.test(known=known).freedom == measured - parameters - 2


def test_an_exact_fit_divides_by_nothing(case: Case) -> None:
    exact = replace(case.fit, residual=np.zeros_like(case.fit.residual))
    test = replace(case, fit=exact).test()
    assert test.noise == 0.0
    assert all(score.statistic == score.score == 0.0 for score in test.scores())
    assert np.isfinite(test.columns).all()


def test_a_knob_that_is_not_connected_shows_and_explains_nothing(case: Case) -> None:
    zeros = {key: np.zeros_like(column) for key, column in case.model.by_effect.items()}
    for score in replace(case, model=replace(case.model, by_effect=zeros)).test().scores():
        assert (score.statistic, score.score, score.smallest) == (0.0, 0.0, np.inf)
        assert score.sizes == (0.0,) * len(score.sizes)


def test_a_knob_that_hardly_does_anything_shows_in_a_large_size_only() -> None:
    """Ten thousand times weaker, ten thousand times larger."""
    strong, weak = (smallest_shown(np.array([[gram]]), CRITICAL) for gram in (4.0, 4e-8))
    assert weak == pytest.approx(1e4 * strong)
    assert smallest_shown(np.zeros((1, 1)), CRITICAL) == np.inf


def test_scores_and_smallest_sizes_are_those_of_the_threshold_of_the_test(case: Case) -> None:
    usual, strict = case.test().scores(), case.test(threshold=36.0).scores()
    for before, after in zip(usual, strict, strict=True):
        count = len(after.sizes)
        ratio = chance(count, 36.0) / chance(count, CRITICAL)
        assert after.score == pytest.approx(before.score / ratio)
        assert after.smallest > before.smallest
        if count == 1:
            assert after.smallest / before.smallest == pytest.approx(7.645 / 6.645)


def test_the_same_sensitivities_score_the_residual_of_another_fit(case: Case) -> None:
    test = case.test()
    again = test.at(case.fit.residual)
    assert [s.score for s in again.scores()] == pytest.approx([s.score for s in test.scores()])
    assert (again.noise, again.left_noise) == pytest.approx((test.noise, test.left_noise))
    assert test.at(2.0 * case.fit.residual).noise == pytest.approx(4.0 * test.noise)


def test_a_model_is_ranked_anew_where_the_threshold_has_risen(case: Case) -> None:
    """As it does by what a trained model does wrong by itself."""
    jacobian = Jacobian(case.model.by_local, case.model.by_winch)
    model = ScoredModel(
        case.fit, jacobian, np.zeros((WINDOWS, COORDINATES, 0)), case.test(), (), ()
    )
    found = Search(case.model, case.library, Limits(threshold=36.0)).ranked(model)
    strict = case.test(threshold=36.0).scores()
    assert list(found.scores) == sorted(strict, key=lambda score: -score.score)


@pytest.mark.parametrize("threshold", [4.0, 25.0, 36.0, 100.0])
def test_several_sizes_must_explain_as_much_as_is_as_unlikely(threshold: float) -> None:
    assert chance(1, threshold) == pytest.approx(1.0)
    for sizes in (2, 3):
        unlikely = chi2.sf(chance(sizes, threshold) * threshold, sizes)
        assert unlikely == pytest.approx(chi2.sf(threshold, 1))


@pytest.mark.parametrize("threshold", [1e-300, 1e-6, 1e4, 1e6])
def test_no_threshold_is_too_small_or_too_large_for_that(threshold: float) -> None:
    factors = [chance(sizes, threshold) for sizes in (1, 2, 3, 30)]
    assert factors == sorted(factors) and factors[0] == pytest.approx(1.0)
    assert np.isfinite(factors).all()


@pytest.mark.parametrize("threshold", [CRITICAL, 36.0])
def test_the_smallest_size_shown_is_found_in_95_of_100_recordings(threshold: float) -> None:
    rng, size = np.random.default_rng(5), smallest_shown(np.array([[9.0]]), threshold, 2.0)
    explained = (3.0 * size + np.sqrt(2.0) * rng.normal(size=100_000)) ** 2 / 2.0
    assert np.mean(explained > threshold) == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize("name", ["winch_gain", "slope"])
@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_the_shorter_secant_counts_where_it_promises_more_and_the_whole_one_is_large(
    case: Case, name: str, factor: float
) -> None:
    """An effect that bends: what is missing lies along what a part of its typical size changes.

    Of several sizes, one that is large is enough.
    """
    bent = next(i for i, c in enumerate(case.library) if c.effect.name == name)
    bend = -0.9 * case.column(bent) + case.column(3)
    raw = case.column(bent) + bend
    scale = factor * LARGE / np.sqrt(case.model.windows.mean_square(raw)).max()
    effects = {key: scale * column * 1e-3 for key, column in case.model.by_effect.items()}
    effects[name, 0, ()] = scale * case.column(bent)
    model = replace(case.model, by_effect=effects, bent=name, bend=scale * bend)
    part = effects[name, 0, ()] + PART * model.bend
    off = part / np.sqrt(model.windows.mean_square(part))[:, None]
    test = replace(case, model=model, fit=replace(case.fit, residual=off)).test()
    (own,) = test.slices[bent]
    taken = np.zeros(test.columns.shape[1], bool)
    taken[own] = factor > 1.0
    np.testing.assert_array_equal(test.shorter, taken)
    expected = part if factor > 1.0 else scale * raw
    first = test.columns[:, own.start : own.start + 1]
    np.testing.assert_allclose(first, test.projection(expected[..., None]), atol=1e-6)


@pytest.mark.parametrize(("least_told", "same"), [(1e-6, False), (0.1, True)])
def test_a_window_that_tells_nothing_of_a_size_says_nothing_of_its_constancy(
    case: Case, monkeypatch: pytest.MonkeyPatch, least_told: float, same: bool
) -> None:
    """In one window a size changes a tenth of what it changes elsewhere, and would have to be large."""
    column = np.abs(case.column(2)) + 1.0
    column[3] *= 0.1
    residual = np.random.default_rng(3).normal(size=column.shape)
    residual[3] = column[3] / np.sqrt(np.mean(column[3] ** 2))
    winch_gain = next(c for c in case.library if c.effect.name == "winch_gain")
    fit = replace(case.fit, residual=residual, terms=(winch_gain.term((1.0,)),))
    test = replace(case, fit=fit).test()
    monkeypatch.setattr("flywheel.diagnosis.checks.adequacy.LEAST_TOLD", least_told)
    monkeypatch.setattr(case.model, "first_estimate", lambda terms: fit)
    left = adequacy(case.model, fit, test, column[..., None])
    assert (left.inconstancy < 1.0) == same
