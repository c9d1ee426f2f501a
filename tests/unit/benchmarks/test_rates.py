"""Right and wrong answers are told apart, and counted."""

import math

import pytest

from benchmarks.diagnosis.case_result import CaseResult, Named
from benchmarks.diagnosis.case_row import CaseRow
from benchmarks.diagnosis.rates import summary


def friction(
    value: float, low: float = 0.0, high: float = 0.0, name: str = "cable_friction"
) -> Named:
    return Named(effect=name, values={"force": value}, low={"force": low}, high={"force": high})


def payload(at: str) -> Named:
    return Named(effect="payload", location=at, values={"mass": 1.0})


def case(truth: tuple[Named, ...], *answers: tuple[Named, ...], **more: object) -> CaseResult:
    common = {"name": "c", "group": "single", "robot": "prism3", "noise": 1.0, "held_out": 1.05}
    return CaseResult(**{**common, "truth": truth, "answers": answers, **more})


def test_a_right_answer_has_the_effect_the_place_the_size_and_the_interval() -> None:
    right = case((friction(100.0),), (friction(110.0, 95.0, 125.0),))
    assert right.first_is_right and right.contains_truth
    assert right.size_error == pytest.approx(0.1)
    assert right.covered == [True]


def test_the_order_of_effects_is_nothing() -> None:
    both = (friction(1.0), payload("s1"))
    assert case(both, (payload("s1"), friction(1.0))).first_is_right


def test_a_wrong_place_is_wrong_but_of_the_family() -> None:
    wrong = case((payload("s1"),), (payload("s2"),))
    assert not wrong.first_is_right
    assert wrong.family_is_right
    assert math.isnan(wrong.size_error)


def test_what_is_declared_the_same_is_the_same() -> None:
    late = Named(effect="sensor_latency", values={"time": 0.05})
    other = Named(effect="command_delay", values={"time": 0.05})
    assert case((late,), (other,)).first_is_right


def test_the_truth_may_be_the_second_answer() -> None:
    second = case((friction(1.0),), (payload("s1"),), (friction(1.0),))
    assert second.contains_truth and not second.first_is_right


def test_nothing_hidden_and_nothing_found_is_right() -> None:
    assert case((), (), verdict="NOISE_ONLY").first_is_right
    assert not case((), (friction(1.0),), verdict="EFFECT").first_is_right


def test_too_small_has_to_be_said_and_known() -> None:
    said = {"verdict": "NOISE_ONLY", "smallest": 3.0, "visible": 0.1}
    assert case((friction(1.0),), (), **said).said_unseen
    assert case((friction(1.0),), (), **said).right
    assert not case((friction(1.0),), (), **said | {"smallest": 0.3}).said_unseen
    assert not case((friction(1.0),), (), **said | {"visible": 2.0}).said_unseen


def test_lines_count_per_kind_and_in_all() -> None:
    results = [
        case((friction(100.0),), (friction(101.0, 90, 110),), verdict="EFFECT", seconds=2.0),
        case((friction(100.0),), (payload("s1"),), verdict="EFFECT", seconds=4.0),
        case((payload("s1"),), (payload("s1"),), verdict="AMBIGUOUS", held_out=2.0),
        case((), (), group="none", verdict="NOISE_ONLY"),
    ]
    lines = {line.what: line for line in summary([CaseRow.of(r) for r in results])}
    assert list(lines) == ["cable_friction", "payload", "all: single", "all: none"]
    assert lines["cable_friction"].first.value == 0.5
    assert lines["cable_friction"].seconds == 3.0
    assert lines["all: single"].cases == 3
    assert lines["all: single"].verdicts == {"EFFECT": 2, "AMBIGUOUS": 1}
    assert lines["all: single"].explained.value == 0.5
    assert lines["all: none"].first.value == 1.0


def test_results_survive_json() -> None:
    result = case((friction(100.0),), (friction(110.0, 95.0, 125.0),), verdict="EFFECT")
    again = CaseResult.model_validate_json(result.model_dump_json())
    assert again.model_dump_json() == result.model_dump_json()
