"""What no model explains, as a scale of error beside noise."""

import numpy as np
import pytest

from flywheel.diagnosis import Verdict, diagnose
from flywheel.diagnosis.checks.model_discrepancy import long_run_variance
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.heartbeat import Heartbeat
from flywheel.diagnosis.settings import changed
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.reports.diagnosis_page import diagnosis_page, scale
from flywheel.robots import Robot, load_robot
from tests import draws
from tests.unit.diagnosis.conftest import QUICK, recorded
from tests.unit.diagnosis.test_unexplained import HIDDEN

SERIES, LENGTH = 400, 200


@pytest.mark.parametrize("follows", [0.0, 0.5, 0.8])
def test_the_long_run_variance_of_what_follows_itself(follows: float) -> None:
    """Of an autoregression it is known: that of its shocks over (1 - a)^2."""
    rng = np.random.default_rng(draws.seed())
    shocks = rng.normal(size=(SERIES, LENGTH))
    series = np.zeros_like(shocks)
    series[:, 0] = shocks[:, 0] / np.sqrt(1.0 - follows**2)
    for step in range(1, LENGTH):
        series[:, step] = follows * series[:, step - 1] + shocks[:, step]
    expected = 1.0 / (1.0 - follows) ** 2
    found = long_run_variance(series, np.ones(series.shape, bool))
    assert found == pytest.approx(expected, rel=0.2)
    gaps = rng.random(series.shape) < 0.9  # what is not known tells nothing, and is not counted
    some = long_run_variance(np.where(gaps, series, 0.0), gaps)
    assert some == pytest.approx(
        1.0 / (1.0 - follows**2) + 0.9 * (expected - 1 / (1 - follows**2)), rel=0.2
    )


def test_noise_stays_what_it_is_beside_a_discrepancy(windows: Windows) -> None:
    both = windows.with_discrepancy(3.0 * windows.sigma)
    assert both.noise == pytest.approx(windows.sigma)
    assert both.sigma == pytest.approx(np.sqrt(10.0) * windows.sigma)
    assert both.with_discrepancy(0.0).sigma == pytest.approx(windows.sigma)


@pytest.fixture(scope="module")
def platform() -> Robot:
    """The smallest one."""
    return load_robot("platform4")


@pytest.mark.slow
def test_what_is_left_beside_a_scale_of_its_own_is_left_all_the_same(platform: Robot) -> None:
    """Noise of a twentieth of a millimetre, and a law that the library does not have: all would be sure."""
    logs = [recorded(platform, HIDDEN, draws.seed(), noise=5e-5) for _ in range(2)]
    few = {name: NAMED[name] for name in ("winch_gain", "slope")}
    answer = diagnose(Plant(platform), logs, (), few, QUICK)
    assert answer.verdict in (Verdict.PARTIAL, Verdict.OUTSIDE_LIBRARY)
    assert answer.model_discrepancy > answer.after.beyond_noise > answer.errors.noise
    assert answer.errors.noise < 1e-4
    assert answer.location is not None
    assert scale(answer) in diagnosis_page(answer, {})
    assert answer.summary()["model_discrepancy"]["value"] == answer.model_discrepancy


def test_what_is_tolerated_gets_no_scale_of_its_own(platform: Robot) -> None:
    log = recorded(platform, HIDDEN, draws.seed(), noise=5e-5)
    tolerant = changed(QUICK, {"limits.tolerance": 0.05})
    few = {"winch_gain": NAMED["winch_gain"]}
    answer = diagnose(Plant(platform), [log], (), few, tolerant)
    assert answer.verdict is Verdict.NOISE_ONLY
    assert answer.model_discrepancy == 0.0
    assert answer.after.beyond_noise > 2.0 * answer.errors.noise


@pytest.mark.slow
def test_a_repetition_that_is_stopped_loses_nothing(platform: Robot, monkeypatch) -> None:
    hidden = (*HIDDEN, Term(NAMED["winch_gain"], None, (0.3,)))
    log, notes, said = recorded(platform, hidden, draws.seed(), noise=5e-5), [], Heartbeat.__call__

    def noted(self: Heartbeat, note: str) -> None:
        notes.append(note)
        said(self, note)

    def in_the_repetition() -> bool:
        begun = [i for i, note in enumerate(notes) if "repeating" in note]
        return bool(begun) and any(note.startswith("fitting") for note in notes[begun[0] :])

    monkeypatch.setattr(Heartbeat, "__call__", noted)
    few = {"winch_gain": NAMED["winch_gain"]}
    answer = diagnose(Plant(platform), [log], (), few, QUICK, stop=in_the_repetition)
    assert answer.interrupted
    assert [found.term.effect.name for found in answer.answers[0]] == ["winch_gain"]
    assert answer.verdict is not Verdict.NOT_CONVERGED
    assert answer.errors.augmented < 0.8 * answer.errors.baseline


@pytest.mark.slow
def test_what_the_library_explains_counts_in_noise(platform: Robot) -> None:
    log = recorded(platform, (Term(NAMED["winch_gain"], None, (0.3,)),), draws.seed())
    answer = diagnose(Plant(platform), [log], (), {"winch_gain": NAMED["winch_gain"]}, QUICK)
    assert answer.verdict is Verdict.EFFECT
    assert answer.model_discrepancy == 0.0
    assert scale(answer) == ""
