from pathlib import Path

import numpy as np
import pytest

from flywheel.diagnosis import Verdict, diagnose, judgement
from flywheel.diagnosis.fitting.least_squares import Fit
from flywheel.diagnosis.heartbeat import (
    GRACE,
    MOST_KEPT,
    PHASES,
    SECONDS,
    WEIGHTS,
    Heartbeat,
    Interrupted,
)
from flywheel.diagnosis.results.answer import Answer
from flywheel.diagnosis.selection.scores import ScoredModel
from flywheel.diagnosis.selection.search import Search
from flywheel.diagnosis.settings import changed
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term, Terms
from flywheel.errors import DataError
from flywheel.reports.diagnosis_page import diagnosis_page, sentence
from flywheel.robots import load_robot
from tests import draws
from tests.unit.diagnosis.conftest import QUICK, recorded


def test_what_goes_on_is_said_again_but_not_all_the_time() -> None:
    now, told = [0.0], []
    heartbeat = Heartbeat(lambda share, note: told.append(note), lambda: now[0])
    for _ in range(10):
        heartbeat.again()
        now[0] += SECONDS / 4
    assert told == ["beginning"] * 2
    heartbeat("fitting")
    heartbeat.again()
    now[0] += SECONDS
    heartbeat.again()
    assert told[2:] == ["fitting", "fitting"]


def test_who_is_to_stop_hears_of_it_once() -> None:
    """What is left to be done must come to its end."""
    told: list[str] = []
    asked = iter([False, True])
    heartbeat = Heartbeat(lambda share, note: told.append(note), lambda: 0.0, lambda: next(asked))
    heartbeat.again()
    assert not heartbeat.stopped()
    with pytest.raises(Interrupted):
        heartbeat.again()
    heartbeat.again()
    assert heartbeat.stopped()
    assert len(told) == 1


def test_when_time_is_up_what_is_left_is_done_briefly_or_not_at_all_and_what_must_be_is() -> None:
    now = [0.0]
    heartbeat = Heartbeat(clock=lambda: now[0], seconds=100.0)

    def takes(seconds: float) -> str:
        for _ in range(10):
            now[0] += seconds / 10
            heartbeat.again()
        return "done"

    heartbeat.keep(60.0)  # no more than a part of it is
    search = 100.0 * (1.0 - MOST_KEPT)
    assert heartbeat.in_time(lambda: takes(0.9 * search), "not done") == "done"
    assert heartbeat.in_time(lambda: takes(search), "not done") == "not done"
    assert search <= now[0] <= 1.1 * search
    begun = now[0]
    assert heartbeat.in_time(lambda: takes(1.0), "not begun") == "not begun"
    assert now[0] == begun
    assert heartbeat.briefly(lambda: takes(100.0 - begun), "not done") == "done"
    assert heartbeat.insisted(lambda: takes(GRACE)) == "done"
    assert heartbeat.briefly(lambda: takes(GRACE), "not done") == "not done"
    with pytest.raises(Interrupted):
        heartbeat.in_grace(lambda: takes(GRACE))


def test_the_time_left_comes_from_how_long_the_phases_of_this_search_took() -> None:
    now, told = [0.0], []
    heartbeat = Heartbeat(lambda share, note: told.append(share), lambda: now[0])
    lefts = []
    for seconds, name in ((10.0, "score"), (5.0, "search"), (0.0, "")):
        now[0] += seconds
        if name:
            heartbeat.phase(name)
        lefts.append(heartbeat.left())
    rest = {name: 10.0 * weight for name, weight in WEIGHTS.items()}
    ahead = rest["search"] + rest["judge"] + rest["conclude"]
    assert lefts == pytest.approx([rest["score"] + ahead, ahead, ahead])
    now[0] += rest["search"] / 2
    assert heartbeat.left() == pytest.approx(ahead - rest["search"] / 2)
    now[0] += 10 * rest["search"]  # later than expected, it moves on
    late = heartbeat.left()
    now[0] += 60.0
    assert heartbeat.left() > late
    heartbeat.phase("fit", *PHASES[1:])  # begun anew, it takes as long as it took
    took = now[0] - 15.0
    assert heartbeat.left() > 15.0 + took
    heartbeat("fitting")
    assert told[-1] == pytest.approx(now[0] / (now[0] + heartbeat.left()))
    limited = Heartbeat(clock=lambda: now[0], seconds=30.0)
    now[0] += 10.0
    assert limited.left() == pytest.approx(20.0)


