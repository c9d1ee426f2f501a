"""Recordings on which answers are only judged."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import diagnose
from flywheel.diagnosis.checks import held_out
from flywheel.diagnosis.checks.held_out import HeldOut
from flywheel.diagnosis.fitting.least_squares import Fit, Fitter
from flywheel.diagnosis.fitting.model import ModelUnderTest
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term, Terms
from flywheel.errors import DataError
from flywheel.records import Trajectory
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

ROBOT = "platform4"


@pytest.mark.slow
def test_a_model_with_more_begins_where_the_one_before_ended(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    gain = Term(NAMED["winch_gain"], None, (float(rng.uniform(0.2, 0.4)),))
    idle = Term(NAMED["slope"], None, (0.0, 0.0))
    log = recorded(robot, (gain,), seed)
    windows = Windows.cut(robot, [log], seconds=0.4)
    judge = HeldOut(ModelUnderTest(Plant(robot), None, seed), [log], windows)
    one = judge.errors((gain,))
    more = judge.errors((gain, idle))
    assert one is not None and more is not None
    assert one.augmented < one.baseline, seed
    assert more.baseline == one.baseline, seed
    # What does nothing can but find better initial states; priors count in the cost, and not in this.
    assert more.augmented < 1.001 * one.augmented, seed
    # Another model is fitted by itself, whatever was judged before.
    worse = Term(gain.effect, None, tuple(-value for value in gain.values))
    alone = HeldOut(ModelUnderTest(Plant(robot), None, seed), [log], windows)
    assert judge.errors((worse,)) == alone.errors((worse,)), seed


@pytest.mark.slow
def test_a_window_that_is_stuck_begins_elsewhere_before_it_is_judged(robot, seed, monkeypatch):
    gain = Term(NAMED["winch_gain"], None, (0.2,))
    log = recorded(robot, (gain,), seed)
    windows = Windows.cut(robot, [log], seconds=0.4)

    def augmented() -> float:
        found = HeldOut(ModelUnderTest(Plant(robot), None, seed), [log], windows).errors((gain,))
        assert found is not None
        return found.augmented

    right, fitted = augmented(), held_out.fitted_and_refined

    def stuck(*asked: Any) -> Any:
        fitter, fit = fitted(*asked)
        local = fit.local.copy()
        local[0, :3] += 0.3  # the platform is somewhere else
        off = fitter.with_local(fit, local)
        assert fitter.rms(off) > 3 * right
        return fitter, off

    monkeypatch.setattr(held_out, "fitted_and_refined", stuck)
    assert augmented() == pytest.approx(right, rel=0.05), seed


def test_a_model_that_is_clearly_wrong_begins_elsewhere_once(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As its first fit asks for. One that may be right does so wherever a window is loud."""
    gain = Term(NAMED["winch_gain"], None, (0.3,))
    begun: list[Terms] = []

    def elsewhere(fitter: Fitter, fit: Fit, seed: int) -> Fit:
        begun.append(fit.terms)
        return fit

    monkeypatch.setattr(held_out, "restarted_where_loud", elsewhere)
    for hidden, expected in (((gain,), [(gain,)]), ((), [()])):
        log = recorded(robot, hidden, 2)
        windows = Windows.cut(robot, [log], seconds=0.4)
        HeldOut(ModelUnderTest(Plant(robot), None, 0), [log], windows).errors(hidden)
        assert begun == expected
        begun.clear()


def test_without_recordings_nothing_is_judged(robot: Robot, windows: Windows, seed: int) -> None:
    assert HeldOut(ModelUnderTest(Plant(robot), None, seed), (), windows).errors(()) is None


def blind(log: Trajectory) -> Trajectory:
    """Hardly anything was seen."""
    points = log.observations.points.copy()
    points[1:] = np.nan
    return replace(log, observations=replace(log.observations, points=points))


@pytest.mark.parametrize(
    "wrong, said",
    [
        (lambda log: replace(log, dt=2 * log.dt), "in control steps of 0.02 s"),
        (blind, "No window has 10% of its points measured"),
    ],
)
def test_recordings_that_cannot_be_judged_by_are_refused_before_the_search(
    robot: Robot, seed: int, wrong: Callable[[Trajectory], Trajectory], said: str
) -> None:
    notes: list[str] = []
    log = recorded(robot, (), seed)
    with pytest.raises(DataError, match=f"Held-out recordings: .*{said}"):
        diagnose(Plant(robot), [log], [wrong(log)], progress=lambda share, note: notes.append(note))
    assert not notes, seed
