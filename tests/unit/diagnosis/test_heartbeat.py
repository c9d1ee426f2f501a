from __future__ import annotations

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.heartbeat import SECONDS, Heartbeat, Interrupted
from flywheel.diagnosis.results.answer import Answer
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS, Term
from flywheel.errors import DataError
from flywheel.reports.diagnosis_page import diagnosis_page
from flywheel.robots import load_robot
from tests import draws
from tests.unit.diagnosis.conftest import QUICK, recorded


def test_what_goes_on_is_said_again_but_not_all_the_time() -> None:
    now, told = [0.0], []
    heartbeat = Heartbeat(told.append, lambda: now[0])
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
    heartbeat = Heartbeat(told.append, lambda: 0.0, lambda: next(asked))
    heartbeat.again()
    assert not heartbeat.stopped()
    with pytest.raises(Interrupted):
        heartbeat.again()
    heartbeat.again()
    assert heartbeat.stopped()
    assert len(told) == 1


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

    answer = diagnose(Plant(robot), [log], [log], few, QUICK, progress=told.append, stop=stop)
    assert answer.interrupted
    assert answer.exit_code == 130
    assert [each.effect for each in answer.answers[0]] == ["winch_gain"] * found
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
    diagnose(plant, [log], [log], few, QUICK, progress=told.append)
    assert told
    assert len(steps) > 20
    assert steps[-1] == len(told)  # also after the last note: what is held out is simulated, too
    assert SECONDS < 60
