"""The library's winches go where those of another simulator go, that drive by rate and by position."""

from __future__ import annotations

import secrets

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.augmented import AugmentedPlant
from flywheel.effects import EFFECTS, Terms, WrittenTerm
from flywheel.hidden import hidden_effect
from flywheel.hidden.scripts import script
from flywheel.hidden.simulator import TruthSimulator
from flywheel.records import Floats, State
from flywheel.robots import Robot, load_robot

DT = 0.01
WINCH = ("winch_backlash", "command_delay", "actuator_lag", "winch_gain", "torque_speed")


def library_winch(robot: Robot, controls: Floats, terms: Terms) -> Floats:
    """(T + 1, W) positions in the library's plant."""
    plant = AugmentedPlant(Plant(robot, DT))
    begin = robot.keyframe
    start = State(begin.qpos[None], begin.qvel[None], begin.act[None])
    told = plant.commands(controls[None], [terms])
    return robot.winch_of(plant.simulate(start, told, [terms]).states)[0]


def hidden_winch(robot: Robot, controls: Floats, *effects) -> Floats:
    """(T + 1, W) positions in the other simulator."""
    rest = TruthSimulator(robot, effects).run(controls, DT, settle=0.0).rest
    return rest[:, [winch.cables[0] for winch in robot.winches]]


@pytest.mark.parametrize("robot_name", ["prism3", "platform4"])
@pytest.mark.parametrize("name", WINCH)
def test_winches_wind_as_in_another_simulator(name: str, robot_name: str) -> None:
    robot, seed = load_robot(robot_name), secrets.randbits(32)
    controls = script("pretension", robot, 2.0, DT, np.random.default_rng(seed))
    effect = hidden_effect(name).typical(robot, np.random.default_rng(seed)).scaled(2.0)
    values = effect.truth(robot).values
    term = WrittenTerm(effect=name, parameters=dict(values)).term(robot, EFFECTS)
    expected = hidden_winch(robot, controls, effect)
    change = expected - hidden_winch(robot, controls)
    error = library_winch(robot, controls, (term,)) - expected
    for winch in range(len(robot.winches)):
        size = np.sqrt(np.mean(change[:, winch] ** 2))
        assert size > 1e-4, f"seed {seed}: winch {winch} does not notice"
        assert np.sqrt(np.mean(error[:, winch] ** 2)) < 0.1 * size + 1e-4, f"seed {seed}, {winch}"