def test_a_part_that_fails_costs_itself_and_is_remembered() -> None:
    heartbeat = Heartbeat()

    def share(part: int) -> float | None:
        return None if part == 3 else 1.0 / part

    assert heartbeat.each(share, [2, 0, 3, 4], "part {}".format) == [0.5, 0.25]
    (failure,) = heartbeat.failures
    assert failure.what == "part 0"
    assert failure.error == "ZeroDivisionError: float division by zero"
    assert failure.at.startswith(f"{Path(__file__).name}:") and "share" in failure.at


def test_a_bug_in_one_rival_costs_that_rival_and_not_the_answer(monkeypatch):
    robot = load_robot("platform4")
    log = recorded(robot, (Term(EFFECTS["winch_gain"], None, (0.3,)),), draws.seed())
    few = {name: EFFECTS[name] for name in ("slope", "winch_gain")}
    begun = Search.warm_start

    def broken(self: Search, model: ScoredModel, terms: Terms) -> Fit:
        if terms[-1].effect.name == "slope":
            raise ZeroDivisionError("of this rival")
        return begun(self, model, terms)

    def no_gains(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of a stage")

    monkeypatch.setattr(Search, "warm_start", broken)
    monkeypatch.setattr(judgement, "with_gains", no_gains)
    everything = changed(QUICK, {"selection.share": 1e-9})
    answer = diagnose(Plant(robot), [log], (), few, everything)
    assert [each.effect for each in answer.answers[0]] == ["winch_gain"]
    lost = {each.what for each in answer.failures}
    assert {"fitting slope", "judging the answer: gains on other windows"} <= lost
    assert {each["error"] for each in answer.summary()["failures"]} == {
        "ZeroDivisionError: of this rival",
        "ZeroDivisionError: of a stage",
    }
    assert "of this rival" in diagnosis_page(answer, {})


@pytest.mark.slow
@pytest.mark.parametrize("found", [False, True])
def test_who_is_stopped_gives_the_best_answer_so_far(found: bool) -> None:
    """Interrupted while the first effect is fitted, or as soon as there is one."""
    robot = load_robot("platform4")
    hidden = (Term(EFFECTS["winch_gain"], None, (0.3,)),)
    log = recorded(robot, hidden, draws.seed())
    few = {name: EFFECTS[name] for name in ("slope", "winch_gain")}
    told: list[str] = []

    def stop() -> bool:
        fitted = next((k for k, each in enumerate(told) if each.startswith("fitting")), len(told))
        return any(each.startswith("scored" if found else "fitting") for each in told[fitted:])

    answer = diagnose(
        Plant(robot),
        [log],
        [log],
        few,
        QUICK,
        progress=lambda share, note: told.append(note),
        stop=stop,
    )
    assert answer.interrupted
    assert answer.exit_code == 130
    assert [each.effect for each in answer.answers[0]] == ["winch_gain"] * found
    # Before anything was fitted, nobody knows what is missing.
    assert answer.verdict is (Verdict.EFFECT if found else Verdict.NOT_CONVERGED)
    assert ("stopped before it knew" in sentence(answer)) is not found
    assert ("more time" in answer.next_experiment.aim) is not found
    assert answer.held_out is not None
    assert "best answer so far" in diagnosis_page(answer, {})
    adopted = Answer.of(answer.summary())
    assert not adopted.is_clear
    if found:
        with pytest.raises(DataError, match="interrupted"):
            adopted.chosen(None)
        assert adopted.chosen(1)


def test_who_is_stopped_before_anything_is_known_has_no_answer() -> None:
    robot = load_robot("platform4")
    log = recorded(robot, (), draws.seed())
    with pytest.raises(KeyboardInterrupt):
        diagnose(Plant(robot), [log], stop=lambda: True)


@pytest.mark.slow
def test_no_part_of_a_diagnosis_is_silent_for_long(monkeypatch) -> None:
    """Who waits for it takes silence for death. Counted in simulations, not in seconds."""
    steps: list[int] = []
    monkeypatch.setattr(Heartbeat, "again", lambda self: steps.append(len(told)))
    told: list[str] = []
    robot, rng = load_robot("prism3"), np.random.default_rng(draws.seed())
    plant = Plant(robot)
    controls = np.repeat(rng.uniform(-0.5, 0.5, (4, 6)), 25, axis=0)
    track = plant.simulate(plant.settle(1.0), controls[None])
    seen = track.observations.points[0] + rng.normal(size=track.observations.points[0].shape) * 0.01
    log = type(track)(type(track.observations)(seen, np.full((101, 6), np.nan)), controls, track.dt)
    few = {name: EFFECTS[name] for name in ("slope", "winch_gain")}
    diagnose(plant, [log], [log], few, QUICK, progress=lambda share, note: told.append(note))
    assert told
    assert len(steps) > 20
    assert steps[-1] == len(told)  # also after the last note: what is held out is simulated, too
    assert SECONDS < 60
