"""What holds for every controller."""

from collections.abc import Callable

import numpy as np
import pytest

from flywheel.control import CONTROLLERS, Controller, MppiConfig
from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.records import Past
from flywheel.robots import load_robot
from flywheel.tasks import Task, TaskConfig, sample_task
from tests import draws

PLANT = Plant(load_robot("prism3"))
ROBOT, DT = PLANT.robot, PLANT.dt
FEW = MppiConfig(samples=6, horizon_seconds=0.5)
# A new controller needs a line here, or these tests fail.
BUILD: dict[str, Callable[[], Controller]] = {
    "hold": lambda: CONTROLLERS["hold"](ROBOT, DT),
    "playback": lambda: CONTROLLERS["playback"](ROBOT, np.full((3, len(ROBOT.winches)), 0.05)),
    "random": lambda: CONTROLLERS["random"](ROBOT, DT),
    "gait": lambda: CONTROLLERS["gait"](ROBOT, "roll", DT),
    "mppi": lambda: CONTROLLERS["mppi"](PlantDynamics(PLANT), FEW),
    "astar": lambda: CONTROLLERS["astar"](PlantDynamics(PLANT)),
}
DRAWN = {"random", "mppi"}  # those that leave something to chance


@pytest.fixture(scope="module")
def task() -> Task:
    start = PLANT.observe(PLANT.rest()).points[0]
    return sample_task("reach", ROBOT, start, np.random.default_rng(0), TaskConfig())


def driven(controller: Controller, task: Task, seed: int, acts: int = 3) -> np.ndarray:
    """All commands of a few acts in the closed loop."""
    state, commands = PLANT.rest(), []
    controller.reset(task, seed)
    seen = PLANT.observe(state[:, None])
    winch, done = seen.winch, np.empty((1, 0, len(ROBOT.winches)))
    for _ in range(acts):
        past = Past(seen, done, winch, state=state)
        command = controller.act(past)
        commands.append(command.controls)
        assert command.plan_seconds >= 0
        simulated = PLANT.simulate(state, command.controls[None])
        state = simulated.states[:, -1]
        seen = simulated.observations
        winch, done = seen.winch, simulated.controls
    return np.concatenate(commands)


def test_every_registered_controller_is_held_to_this_contract() -> None:
    assert BUILD.keys() == CONTROLLERS.keys()


@pytest.mark.parametrize("name", sorted(BUILD))
def test_it_says_what_it_is(name: str) -> None:
    controller = BUILD[name]()
    assert isinstance(controller, Controller)
    assert controller.name.partition(":")[0] == name
    assert controller.history >= 0


@pytest.mark.parametrize("name", sorted(BUILD))
def test_its_commands_are_finite_and_keep_to_the_ranges(name: str, task: Task) -> None:
    commands = driven(BUILD[name](), task, seed := draws.seed())
    assert commands.ndim == 2 and commands.shape[1] == len(ROBOT.winches)
    assert np.isfinite(commands).all(), seed
    assert (commands >= ROBOT.control_low - 1e-9).all(), seed
    assert (commands <= ROBOT.control_high + 1e-9).all(), seed


@pytest.mark.parametrize("name", sorted(BUILD))
def test_a_reset_with_the_same_seed_repeats_it_exactly(name: str, task: Task) -> None:
    controller, seed = BUILD[name](), draws.seed()
    first = driven(controller, task, seed)
    np.testing.assert_array_equal(driven(controller, task, seed), first)
    np.testing.assert_array_equal(driven(BUILD[name](), task, seed), first)
    if name in DRAWN:
        assert not np.array_equal(driven(controller, task, seed + 1), first)
