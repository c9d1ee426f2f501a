"""Plants in other time steps: the same robot to the last bit, but for its <option>."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.dynamics.plant import AugmentedPlant, Plant, hasty, refined
from flywheel.dynamics.plant.refined import with_steps
from flywheel.records import State
from flywheel.robots import ROBOTS, Robot, load_robot, read_robot
from flywheel.robots.integrators import INTEGRATORS

SECONDS = 0.5
SAID = 'timestep="0.005"'


def moved(plant: Plant) -> State:
    """Where random controls bring a plant from its keyframe."""
    robot, rng = plant.robot, np.random.default_rng(0)
    size = (1, round(SECONDS / plant.dt), len(robot.winches))
    states = plant.simulate(plant.rest(), rng.uniform(robot.control_low, robot.control_high, size))
    assert states.states is not None
    return states.states[:, -1]


def equal(one: State, other: State) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name)) for name in ("qpos", "qvel", "act")
    )


def uneven(robot: Robot) -> Robot:
    """The robot with numbers of more digits than MuJoCo writes."""
    return read_robot(robot.xml.replace("-5000 -70", "-5000.123456789 -70.123456789"))


@pytest.mark.parametrize("name", ROBOTS)
def test_shorter_steps_are_those_of_an_mjcf_that_says_so(name: str) -> None:
    robot = uneven(load_robot(name))
    assert SAID in robot.xml
    written = read_robot(robot.xml.replace(SAID, 'timestep="0.0025"'))
    finer = refined(Plant(robot))
    assert finer.model.opt.timestep == 0.0025
    assert equal(moved(finer), moved(Plant(written)))
    assert not equal(moved(finer), moved(Plant(robot)))


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_an_integrator_is_that_of_an_mjcf_that_says_so(integrator: str) -> None:
    robot = uneven(load_robot("prism3"))
    said = f'integrator="{robot.integrator}"'
    assert said in robot.xml
    written = read_robot(robot.xml.replace(said, f'integrator="{integrator}"'))
    assert written.integrator == integrator
    other = with_steps(Plant(robot), integrator, robot.timestep)
    assert other.model.opt.integrator == INTEGRATORS[integrator]
    assert equal(moved(other), moved(Plant(written)))


def test_a_plant_with_effects_has_the_steps_of_its_robot() -> None:
    plant = with_steps(Plant(load_robot("prism3")), "RK4", 0.001)
    option = AugmentedPlant(plant)._model.opt
    assert (option.timestep, option.integrator) == (0.001, INTEGRATORS["RK4"])


def test_numbers_of_a_fitted_plant_keep_all_their_digits() -> None:
    plant = Plant(replace(load_robot("prism3"), xml=uneven(load_robot("prism3")).xml))
    for other in (refined(plant), hasty(plant)):
        assert np.array_equal(other.model.geom_solref, plant.model.geom_solref)
        assert other.robot.xml == plant.robot.xml
