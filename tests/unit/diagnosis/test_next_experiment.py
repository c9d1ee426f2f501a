"""Which experiment a verdict asks for."""

import numpy as np
import pytest

from flywheel.diagnosis import Verdict
from flywheel.diagnosis.experiments.design import Rival
from flywheel.diagnosis.results.evidence import Evidence
from flywheel.diagnosis.results.next_experiment import NextExperiment, next_experiment
from flywheel.diagnosis.results.verdict import Alternative, found
from flywheel.diagnosis.selection.candidates import Candidate, candidates
from flywheel.diagnosis.selection.scores import Score
from flywheel.effects import EFFECTS
from flywheel.records import Floats
from flywheel.robots import Robot

NAMES = ("command_delay", "sensor_latency", "winch_gain", "weak_cable")


@pytest.fixture(scope="module")
def library(robot: Robot) -> dict[str, Candidate]:
    """The first place of each."""
    known: dict[str, Candidate] = {}
    for candidate in candidates(robot, {name: EFFECTS[name] for name in NAMES}):
        known.setdefault(candidate.effect.name, candidate)
    return known


def evidence(rivals: list[Candidate], likeness: Floats) -> Evidence:
    none = np.zeros((0, 1, 1, 3))
    return Evidence(
        *((), (), np.zeros(0, int), np.zeros(0, int), 0.01, 0.001, none, none > 0, none, none, ()),
        rivals=tuple(rivals),
        likeness=likeness,
        lags_before=np.zeros(0),
        lags_after=np.zeros(0),
        band=0.1,
    )


def asked(
    robot: Robot,
    library: dict[str, Candidate],
    verdict: Verdict,
    answers: list[list[str]],
    likeness: Floats | None = None,
    smallest: tuple[float, ...] = (0.1,) * len(NAMES),
) -> NextExperiment:
    def answer(names: list[str]) -> Alternative:
        terms = [library[name].term((1.0,) * len(library[name].typical)) for name in names]
        return tuple(
            found(t, np.zeros(len(t.values)), np.zeros(len(t.values)), robot) for t in terms
        )

    ranking = [
        Score(candidate, 0, 1.0, 1.0, (1.0,), size)
        for candidate, size in zip(library.values(), smallest, strict=True)
    ]
    seen = evidence(list(library.values()), np.eye(len(NAMES)) if likeness is None else likeness)
    return next_experiment(verdict, [answer(names) for names in answers], ranking, seen)


def test_alternatives_are_told_apart_and_what_they_share_is_not(robot, library):
    both = [["winch_gain", "weak_cable"], ["winch_gain", "command_delay"]]
    asks = asked(robot, library, Verdict.AMBIGUOUS, both)
    assert {rival.effect.name for rival in asks.rivals} == {"weak_cable", "command_delay"}
    place = library["weak_cable"].location
    assert asks.command == f"flywheel design weak_cable@{place} command_delay"


@pytest.mark.parametrize("verdict", [Verdict.AMBIGUOUS, Verdict.PARTIAL])
def test_no_commands_are_promised_for_twins(robot, library, verdict):
    alike = np.eye(len(NAMES))
    alike[0, 1] = alike[1, 0] = 0.9999
    twins = [["command_delay"], ["sensor_latency"]]
    asks = asked(robot, library, verdict, twins, alike)
    assert not asks.command and "0.9999" in asks.aim
    assert "only measuring one of them by itself" in asks.aim
    assert set(asks.shown_by) == {"command_delay", "sensor_latency"}


def test_an_answer_is_put_to_the_test_against_its_nearest_rival(robot, library):
    alike = np.eye(len(NAMES))
    alike[2, 3] = alike[3, 2] = 0.8
    asks = asked(robot, library, Verdict.EFFECT, [["winch_gain"]], alike)
    assert [rival.effect.name for rival in asks.rivals] == ["winch_gain", "weak_cable"]


def test_where_nothing_was_seen_it_names_what_could_not_have_been(robot, library):
    asks = asked(robot, library, Verdict.NOISE_ONLY, [[]], smallest=(0.2, 3.0, 0.5, 1.5))
    assert "sensor_latency, weak_cable." in asks.aim
    assert list(asks.shown_by) == ["sensor_latency", "weak_cable"]
    assert asks.command == ""


def test_the_rivals_are_written_as_design_takes_them(robot, library):
    for candidate in library.values():
        assert Rival.named(candidate.name, robot).candidates == (candidate,)
