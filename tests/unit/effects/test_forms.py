"""Other laws of an effect, and sizes that differ from part to part."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from flywheel.dynamics.plant import AugmentedPlant, Plant
from flywheel.effects import (
    EFFECTS,
    FORMS,
    NAMED,
    Cables,
    CommandEffect,
    PerPart,
    Scales,
    TensionEffect,
    Term,
    WrittenTerm,
    alike,
    at_largest_part,
    per_part_term,
)
from flywheel.errors import ConfigError
from flywheel.records import State
from flywheel.robots import Robot, load_robot
from tests import draws

DT = 0.01
ABLE = (
    "cable_friction", "cable_friction_by_stiffness", "hysteresis", "creep", "winch_gain",
    "winch_gain_on_length", "winch_backlash", "torque_speed",
)  # fmt: skip


@pytest.fixture(scope="module")
def plant() -> AugmentedPlant:
    return AugmentedPlant(Plant(load_robot("platform4")))


def two_cables(length: float, speed: float) -> Cables:
    """A soft one, and one that is three times as stiff."""
    ones, stiffness = np.ones((1, 2)), np.array([[1e4, 3e4]])
    elastic = stiffness * max(length - 1.0, 0.0)
    return Cables(length * ones, speed * ones, ones, stiffness, elastic, DT, 0.01)


def tension(name: str, path: np.ndarray, **values: float) -> np.ndarray:
    """(steps, 2) of both cables, whose length goes along a path."""
    effect = NAMED[name]
    assert isinstance(effect, TensionEffect)
    full = {key: np.full((1, 2), value) for key, value in values.items()}
    memory, found = np.zeros((1, 2)), []
    for now, later in pairwise(path):
        extra, memory = effect.tension(two_cables(now, (later - now) / DT), memory, full)
        found.append(extra[0])
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("cable_friction", {"force": 50.0}),
        ("cable_damping", {"damping": 80.0}),
        ("hysteresis", {"force": 50.0, "length": 0.004}),
    ],
)
def test_in_proportion_to_stiffness_is_counted_from_the_mean(name, values):
    path = 1.05 + 0.01 * np.sin(np.linspace(0.0, 9.0, 60))
    even = tension(name, path, **values)
    uneven = tension(f"{name}_by_stiffness", path, **values)
    assert np.abs(even).max() > 1.0
    np.testing.assert_allclose(uneven, even * [0.5, 1.5])


def test_creep_on_length_follows_the_length_and_relaxes() -> None:
    share, time = 0.2, 0.1
    ramp = np.concatenate([np.linspace(1.02, 1.03, 11), np.full(60, 1.03)])
    found = tension("creep_on_length", ramp, share=share, time=time)
    speed = 0.01 / (10 * DT)
    arm = speed * time * (1 - np.exp(-10 * DT / time))  # after ten steps at that speed
    np.testing.assert_allclose(found[10], share * arm * np.array([1e4, 3e4]), rtol=1e-9)
    left = np.exp(-50 * DT / time)
    np.testing.assert_allclose(found[60], found[10] * left, rtol=1e-9)


def test_stiffening_by_strain_is_quadratic_in_the_stretch() -> None:
    once, twice = (
        tension("stiffening_by_strain", np.full(2, 1.0 + e), coefficient=0.3) for e in (0.01, 0.02)
    )
    np.testing.assert_allclose(twice, 4 * once)


def test_a_gain_on_length_is_counted_from_the_keyframe(plant: AugmentedPlant) -> None:
    robot, law = plant.robot, FORMS["winch_gain_on_length"]
    assert isinstance(law, CommandEffect)
    rng = np.random.default_rng(seed := draws.seed())
    told = rng.uniform(robot.control_low, robot.control_high, (1, 30, len(robot.winches)))
    wound = law.command(told, {"share": np.full((1, told.shape[2]), 0.1)}, robot, DT)
    rates, begun = robot.rate_driven, robot.winch_of(robot.keyframe)
    assert 0 < rates.sum() < len(rates)
    np.testing.assert_allclose(wound[..., rates], 1.1 * told[..., rates], err_msg=str(seed))
    way = (told - begun)[..., ~rates]
    np.testing.assert_allclose((wound - begun)[..., ~rates], 1.1 * way, err_msg=str(seed))


def test_other_laws_have_the_family_of_an_effect_of_the_library() -> None:
    for name, effect in FORMS.items():
        assert effect.name == name and effect.form
        assert effect.family in EFFECTS and effect.family != name
        of = EFFECTS[effect.family]
        assert [p.name for p in effect.parameters] == [p.name for p in of.parameters]


def uneven(robot: Robot, name: str, rng: np.random.Generator) -> Term:
    """An effect of three times its typical size with a factor for each part."""
    effect, scales = NAMED[name], Scales.of(robot)
    sizes = [3.0 * size.typical(scales) for size in effect.sizes]
    shapes = [shape.typical(scales) for shape in effect.shapes]
    term = per_part_term(Term(effect, None, (*sizes, *shapes)), robot, 0.5)
    assert term is not None and isinstance(term.effect, PerPart)
    own, count = len(effect.parameters), len(term.effect.parts)
    return replace(term, values=term.values[:own] + tuple(rng.uniform(-1, 1, count).tolist()))


def moved_together(plant: AugmentedPlant, terms: tuple[Term, ...]) -> np.ndarray:
    """Points of robots whose winches haul in and pay out, each with one of the terms."""
    start, count = plant.plant.settle(1.0), len(terms)
    many = State(*(np.repeat(a[:1], count, axis=0) for a in (start.qpos, start.qvel, start.act)))
    low, high = plant.robot.control_low, plant.robot.control_high
    way = np.where(np.arange(40) < 20, 0.4, -0.4)[:, None] * (high - low)
    held = plant.robot.holding(plant.plant.winch(start)[0])
    controls = np.repeat(np.clip(held + way, low, high)[None], count, axis=0)
    each = [(term,) for term in terms]
    motion = plant.simulate(many, plant.commands(controls, each), each)
    assert motion.finite.all()
    return motion.points


def moved(plant: AugmentedPlant, terms: tuple[Term, ...]) -> np.ndarray:
    """The same of one robot; without a term, of the MJCF."""
    nothing = Term(EFFECTS["cable_friction"], None, (0.0,))
    return moved_together(plant, terms or (nothing,))


@pytest.mark.parametrize("name", ABLE)
def test_without_factors_it_is_the_even_effect_and_with_them_another(name, plant):
    rng = np.random.default_rng(seed := draws.seed())
    term = uneven(plant.robot, name, rng)
    own = len(NAMED[name].parameters)
    even = Term(NAMED[name], None, term.values[:own])
    none = replace(term, values=even.values + (0.0,) * (len(term.values) - own))
    assert np.array_equal(moved(plant, (none,)), moved(plant, (even,))), seed
    assert not np.array_equal(moved(plant, (term,)), moved(plant, (even,))), seed
    assert term.unknown == own and term.asked and term.effect.family == NAMED[name].family


def test_a_part_has_the_size_times_its_factor(plant: AugmentedPlant) -> None:
    rng = np.random.default_rng(draws.seed())
    term = uneven(plant.robot, "cable_friction", rng)
    assert isinstance(term.effect, PerPart)
    count = len(term.effect.parts)
    values = {name: np.full((1, count), value) for name, value in term.named.items()}
    sizes = term.effect.apart(values)["force"][0]
    np.testing.assert_allclose(sizes, term.values[0] * np.exp(term.values[1:]))


def test_written_down_and_read_again_it_has_its_factors(plant: AugmentedPlant) -> None:
    rng = np.random.default_rng(draws.seed())
    term = uneven(plant.robot, "torque_speed", rng)
    written = WrittenTerm.of(term, plant.robot)
    read = WrittenTerm.model_validate_json(written.model_dump_json()).term(plant.robot, NAMED)
    assert isinstance(read.effect, PerPart) and read.values == term.values
    assert np.array_equal(moved(plant, (read,)), moved(plant, (term,)))


def test_factors_at_one_part_alone_are_refused(plant: AugmentedPlant) -> None:
    term = uneven(plant.robot, "cable_friction", np.random.default_rng(draws.seed()))
    written = WrittenTerm.of(term, plant.robot).model_copy(update={"location": "cable_fl"})
    with pytest.raises(ConfigError, match="of the whole robot"):
        written.term(plant.robot, NAMED)


def test_another_effect_of_the_same_parts_takes_the_factors_over(plant: AugmentedPlant) -> None:
    rng = np.random.default_rng(draws.seed())
    model = uneven(plant.robot, "cable_friction", rng)
    capstan, gain = (Term(EFFECTS[name], None, (0.1,)) for name in ("capstan", "winch_gain"))
    assert alike(capstan, model, plant.robot).values == (0.1, *model.values[1:])
    of_winches = alike(gain, model, plant.robot)
    same = plant.robot.cables and [c.name for c in plant.robot.cables] == [
        w.name for w in plant.robot.winches
    ]
    assert same or of_winches is gain
    assert alike(capstan, capstan, plant.robot) is capstan


def test_an_effect_at_one_place_or_of_several_sizes_has_no_factors(plant: AugmentedPlant) -> None:
    for name in ("weak_cable", "slope", "ground_friction"):
        effect = NAMED[name]
        place = effect.places(plant.robot)[0] if effect.places(plant.robot) else None
        term = Term(effect, place, tuple(0.1 for _ in effect.parameters))
        assert per_part_term(term, plant.robot, 0.5) is None


@pytest.mark.parametrize("name", ["cable_friction", "creep", "winch_backlash"])
def test_at_its_largest_part_alone_it_is_that_of_the_part(name: str, plant: AugmentedPlant) -> None:
    rng = np.random.default_rng(draws.seed())
    term = uneven(plant.robot, name, rng)
    assert isinstance(term.effect, PerPart)
    count = len(term.effect.parts)
    only = replace(term, values=term.values[:-count] + (-3.0, 2.0) + (-3.0,) * (count - 2))
    alone, share = at_largest_part(only)
    assert alone.place == 1 and alone.effect is NAMED[name]
    assert alone.values[0] == pytest.approx(term.values[0] * np.exp(2.0))
    assert share == pytest.approx(np.exp(2.0) / (np.exp(2.0) + (count - 1) * np.exp(-3.0)))
    near = moved(plant, (only,)) - moved(plant, (alone,))
    assert np.abs(near).max() < 0.3 * np.abs(moved(plant, (alone,)) - moved(plant, ())).max()
    written = WrittenTerm.of(alone, plant.robot)
    assert written.location == term.effect.parts[1]
    assert written.term(plant.robot, NAMED) == alone


def test_factors_and_none_are_one_effect_in_a_batch(plant: AugmentedPlant) -> None:
    rng = np.random.default_rng(draws.seed())
    term = uneven(plant.robot, "hysteresis", rng)
    even = Term(NAMED["hysteresis"], None, term.values[:2])
    alone, _ = at_largest_part(term)
    for first, second in ((even, term), (term, even), (alone, term)):
        want = [moved(plant, (each,)) for each in (first, second)]
        for got, expected in zip(moved_together(plant, (first, second)), want, strict=True):
            assert np.array_equal(got, expected[0])
