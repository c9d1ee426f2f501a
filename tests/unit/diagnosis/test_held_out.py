"""Recordings on which answers are only judged."""

from __future__ import annotations

import numpy as np

from flywheel.diagnosis.held_out import HeldOut
from flywheel.diagnosis.under_test import UnderTest
from flywheel.diagnosis.windows import Windows
from flywheel.dynamics.plant import Plant
from flywheel.effects import NAMED, Term
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded


def test_a_model_with_more_begins_where_the_one_before_ended(robot: Robot, seed: int) -> None:
    rng = np.random.default_rng(seed)
    gain = Term(NAMED["winch_gain"], None, (float(rng.uniform(0.2, 0.4)),))
    idle = Term(NAMED["slope"], None, (0.0, 0.0))
    log = recorded(robot, (gain,), seed)
    windows = Windows.cut(robot, [log], seconds=0.4)
    judge = HeldOut(UnderTest(Plant(robot), None, seed), [log], windows)
    one = judge.errors((gain,))
    more = judge.errors((gain, idle))
    assert one is not None and more is not None
    assert one.augmented < one.baseline, seed
    assert more.baseline == one.baseline, seed
    # What does nothing can but find better starts; priors count in the cost, and not in this.
    assert more.augmented < 1.001 * one.augmented, seed
    # Another model is fitted by itself, whatever was judged before.
    worse = Term(gain.effect, None, tuple(-value for value in gain.values))
    alone = HeldOut(UnderTest(Plant(robot), None, seed), [log], windows)
    assert judge.errors((worse,)) == alone.errors((worse,)), seed


def test_without_recordings_nothing_is_judged(robot: Robot, windows: Windows, seed: int) -> None:
    assert HeldOut(UnderTest(Plant(robot), None, seed), (), windows).errors(()) is None
