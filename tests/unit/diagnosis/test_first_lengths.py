"""Winches that would have to have begun elsewhere, as the winch of a cut cable would."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flywheel.diagnosis import Verdict
from flywheel.diagnosis.checks.first_lengths import FirstLength, far_first_lengths
from flywheel.diagnosis.fitting.model import fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import Settings
from flywheel.dynamics.plant import Plant
from flywheel.reports.diagnosis_page import first_lengths, sentence
from flywheel.robots import Robot
from tests.unit.diagnosis.conftest import recorded

ROBOT = "platform4"


@pytest.fixture(scope="module")
def fitter(robot: Robot, seed: int) -> PlantFitter:
    logs = [recorded(robot, (), seed + i) for i in range(2)]
    return fitter_of(Windows.cut(robot, logs, seconds=0.4), Plant(robot))


def far(fitter: PlantFitter, **offsets: float) -> tuple[FirstLength, ...]:
    """Of a fit whose second recording begins with winches elsewhere, in deviations that are believed."""
    robot = fitter.windows.robot
    winch = np.zeros((2, len(robot.winches)))
    for name, times in offsets.items():
        index = next(i for i, each in enumerate(robot.winches) if each.name == name)
        winch[1, index] = times * fitter.settings.believed * fitter.winch_prior
    fit = fitter.at(np.zeros((len(fitter.windows), len(fitter.local_prior))), winch, ())
    return far_first_lengths(Plant(robot), fitter, fit)


def told(*lengths: FirstLength, verdict: Verdict = Verdict.NOISE_ONLY) -> Any:
    return SimpleNamespace(
        verdict=verdict,
        interrupted=False,
        first_lengths=lengths,
        evidence=SimpleNamespace(recording=np.array([0, 0, 1, 1])),
        settings=Settings(),
        after=SimpleNamespace(beyond_noise=0.0),
        as_built=None,
        model="",
        answers=((),),
    )


def test_a_cable_that_would_have_to_be_slack_all_the_time_is_named(fitter: PlantFitter) -> None:
    (length,) = far(fitter, winch_fr=40.0)
    assert (length.recording, length.slack, length.measured) == (1, True, False)
    (cable,) = length.cables
    believed = fitter.settings.believed * fitter.winch_prior
    assert length.longer == pytest.approx(40.0 * believed)
    words = f"{cable} is slack from the beginning in recording 1: its rest length would be 0.19 m longer"
    assert words in sentence(told(length))
    assert "a cut cable or an empty winch looks the same" in sentence(told(length))
    assert not first_lengths(told(length))  # it is said once
    assert words in first_lengths(told(length, verdict=Verdict.NOT_CONVERGED))
    assert length.summary()["than"] == "keyframe"


def test_several_are_named_those_that_are_farthest_off_first_and_tight_ones_as_tight(fitter):
    lengths = far(fitter, winch_fl=-2.0, winch_fr=40.0, rear=30.0)
    assert [len(each.cables) for each in lengths] == [1, 2, 1]
    # The second one is a position servo, which goes to where it is told.
    assert [each.slack for each in lengths] == [True, False, False]
    words = sentence(told(*lengths))
    assert words.count("is slack from the beginning") == words.count("begins elsewhere in") == 1
    assert "is tighter from the beginning" in words and "shorter than in the keyframe" in words


def test_winches_that_are_where_one_may_believe_them_are_not_mentioned(fitter: PlantFitter) -> None:
    assert far(fitter, winch_fl=-0.9, winch_fr=0.9, rear=0.9) == ()
    assert sentence(told()) == "The plant explains these recordings: nothing beyond noise is left."
