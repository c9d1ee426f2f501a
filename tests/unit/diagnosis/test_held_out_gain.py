"""What effects are worth on windows that they were not fitted to."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis.checks import held_out_gain
from flywheel.diagnosis.checks.held_out_gain import Gain, UnseenWindows, left_out_squares
from flywheel.diagnosis.results.verdict import worth_having
from flywheel.diagnosis.settings import Limits
from tests.unit.diagnosis.test_scores import LOCAL, WINDOWS, Case, case  # noqa: F401

VALUES = 2


@pytest.mark.parametrize("prior", [np.inf, 0.3])
def test_a_window_left_out_is_predicted_as_a_fit_of_the_others_predicts_it(
    case: Case,  # noqa: F811
    prior: float,
) -> None:
    """By brute force: the values fitted to all other windows, and then its local parameters."""
    rng = np.random.default_rng(4)
    seen = np.isfinite(case.model.windows.measured).reshape(WINDOWS, -1, 1)
    columns = rng.normal(size=(WINDOWS, seen.shape[1], VALUES)) * seen
    data = (3.0 * rng.normal(size=seen.shape) + columns @ [[2.0], [-1.0]]) * seen
    own = case.model.by_local
    left = [np.eye(len(j)) - j @ np.linalg.pinv(j) for j in own]
    known = 1.0 / min(held_out_gain.WIDE, prior) ** 2

    def fitted(windows: list[int]) -> np.ndarray:
        gram = sum(columns[k].T @ left[k] @ columns[k] for k in windows) + known * np.eye(VALUES)
        right = sum(columns[k].T @ left[k] @ data[k] for k in windows)
        return np.asarray(np.linalg.solve(gram, right))

    values = rng.normal(size=(VALUES, 1))  # wherever a fit has come to
    model = replace(
        case.model,
        local_prior=np.full(LOCAL, 1e6),
        by_winch=np.zeros_like(case.model.by_winch),
    )
    free: Any = [SimpleNamespace(prior=prior, value=lambda _, v=v: v) for v in values[:, 0]]
    model.free = lambda terms: free  # type: ignore[method-assign]
    fit = replace(case.fit, residual=(data - columns @ values)[..., 0])
    squares = left_out_squares(model, fit, model.jacobian(fit), columns)
    measured = seen.sum(axis=(1, 2))
    for k in range(WINDOWS):
        others = fitted([each for each in range(WINDOWS) if each != k])
        off = left[k] @ (data[k] - columns[k] @ others)
        assert squares[k] == pytest.approx(float((off**2).sum()) - (measured[k] - LOCAL), rel=1e-6)


def gains_of(first: Any, without: Any, model: Any, held_out: int = 0) -> Gain:
    """Of these squares beyond noise."""
    return held_out_gain._gain(np.asarray(first), without - model, held_out, seed=0)


def test_a_gain_is_clear_where_most_windows_agree() -> None:
    first = np.full(12, 100.0)
    everywhere = gains_of(first, first, np.full(12, 40.0), held_out=3)
    assert everywhere.share == everywhere.low == everywhere.high == pytest.approx(0.6)
    assert (everywhere.windows, everywhere.held_out) == (12, 3)
    assert everywhere.clear
    # Windows without an error tell nothing, and take nothing away from what the others tell.
    few = gains_of([-20.0, 220.0], np.array([-20.0, 220.0]), np.array([-21.0, 1.0]))
    assert few.clear
    assert 0.0 < few.low < few.share <= few.high < 4.0
    one = gains_of(first, first, np.r_[np.full(11, 101.0), 20.0])
    assert one.share == pytest.approx(69.0 / 1200.0)
    assert one.low < 0.0 < one.high
    assert not one.clear


def test_nothing_is_gained_of_nothing() -> None:
    """Where the model as it was leaves nothing beyond noise, or one of the two diverged, nobody knows."""
    for first, model in ((np.zeros(4), np.ones(4)), (np.ones(4), np.full(4, np.inf))):
        gain = gains_of(first, np.ones(4), np.asarray(model))
        assert not gain.clear
        assert gain.summary()["share"] is None


@pytest.mark.parametrize(("bare", "share"), [(50.0, 0.4), (300.0, 0.9)])
def test_numbers_that_harm_where_they_were_not_fitted_make_no_effect_look_better(
    bare: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside them it would gain more than there is."""
    left = {"first": 100.0, "bare": bare, "model": 10.0}

    def model(name: str) -> Any:
        return SimpleNamespace(fit=SimpleNamespace(terms=name))

    held_out: Any = SimpleNamespace(squares=lambda terms: np.full(3, left[terms]))
    fitter: Any = SimpleNamespace(windows=range(4))
    unseen = UnseenWindows(fitter, model("first"), held_out)
    monkeypatch.setattr(unseen, "_left_out", lambda each: np.full(4, left[each.fit.terms]))
    gain = unseen.gain_everywhere(model("bare"), model("model"))
    assert gain.share == pytest.approx(share) and (gain.windows, gain.held_out) == (7, 3)


@pytest.mark.parametrize(
    ("share", "clear", "worth"), [(0.5, True, True), (0.5, False, False), (0.05, True, False)]
)
def test_a_part_of_what_is_missing_takes_away_enough_of_it(share, clear, worth):
    assert worth_having(Limits(), Gain(share, 0.01, 0.9, clear, 10, 0)) is worth
