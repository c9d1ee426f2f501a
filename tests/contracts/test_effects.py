"""Every effect of the library keeps these promises, on every shipped robot."""

import numpy as np
import pytest

from flywheel.dynamics.plant import AugmentedPlant, Plant
from flywheel.effects import NAMED, Effect, Scales, Term
from flywheel.records import State
from flywheel.robots import Robot, load_robot
from tests import draws

STEPS = 40
ROBOTS = ("prism3", "platform4")


@pytest.fixture(scope="module", params=ROBOTS)
def augmented(request: pytest.FixtureRequest) -> AugmentedPlant:
    return AugmentedPlant(Plant(load_robot(request.param)))


def some_term(effect: Effect, robot: Robot, rng: np.random.Generator, factor: float) -> Term:
    """Of `factor` times the typical sizes, anywhere."""
    scales, places = Scales.of(robot), effect.places(robot)
    sizes = [factor * size.typical(scales) for size in effect.sizes]
    shapes = [shape.typical(scales) for shape in effect.shapes]
    return Term(effect, places[int(rng.integers(len(places)))], (*sizes, *shapes))


def driven(augmented: AugmentedPlant, rng: np.random.Generator, count: int):
    """A settled start and commands that haul in and pay out every winch in some order (some
    effects act one way only), the same for `count` simulations."""
    plant = augmented.plant
    start = plant.settle(1.0)
    low, high = plant.robot.control_low, plant.robot.control_high
    way = (
        rng.choice((-1.0, 1.0), len(low)) * np.where(np.arange(STEPS) < STEPS // 2, 1, -1)[:, None]
    )
    controls = np.clip(
        plant.robot.holding(plant.winch(start)[0]) + 0.5 * way * (high - low), low, high
    )
    many = State(*(np.repeat(a, count, axis=0) for a in (start.qpos, start.qvel, start.act)))
    return many, np.repeat(controls[None], count, axis=0)


def simulated(augmented: AugmentedPlant, start: State, controls: np.ndarray, terms) -> np.ndarray:
    motion = augmented.simulate(start, augmented.commands(controls, terms), terms)
    assert motion.finite.all()
    return motion.points


@pytest.mark.parametrize("name", NAMED)
def test_an_effect_of_size_zero_changes_nothing_to_the_bit(name, augmented):
    rng = np.random.default_rng(seed := draws.seed())
    start, controls = driven(augmented, rng, 1)
    want = augmented.plant.simulate(start, controls).observations.points
    term = some_term(NAMED[name], augmented.robot, rng, 0.0)
    got = simulated(augmented, start, controls, [(term,)])
    assert np.array_equal(got, want), seed


@pytest.mark.parametrize("name", NAMED)
def test_an_effect_changes_what_it_is_part_of_and_not_its_neighbours(name, augmented):
    rng = np.random.default_rng(seed := draws.seed())
    start, controls = driven(augmented, rng, 3)
    effect = NAMED[name]
    terms = [(), (some_term(effect, augmented.robot, rng, 2.0),), ()]
    points = simulated(augmented, start, controls, terms)
    alone = augmented.plant.simulate(start[:1], controls[:1]).observations.points[0]
    assert np.array_equal(points[0], alone), seed
    assert np.array_equal(points[2], alone), seed
    on_the_ground = {"ground_friction", "contact_softness", "rolling_resistance"}
    if not (name in on_the_ground and augmented.robot.name == "platform4"):  # hangs in the air
        assert np.abs(points[1] - alone).max() > 0, seed


@pytest.mark.parametrize("name", NAMED)
def test_time_can_be_cut_anywhere(name: str, augmented: AugmentedPlant) -> None:
    rng = np.random.default_rng(seed := draws.seed())
    start, controls = driven(augmented, rng, 1)
    terms = [(some_term(NAMED[name], augmented.robot, rng, 1.0),)]
    told = augmented.commands(controls, terms)
    whole = augmented.simulate(start, told, terms)
    cut = int(rng.integers(1, STEPS))
    first = augmented.simulate(start, told[:, :cut], terms)
    second = augmented.simulate(first.states[:, -1], told[:, cut:], terms, first.memory)
    assert np.array_equal(second.points, whole.points[:, cut:]), (seed, cut)


@pytest.mark.slow
def test_what_was_simulated_before_changes_nothing(augmented: AugmentedPlant) -> None:
    # batches, their states and the models with effects are kept from call to call
    rng = np.random.default_rng(seed := draws.seed())
    for count in rng.integers(1, 60, 4).tolist():
        start, controls = driven(augmented, rng, count)
        effects = [NAMED[name] for name in rng.choice(list(NAMED), (count, 2)).ravel()]
        some = [
            some_term(effect, augmented.robot, rng, rng.uniform(0.5, 1.5)) for effect in effects
        ]
        terms = list(zip(some[::2], some[1::2], strict=True))
        fresh = AugmentedPlant(augmented.plant)
        assert np.array_equal(
            augmented.simulate(start, controls, terms).points,
            fresh.simulate(start, controls, terms).points,
        ), seed


@pytest.mark.parametrize("name", NAMED)
def test_an_effect_says_what_it_is(name: str) -> None:
    effect = NAMED[name]
    assert effect.name == name
    assert effect.equation and effect.source and effect.shown_by
    assert effect.sizes
    for robot in map(load_robot, ROBOTS):
        for parameter in effect.parameters:
            assert parameter.typical(Scales.of(robot)) > 0
            assert parameter.unit
            assert parameter.low < parameter.high
        assert effect.places(robot)
    assert all(shape.grid for shape in effect.shapes)


def test_a_faster_winch_is_faster_at_full_command_too() -> None:
    """MuJoCo must not clip what the effect made of a command within its range."""
    augmented = AugmentedPlant(Plant(load_robot("prism3")))
    robot, plant = augmented.robot, augmented.plant
    start = plant.settle(1.0, n=2)
    controls = np.repeat(robot.control_high[None, None], 20, axis=1).repeat(2, axis=0)
    terms = [(), (Term(NAMED["winch_gain"], None, (0.25,)),)]
    motion = augmented.simulate(start, augmented.commands(controls, terms), terms)
    moved = plant.winch(motion.states[:, -1]) - plant.winch(start)
    assert moved[1] == pytest.approx(1.25 * moved[0])


def test_simulations_that_diverge_say_so_from_the_first_step_on(augmented: AugmentedPlant) -> None:
    """Whether all steps are MuJoCo's own or a law acts between them, and the next ones are sound again."""
    rng = np.random.default_rng(seed := draws.seed())
    start, controls = driven(augmented, rng, 4)
    law = some_term(NAMED["cable_friction"], augmented.robot, rng, 1.0)
    for terms in ([()] * 4, [(law,)] * 4):
        sound = augmented.simulate(start, augmented.commands(controls, terms), terms)
        broken = np.array([False, True, False, True])
        speed = rng.choice([-1.0, 1.0], start.qvel.shape) * 10.0 ** rng.uniform(11, 13)
        speed = np.where(broken[:, None], speed, start.qvel)
        wild = State(start.qpos, speed, start.act)
        for begun, lost in ((wild, broken), (start, np.zeros(4, bool))):
            motion = augmented.simulate(begun, augmented.commands(controls, terms), terms)
            assert np.array_equal(motion.finite, ~lost), seed
            assert np.array_equal(motion.points[~lost], sound.points[~lost]), seed
