"""Effects hidden by another simulator are found. The whole examination is in docs/results."""

import numpy as np
import pytest

from flywheel.diagnosis import Verdict, diagnose
from flywheel.dynamics.plant import Plant
from flywheel.effects import EFFECTS
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.recording import HiddenRecording, record

SECONDS = 1.6
FEW = {name: EFFECTS[name] for name in ("cable_friction", "winch_gain", "payload", "slope")}


def hidden(robot: Robot, name: str, seed: int) -> HiddenRecording:
    effects = ()
    if name:
        effects = (hidden_effect(name).typical(robot, np.random.default_rng(seed)).scaled(2.0),)
    return record(robot, effects, seconds=SECONDS, seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot_name", "name"),
    [  # docs/diagnosis.md has the first one, too
        pytest.param("prism3", "winch_gain", marks=pytest.mark.nightly),
        ("platform4", "cable_friction"),
    ],
)
def test_a_hidden_effect_is_named_and_measured(robot_name: str, name: str) -> None:
    robot = load_robot(robot_name)
    recording = hidden(robot, name, seed=7)
    found = diagnose(Plant(robot, threads=2), [recording.trajectory], library=FEW)
    assert found.verdict in (Verdict.EFFECT, Verdict.AMBIGUOUS)
    assert [each.effect for each in found.answers[0]] == [name]
    (truth,) = recording.effects[0].values.values()
    (value,) = found.answers[0][0].values
    assert value.value == pytest.approx(truth, rel=0.25)
    assert found.errors.augmented < found.errors.baseline


@pytest.mark.slow
def test_nothing_hidden_is_said_to_be_noise() -> None:
    robot = load_robot("prism3")
    found = diagnose(Plant(robot, threads=2), [hidden(robot, "", 11).trajectory], library=FEW)
    assert found.verdict is Verdict.NOISE_ONLY
    assert found.exit_code == 0
    assert found.answers == ((),)
    assert found.errors.noise == pytest.approx(0.003 * robot.length, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param("sensor_latency", marks=pytest.mark.nightly), "command_delay"]
)
def test_what_cannot_be_told_apart_is_answered_together(name: str) -> None:
    robot = load_robot("platform4")
    recording = hidden(robot, name, seed=5)
    library = {each: EFFECTS[each] for each in ("sensor_latency", "command_delay", "winch_gain")}
    found = diagnose(Plant(robot, threads=2), [recording.trajectory], library=library)
    assert found.verdict is Verdict.AMBIGUOUS
    assert {a[0].effect for a in found.answers} == {"sensor_latency", "command_delay"}
    first, second = found.answers
    assert first[0].values[0].value == pytest.approx(second[0].values[0].value)
