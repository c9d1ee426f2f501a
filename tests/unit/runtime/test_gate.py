"""The gate: who becomes champion, and with which words."""

import math

import numpy as np
import pytest

from flywheel.results import ErrorNumbers, Errors, Navigation, Walk
from flywheel.runtime.config.parts import GateConfig
from flywheel.runtime.stages.gate import decide_champion
from tests import draws

GATE = GateConfig(error_ratio=1.05, success_drop=0.25)


def errors(rmse: float) -> Errors:
    return Errors(short=ErrorNumbers(e_pos_mse=1.0, e_pos_rmse=rmse, e_rot=3.0, windows=10))


def walks(reached: int, of: int) -> Navigation:
    each = [Walk(goal=(1, 0), reached=i < reached, seconds=9, distance=0) for i in range(of)]
    return Navigation(walks=tuple(each))


def decide(*arguments):
    return decide_champion(GATE, 2.0, *arguments)


def test_the_first_model_with_finite_errors_becomes_champion():
    decision = decide(errors(5.0), None)
    assert decision.promoted and decision.number == 5.0 and decision.reference is None
    assert decision.measure == "validation e_pos_rmse at 2 s [%]"


@pytest.mark.parametrize("candidate", [None, errors(math.nan), errors(math.inf)])
def test_a_model_without_finite_numbers_is_never_promoted(candidate):
    decision = decide(candidate, None)
    assert not decision.promoted
    assert "finite" in decision.reason


@pytest.mark.parametrize(
    ("new", "old", "promoted"), [(4, 5, True), (5.2, 5, True), (5.25, 5, True), (5.3, 5, False)]
)
def test_the_error_may_not_be_worse_than_the_ratio_allows(new, old, promoted):
    assert decide(errors(new), errors(old)).promoted is promoted


def by_episode(mse: np.ndarray) -> Errors:
    rmse = float(np.sqrt(100 * mse.mean()))
    episodes = {f"episode-{i}": float(x) for i, x in enumerate(mse)}
    short = ErrorNumbers(e_pos_mse=mse.mean(), e_pos_rmse=rmse, e_rot=3.0, windows=10 * len(mse))
    return Errors(short=short, by_episode=episodes)


def test_a_higher_error_that_few_episodes_cannot_prove_is_let_pass():
    rng = np.random.default_rng(draws.seed())
    champion = rng.uniform(0.9, 1.1, 12)  # more of a difference would prove it by chance
    scatter = np.where(np.arange(12) % 2, 3.0, 0.4) * champion  # 1.7 times the MSE, and all chance
    decision = decide(by_episode(scatter), by_episode(champion))
    assert decision.promoted and decision.low < 1.05 < decision.ratio < decision.high
    assert "is not clearly above" in decision.reason
    proven = decide(by_episode(1.7 * champion), by_episode(champion))
    assert not proven.promoted and proven.ratio == pytest.approx(np.sqrt(1.7))
    assert "is above the champion's" in proven.reason


def test_the_words_of_a_promotion_say_whether_the_error_fell():
    champion = np.random.default_rng(draws.seed()).uniform(0.5, 2.0, 12)
    assert "beats" in decide(by_episode(0.5 * champion), by_episode(champion)).reason
    assert "not clearly above" in decide(by_episode(champion), by_episode(champion)).reason
    chance = np.where(np.arange(12) % 2, 1.9, 0.01) * champion.mean()
    lower = decide(by_episode(chance), by_episode(np.full(12, champion.mean())))
    assert "is below the champion's, but not clearly" in lower.reason and lower.promoted


def test_only_episodes_that_both_were_scored_on_are_compared():
    champion = by_episode(np.full(4, 1.0))
    candidate = by_episode(np.array([1.0, 1.0, 1.0, 1.0, 100.0]))
    decision = decide(candidate, champion)
    assert (decision.ratio, decision.low, decision.high) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("new", "old"),
    [
        ([1.0], [4.0]),  # no telling how much of that is chance
        ([1.0, math.nan], [4.0, 4.0]),
        ([1.0, 1.0], [4.0, math.inf]),
        ([1.0, 1.0], [4.0, 0.0]),
        ([], []),
    ],
)
def test_without_errors_to_compare_of_two_episodes_the_totals_decide(new, old):
    """And nothing is said of chance."""
    better, worse = (
        errors(rmse).model_copy(update={"by_episode": dict(enumerate(mse))})
        for rmse, mse in ((4.0, new), (5.0, old))
    )
    decision = decide(better, worse)
    assert (decision.ratio, decision.low, decision.high) == (None, None, None)
    assert decision.promoted and decision.reason.startswith("Its error of 4 % beats")


def test_two_episodes_are_enough_to_tell_chance_from_more():
    decision = decide(by_episode(np.array([1.0, 4.0])), by_episode(np.array([4.0, 16.0])))
    assert (decision.ratio, decision.low, decision.high) == (0.5, 0.5, 0.5)
    assert "(0.50 times, 95 % interval 0.50 to 0.50) beats the champion's" in decision.reason


def test_a_decision_says_what_it_compared():
    decision = decide(errors(4.0), errors(5.0))
    assert (decision.number, decision.reference) == (4.0, 5.0)
    assert decision.measure == "validation e_pos_rmse at 2 s [%]"
    assert decision.reason == "Its error of 4 % beats the champion's 5 %."


def test_the_champions_own_weights_are_not_promoted_again():
    decision = decide_champion(GATE, 2.0, errors(5.0), errors(5.0), same=True)
    assert not decision.promoted and "no better weights" in decision.reason


def test_a_model_that_reaches_far_fewer_goals_is_not_promoted():
    better = errors(4.0), errors(5.0)
    assert decide(*better, walks(6, 8), walks(8, 8)).promoted
    refused = decide(*better, walks(5, 8), walks(8, 8))
    assert not refused.promoted and "38% lower" in refused.reason


def test_a_model_that_was_not_let_walk_where_the_champion_walked_is_not_promoted():
    refused = decide(errors(4.0), errors(5.0), walks(0, 0), walks(8, 8))
    assert not refused.promoted and "100% lower" in refused.reason


@pytest.mark.parametrize("champion", [None, walks(0, 0)])
def test_where_the_champion_did_not_walk_errors_alone_decide(champion):
    for new in (None, walks(0, 0), walks(0, 8)):
        assert decide(errors(4.0), errors(5.0), new, champion).promoted
    assert decide(errors(4.0), errors(5.0), None, walks(8, 8)).promoted


def test_a_champion_that_has_become_useless_is_beaten_by_any_finite_model():
    assert decide(errors(90.0), errors(math.nan)).promoted
