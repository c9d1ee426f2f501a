"""What is said of a diagnosis once it is known what was hidden."""

import numpy as np
import pytest

from flywheel.demo.assessment import RIGHT, Naming, assess, library_values
from flywheel.diagnosis import Verdict
from flywheel.robots import load_robot
from flywheel.truth_simulator import HIDDEN, EffectTruth

CREEP, WEAK = ("creep", ""), ("weak_cable", "long_03")
PAYLOAD, DELAY, LATENCY = ("payload", "s2"), ("command_delay", ""), ("sensor_latency", "")


def truth(named: tuple[str, str]) -> EffectTruth:
    return EffectTruth(*named, values={}, units={})


@pytest.mark.parametrize(
    ("hidden", "verdict", "answers", "outcome", "words"),
    [
        (CREEP, Verdict.EFFECT, [[CREEP]], Naming.NAMED, "creep, and it was named."),
        (LATENCY, Verdict.EFFECT, [[DELAY]], Naming.NAMED, "which makes the same motion"),
        (WEAK, Verdict.AMBIGUOUS, [[PAYLOAD], [WEAK]], Naming.AMONG, "payload at s2; or weak_cable"),
        (DELAY, Verdict.AMBIGUOUS, [[DELAY], [LATENCY]], Naming.AMONG, "cannot distinguish"),
        (CREEP, Verdict.EFFECT, [[CREEP, PAYLOAD]], Naming.BESIDE, "together with payload at s2"),
        (CREEP, Verdict.PARTIAL, [[CREEP]], Naming.BESIDE, "something else is missing as well"),
        (CREEP, Verdict.AMBIGUOUS, [[WEAK], [CREEP, WEAK]], Naming.BESIDE, "with weak_cable at"),
        (CREEP, Verdict.EFFECT, [[WEAK]], Naming.NOT_NAMED, "weak_cable at long_03 was named instead."),
        (WEAK, Verdict.EFFECT, [[("weak_cable", "long_14")]], Naming.NOT_NAMED, "only the place is wrong"),
        (CREEP, Verdict.OUTSIDE_LIBRARY, [[CREEP]], Naming.NOT_NAMED, "most like creep"),
        (CREEP, Verdict.OUTSIDE_LIBRARY, [[]], Naming.NOT_NAMED, "none of the library's effects."),
        (CREEP, Verdict.NOISE_ONLY, [[]], Naming.NOT_NAMED, "nothing beyond noise was found"),
        (CREEP, Verdict.NOT_CONVERGED, [], Naming.NOT_NAMED, "no fit was found"),
        (None, Verdict.NOISE_ONLY, [[]], Naming.NOTHING, "and nothing was named."),
        (None, Verdict.EFFECT, [[CREEP]], Naming.FALSE_ALARM, "creep was named"),
        (None, Verdict.OUTSIDE_LIBRARY, [[]], Naming.FALSE_ALARM, "said to be missing"),
        (("cogging", ""), Verdict.OUTSIDE_LIBRARY, [[CREEP]], Naming.OUTSIDE, "as the answer says"),
        (("cogging", ""), Verdict.PARTIAL, [[CREEP]], Naming.BESIDE, "creep was named as well"),
        (("cogging", ""), Verdict.EFFECT, [[CREEP]], Naming.NOT_NAMED, "it was taken for creep"),
        (("cogging", ""), Verdict.NOISE_ONLY, [[]], Naming.NOT_NAMED, "nothing was found"),
    ],
)  # fmt: skip
def test_it_says_in_one_sentence_whether_the_hidden_effect_was_found(
    hidden: tuple[str, str] | None,
    verdict: Verdict,
    answers: list[list[tuple[str, str]]],
    outcome: Naming,
    words: str,
) -> None:
    said = assess(None if hidden is None else truth(hidden), verdict, answers)
    assert said.outcome is outcome
    assert words in said.sentence
    assert said.sentence.endswith(".") and said.sentence.count(". ") == 0
    assert ("hidden" in said.sentence.lower()) and (hidden is None or hidden[0] in said.sentence)


def test_what_could_not_be_seen_is_said_to_be_too_small() -> None:
    said = assess(truth(CREEP), Verdict.NOISE_ONLY, [[]], smallest=2.5)
    assert "from 2.5 times its size on" in said.sentence
    large = assess(truth(CREEP), Verdict.NOISE_ONLY, [[]], smallest=0.4)
    assert "beyond noise" in large.sentence
    assert said.outcome is large.outcome is Naming.NOT_NAMED


def test_only_what_is_right_counts_as_right() -> None:
    assert set(Naming) - set(RIGHT) == {Naming.BESIDE, Naming.NOT_NAMED, Naming.FALSE_ALARM}


def test_values_have_the_names_of_the_library() -> None:
    robot = load_robot("prism3")
    hidden = HIDDEN["hysteresis"].typical(robot, np.random.default_rng(0)).truth(robot)
    values = library_values(hidden)
    assert values.keys() == {"force", "length"}
    assert values["force"] == pytest.approx(hidden.values["stiffness"] * hidden.values["length"])
