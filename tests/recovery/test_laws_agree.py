"""The library's laws and those of another simulator agree where they are used at their limits."""

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.augmented import AugmentedPlant, Motion
from flywheel.effects import EFFECTS, Terms, WrittenTerm
from flywheel.records import Floats, State
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator import hidden_effect
from flywheel.truth_simulator.scripts import script
from flywheel.truth_simulator.simulator import TruthSimulator
from tests import draws

DT = 0.01
WINCH = ("winch_backlash", "command_delay", "actuator_lag", "winch_gain", "torque_speed")


def in_the_library(robot: Robot, controls: Floats, terms: Terms) -> Motion:
    """What the library's plant does, from the keyframe."""
    plant = AugmentedPlant(Plant(robot, DT))
    begin = robot.keyframe
    start = State(begin.qpos[None], begin.qvel[None], begin.act[None])
    told = plant.commands(controls[None], [terms])
    return plant.simulate(start, told, [terms])


def hidden_winch(robot: Robot, controls: Floats, *effects) -> Floats:
    """(T + 1, W) positions in the other simulator."""
    rest = TruthSimulator(robot, effects).run(controls, DT, settle=0.0).rest
    return rest[:, [winch.cables[0] for winch in robot.winches]]


@pytest.mark.slow
@pytest.mark.parametrize("robot_name", ["prism3", "platform4"])
@pytest.mark.parametrize("name", WINCH)
def test_winches_wind_as_in_another_simulator(name: str, robot_name: str) -> None:
    robot, seed = load_robot(robot_name), draws.seed()
    controls = script("pretension", robot, 2.0, DT, np.random.default_rng(seed))
    effect = hidden_effect(name).typical(robot, np.random.default_rng(seed)).scaled(2.0)
    values = effect.truth(robot).values
    term = WrittenTerm(effect=name, parameters=dict(values)).term(robot, EFFECTS)
    expected = hidden_winch(robot, controls, effect)
    change = expected - hidden_winch(robot, controls)
    error = robot.winch_of(in_the_library(robot, controls, (term,)).states)[0] - expected
    for winch in range(len(robot.winches)):
        size = np.sqrt(np.mean(change[:, winch] ** 2))
        assert size > 1e-4, f"seed {seed}: winch {winch} does not notice"
        assert np.sqrt(np.mean(error[:, winch] ** 2)) < 0.1 * size + 1e-4, f"seed {seed}, {winch}"


@pytest.mark.parametrize("name", ["weak_cable", "creep"])
def test_no_winch_pulls_with_more_than_it_has(name: str) -> None:
    robot, seed = load_robot("platform4"), draws.seed()
    controls = np.tile(np.where(robot.rate_driven, robot.control_low, 1.2), (150, 1))
    effect = hidden_effect(name).typical(robot, np.random.default_rng(seed))
    truth = effect.truth(robot)
    written = WrittenTerm(effect=name, location=truth.place, parameters=dict(truth.values))
    term = written.term(robot, EFFECTS)
    moved = TruthSimulator(robot, (effect,)).run(controls, DT, settle=0.0)
    plain = TruthSimulator(robot).run(controls, DT, settle=0.0)
    assert moved.tension.max() == pytest.approx(2000.0)  # of the MJCF's forcerange
    change = np.sqrt(np.mean((moved.points - plain.points) ** 2))
    error = in_the_library(robot, controls, (term,)).points[0] - moved.points
    assert change > 5e-4, f"seed {seed}"
    assert np.sqrt(np.mean(error**2)) < 0.3 * change + 5e-4, f"seed {seed}"
