"""A plant with effects keeps the promises of a plant."""

import pickle

import numpy as np
import pytest

from flywheel.control import RandomControls
from flywheel.dynamics.plant import AugmentedPlant, EffectivePlant, Plant, with_effects
from flywheel.effects import EFFECTS, Scales, Term, Terms
from flywheel.errors import ModelError
from flywheel.records import Floats
from flywheel.robots import load_robot
from tests import draws

PRISM = load_robot("prism3")
NAMES = ("creep", "command_delay", "winch_backlash", "torque_speed", "payload", "marker_offset")
STEPS = 60


def terms_of(*names: str) -> Terms:
    scales = Scales.of(PRISM)
    return tuple(
        Term(e, e.places(PRISM)[0], tuple(p.typical(scales) for p in e.parameters))
        for e in (EFFECTS[name] for name in names)
    )


def controls_of(rng: np.random.Generator, plant: Plant, count: int = 1) -> Floats:
    random = RandomControls(PRISM, plant.dt)
    winch = plant.winch(plant.rest())[0]
    return np.stack([random.sequence(winch, STEPS, int(rng.integers(2**31))) for _ in range(count)])


@pytest.mark.parametrize("name", NAMES)
def test_it_is_the_augmented_plant_with_the_same_effects_everywhere(name: str) -> None:
    rng = np.random.default_rng(seed := draws.seed())
    plain, terms = Plant(PRISM), terms_of(name)
    plant = with_effects(plain, terms)
    controls = controls_of(rng, plain, 3)
    augmented = AugmentedPlant(plain)
    each = [terms] * 3
    want = augmented.simulate(plain.rest(3), augmented.commands(controls, each), each)
    got = plant.simulate(plain.rest(), controls)
    assert np.array_equal(got.observations.points, want.points), seed
    assert np.array_equal(got.controls, controls)
    without = plain.simulate(plain.rest(), controls).observations.points
    assert not np.array_equal(got.observations.points, without), seed


@pytest.mark.parametrize("name", NAMES)
def test_an_episode_in_pieces_is_the_episode(name: str) -> None:
    rng = np.random.default_rng(seed := draws.seed())
    plant = with_effects(Plant(PRISM), terms_of(name))
    controls = controls_of(rng, plant)
    whole = plant.simulate(plant.rest(), controls)
    cuts = np.sort(rng.choice(np.arange(1, STEPS), 3, replace=False))
    course = plant.begin(plant.rest())
    pieces = [course.go(piece) for piece in np.split(controls, cuts, axis=1)]
    seen = [piece.observations.points[:, 1:] for piece in pieces]
    assert np.array_equal(np.concatenate(seen, axis=1), whole.observations.points[:, 1:]), seed
    assert np.array_equal(course.state.qpos, whole.states[:, -1].qpos)


def test_markers_are_seen_where_they_were_put() -> None:
    plant = with_effects(Plant(PRISM), terms_of("marker_offset"))
    moved = plant.simulate(plant.rest(), controls_of(np.random.default_rng(0), plant))
    seen = plant.observe(moved.states).points
    np.testing.assert_allclose(seen, moved.observations.points, atol=1e-12)
    assert np.abs(seen - Plant(PRISM).observe(moved.states).points).max() > 1e-3


def test_it_can_be_sent_to_a_worker() -> None:
    plant = with_effects(Plant(PRISM), terms_of("creep"))
    controls = controls_of(np.random.default_rng(draws.seed()), plant)
    sent = pickle.loads(pickle.dumps(plant))
    assert isinstance(sent, EffectivePlant)
    one, other = (p.simulate(p.rest(), controls).observations.points for p in (plant, sent))
    assert np.array_equal(one, other)


def test_without_effects_it_is_the_plant_itself() -> None:
    plant = Plant(PRISM)
    assert with_effects(plant, ()) is plant
    more = with_effects(with_effects(plant, terms_of("creep")), terms_of("payload"))
    assert [term.effect.name for term in more.terms] == ["creep", "payload"]


def test_what_does_not_fit_is_said() -> None:
    several = Plant(PRISM, parameters=[Plant(PRISM).parameters] * 2)
    with pytest.raises(ModelError, match="one set of parameters"):
        with_effects(several, terms_of("creep"))
    plant = with_effects(Plant(PRISM), terms_of("creep"))
    with pytest.raises(ModelError, match="takes controls"):
        plant.simulate(plant.rest(), np.zeros((1, 3, 2)))
