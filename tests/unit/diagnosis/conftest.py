"""A short recording of a robot whose plant is known."""

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.diagnosis.fitting.model import fitter_of
from flywheel.diagnosis.fitting.plant_fit import PlantFitter
from flywheel.diagnosis.fitting.windows import Windows
from flywheel.diagnosis.settings import Settings, changed
from flywheel.dynamics.plant import AugmentedPlant, MeasurementModel, Plant
from flywheel.effects import Terms
from flywheel.records import Observation, Trajectory
from flywheel.robots import Robot, load_robot
from tests import draws

SECONDS = 0.8
# For searches that are about something else than pairs of effects, or robots whose numbers are all off.
QUICK = changed(Settings(), {"selection.more": 1e6})


@pytest.fixture(scope="module")
def robot(request: pytest.FixtureRequest) -> Robot:
    """The one that a file names; platform4 is the smallest, where nothing is about contacts or rods."""
    return load_robot(getattr(request.module, "ROBOT", "prism3"))


@pytest.fixture(scope="session")
def seed() -> int:
    return draws.seed()


def recorded(robot: Robot, terms: Terms, seed: int, noise: float = 0.001) -> Trajectory:
    """What a plant with these terms does under random controls, as measured."""
    rng, augmented = np.random.default_rng(seed), AugmentedPlant(Plant(robot))
    start = augmented.plant.settle(1.0)
    controls = RandomControls(robot, 0.01).sequence(
        augmented.plant.winch(start)[0], round(SECONDS / 0.01), int(rng.integers(2**31))
    )[None]
    motion = augmented.simulate(start, augmented.commands(controls, [terms]), [terms])
    blind = np.full((motion.points.shape[1], len(robot.winches)), np.nan)
    seen = MeasurementModel(noise=noise).apply(Observation(motion.points[0], blind), robot, rng)
    return Trajectory(seen, controls[0], 0.01)


@pytest.fixture(scope="module")
def trajectory(robot: Robot, seed: int) -> Trajectory:
    return recorded(robot, (), seed)


@pytest.fixture(scope="module")
def windows(robot: Robot, trajectory: Trajectory) -> Windows:
    return Windows.cut(robot, [trajectory], seconds=0.4)


@pytest.fixture(scope="module")
def fitter(robot: Robot, windows: Windows) -> PlantFitter:
    return fitter_of(windows, Plant(robot))
