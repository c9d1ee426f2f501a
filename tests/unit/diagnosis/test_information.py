"""What is said of experiments before they are made is plain geometry of sensitivities."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis.experiments.command_scripts import FAMILIES, WinchRange
from flywheel.diagnosis.experiments.information import Information, information_of, simulate_scripts
from flywheel.diagnosis.selection.candidates import candidates
from flywheel.diagnosis.selection.scores import slices_of
from flywheel.diagnosis.statistics import chance
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.tautness import taut_share
from flywheel.effects import EFFECTS
from flywheel.errors import DataError, ModelError
from flywheel.records import State
from flywheel.robots import Robot


@pytest.fixture(scope="module")
def drawn(robot: Robot, seed: int) -> tuple[Information, np.ndarray]:
    """Information of two experiments from random sensitivities (S, N, n), which come with it."""
    library = candidates(robot, {n: EFFECTS[n] for n in ("slope", "creep", "capstan")})
    count = slices_of(library)[-1][-1].stop
    columns = np.random.default_rng(seed).normal(0, 3.0, (2, 40, count))
    return Information(
        library, columns.swapaxes(1, 2) @ columns, slices_of(library), (0, 1, 0)
    ), columns


def test_a_separation_is_what_the_best_fit_of_the_rival_leaves(drawn, seed):
    information, columns = drawn
    capstan, creep = 2, 1
    for row in range(2):
        own = columns[row][:, information.slices[capstan][0]]
        left = []
        for shape in information.slices[creep]:
            rival = columns[row][:, shape]
            best = np.linalg.lstsq(rival, own, rcond=None)[0]
            left.append(np.linalg.norm(own - rival @ best))
        assert information.separation(capstan, creep)[row] == pytest.approx(min(left)), seed


def test_of_several_sizes_the_weakest_combination_counts(drawn, seed):
    information, columns = drawn
    slope = 0
    angles = np.linspace(0, np.pi, 2001)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    for row in range(2):
        own = columns[row][:, information.slices[slope][0]]
        weakest = np.linalg.norm(own @ directions, axis=0).min() / np.sqrt(chance(2, 25.0))
        assert information.strength(slope)[row] == pytest.approx(weakest, rel=1e-5), seed
        needed = 5.0 + 1.645 / np.sqrt(chance(2, 25.0))  # the noise is that of both together
        assert information.smallest(slope)[row] == pytest.approx(needed / weakest, rel=1e-5), seed


def test_cosines_are_of_the_angles_between_what_two_change(drawn, seed):
    information, columns = drawn
    a, b = (
        columns[1][:, information.slices[2][0]][:, 0],
        columns[1][:, information.slices[1][1]][:, 0],
    )
    cosine = abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b)
    assert information.cosines(2, 1)[1, 0] == pytest.approx(cosine), seed
    assert np.allclose(information.cosines(0, 0), 1.0)
    assert information.cosines(0, 1).shape == (2, 1)


@pytest.fixture(scope="module")
def plant(robot: Robot) -> Plant:
    return Plant(robot)


@pytest.fixture(scope="module")
def scripts(robot: Robot, plant: Plant, seed: int) -> np.ndarray:
    """One short script of every family."""
    rng = np.random.default_rng(seed)
    reach = WinchRange.around(robot, robot.winch_of(robot.keyframe), plant.dt)
    return reach.commands(reach.path(np.stack([f(reach, 60, rng) for f in FAMILIES.values()])))


@pytest.mark.slow
def test_scripts_looked_at_together_and_alone_say_the_same(robot, plant, scripts):
    library = candidates(robot, {"capstan": EFFECTS["capstan"], "slope": EFFECTS["slope"]})
    motion = simulate_scripts(plant, scripts[:3])
    together = information_of(plant, scripts[:3], motion, library, 0.01)
    alone = information_of(plant, scripts[1:2], motion[np.array([1])], library, 0.01)
    assert np.allclose(together.gram[1], alone.gram[0], rtol=1e-6)
    assert not np.allclose(together.gram[0], together.gram[1], rtol=0.1)


def test_what_cannot_be_looked_at_is_refused(robot, plant, scripts):
    library = candidates(robot, {"capstan": EFFECTS["capstan"]})
    motion = simulate_scripts(plant, scripts[:1])
    with pytest.raises(DataError, match="no effect to look for"):
        information_of(plant, scripts[:1], motion, (), 0.01)
    with pytest.raises(DataError, match="noise must be a positive length, got 0"):
        information_of(plant, scripts[:1], motion, library, 0.0)
    diverged = replace(motion, finite=np.array([False]))
    with pytest.raises(ModelError, match="diverges under script 0"):
        information_of(plant, scripts[:1], diverged, library, 0.01)


def test_cables_are_taut_when_hauled_in_and_slack_when_paid_out(robot: Robot, plant: Plant) -> None:
    state = plant.settle(0.5)[:, None]
    long, short = (plant.activation(np.full((1, 1, 6), length)) for length in (50.0, 0.4))
    driven = np.mean([cable.winch >= 0 for cable in robot.cables])
    tight = taut_share(plant, State(state.qpos, state.qvel, short))[0]
    loose = taut_share(plant, State(state.qpos, state.qvel, long))[0]
    assert tight - loose == pytest.approx(driven)
