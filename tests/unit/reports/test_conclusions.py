"""The sentences of a page follow from the numbers, also where they are bad news."""

import math

import pytest

from flywheel.reports.conclusions import conclusions, headline
from flywheel.results import Navigation, PooledTest, RobotScore, RunResult, Walk
from tests.unit.reports.fake_run import fake_errors, fake_iteration, fake_run, turnless


def navigation(reached, total=24):
    walks = [
        Walk(goal=(1.0, 0.0), reached=k < reached, seconds=30.0, distance=0.0) for k in range(total)
    ]
    return Navigation(walks=tuple(walks))


def two_iterations(levels, reached, pooled=True, finished=True):
    turns = []
    for k, (level, count) in enumerate(zip(levels, reached, strict=True)):
        changes = {"test": fake_errors(level), "navigation": navigation(count)}
        turns.append(fake_iteration(k).model_copy(update=changes))
    tests = [
        PooledTest(arm="mppi", iteration=t.iteration, model=t.model, errors=t.test) for t in turns
    ]
    return RunResult(
        name="r",
        key="k",
        iterations=tuple(turns),
        pooled=tuple(tests) if pooled else (),
        finished=finished,
    )


@pytest.mark.parametrize(
    ("levels", "reached", "error", "success"),
    [
        ((2.0, 1.0), (3, 20), "fell and", "success rose"),
        ((1.0, 2.0), (3, 20), "did not fall but", "success rose"),
        ((1.0, 2.0), (20, 3), "did not fall and", "success did not rise"),
        ((2.0, 1.0), (3, 3), "fell but", "success did not rise"),
        ((2.0, 1.0), (9, 12), "fell but", "it is undecided whether success rose"),
        ((2.0, 1.99), (3, 20), "did not fall but", "success rose"),
        ((2.0, math.nan), (3, 20), "did not fall but", "success rose"),
        ((2.0, 1.0), (0, 0), "fell but", "success did not rise"),
    ],
)
def test_the_headline_says_what_the_numbers_say(levels, reached, error, success):
    sentence = headline(two_iterations(levels, reached))
    assert f"prediction error {error}" in sentence
    assert success in sentence
    assert sentence.endswith(".")


def test_errors_on_different_episodes_decide_nothing():
    sentence = headline(two_iterations((2.0, 1.0), (3, 20), pooled=False, finished=False))
    assert "it is undecided whether the prediction error fell" in sentence
    assert "has not ended" in sentence
    worse = headline(two_iterations((1.0, 2.0), (3, 20), pooled=False))
    assert "did not fall" in worse


def test_a_run_without_two_iterations_claims_nothing():
    for run in (RunResult(name="r", key="k"), fake_run(1)):
        assert "nothing to compare" in headline(run)
        assert conclusions(run) == []


def test_a_control_arm_that_is_as_good_takes_the_credit_away():
    run = fake_run(2)
    ours = next(i for i in run.iterations if (i.arm, i.iteration) == ("mppi", 1))
    copied = [
        i.model_copy(update={"test": ours.test, "navigation": ours.navigation})
        if i.arm == "control"
        else i
        for i in run.iterations
    ]
    same = run.model_copy(update={"iterations": tuple(copied), "pooled": ()})
    control = next(v for v in conclusions(same) if "random controls" in v.text)
    assert control.answer == "no"
    assert next(v for v in conclusions(run) if "random controls" in v.text).answer == "yes"


def test_floor_and_oracle_are_judged_by_the_goals_as_ratios():
    run = two_iterations((2.0, 1.0), (3, 20))
    near = run.model_copy(update={"floor": fake_errors(0.95), "oracle": navigation(24)})
    far = run.model_copy(update={"floor": fake_errors(0.5), "oracle": navigation(24)})
    floors = [next(v for v in conclusions(r) if "floor" in v.text) for r in (near, far)]
    assert [verdict.answer for verdict in floors] == ["yes", "no"]
    assert "1.05 times" in floors[0].text and "2.00 times" in floors[1].text
    oracle = next(v for v in conclusions(near) if "oracle" in v.text)
    assert oracle.answer == "yes" and "83%" in oracle.text
    helpless = run.model_copy(update={"oracle": navigation(0)})
    assert next(v for v in conclusions(helpless) if "oracle" in v.text).answer == "open"


def test_a_robot_that_shows_no_rotation_is_judged_by_positions():
    run = fake_run(2)
    whole, half = conclusions(run), conclusions(turnless(run))
    assert len(whole) == len(half)
    assert not any("nan" in each.text or "rotation" in each.text for each in half)
    assert "position error (RMSE/L)" in " ".join(each.text for each in half)
    assert headline(turnless(run)).split(",")[1] == headline(run).split(",")[1]


@pytest.mark.parametrize(
    ("levels", "answer", "words"),
    [
        ((3.0, 2.0, 1.0), "yes", "fell in every iteration: 15.00, 10.00, 5.00 %."),
        ((3.0, 1.0, 2.0), "open", "fell, but not in every iteration: 15.00, 5.00, 10.00 %."),
        ((1.0, 0.99), "no", "did not fall: 5.00, 4.95 %."),
        ((1.0, math.nan), "no", "did not fall"),
    ],
)
def test_a_page_says_whether_the_network_gets_better_on_the_robot(levels, answer, words):
    unit = fake_errors(1.0)

    def scored(level):
        short = unit.short.model_copy(update={"e_pos_rmse": 5.0 * level})
        return unit.model_copy(update={"short": short})

    rows = [
        RobotScore(iteration=i, model=model, minutes=1.0 + i, errors=scored(level))
        for i, level in enumerate(levels)
        for model in ("network", "plant", "given")
    ]
    run = fake_run(len(levels)).model_copy(update={"on_robot": tuple(rows)})
    found = next(v for v in conclusions(run) if "network's error on the robot" in v.text)
    assert found.answer == answer and words in found.text
    assert found.text in headline(run)


def test_a_change_of_nearly_nothing_has_no_minus():
    (first, *_) = conclusions(two_iterations((2.0, 1.9999), (3, 3)))
    assert "(+0.0%)" in first.text and "-0.0" not in first.text
