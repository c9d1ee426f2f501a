"""Effects on the numbers that a robot was built with, one by one and together."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from flywheel.diagnosis.fitting.nuisance import as_built_terms
from flywheel.diagnosis.fitting.parameters import free_parameters
from flywheel.dynamics.plant import AugmentedPlant, Plant, PlantParameters
from flywheel.dynamics.plant.augmented import edited
from flywheel.effects import (
    NAMED,
    AsBuilt,
    Part,
    Scales,
    Term,
    Terms,
    handed_back,
    handed_over,
    taken_apart,
    together,
    usual,
)
from flywheel.effects.effect import parts_of
from flywheel.records import Floats, State
from flywheel.robots import Robot, load_robot
from flywheel.robots.bodies import moving_bodies

STEPS = 30


@pytest.fixture(scope="module", params=["prism3", "platform4"])
def augmented(request: pytest.FixtureRequest) -> AugmentedPlant:
    return AugmentedPlant(Plant(load_robot(request.param)))


def moved(augmented: AugmentedPlant, terms: Terms, start: State | None = None) -> Floats:
    """(STEPS + 1, P, 3) points of a robot whose winches haul in one after the other."""
    plant, robot = augmented.plant, augmented.robot
    begun = plant.settle(1.0) if start is None else start
    share = np.linspace(0.1, 0.5, len(robot.winches)) * np.linspace(1.0, 0.3, STEPS)[:, None]
    hauled = robot.holding(plant.winch(begun)[0]) + share * (robot.control_low - robot.control_high)
    controls = np.clip(hauled, robot.control_low, robot.control_high)[None]
    motion = augmented.simulate(begun, augmented.commands(controls, [terms]), [terms])
    assert motion.finite.all()
    return motion.points[0]


def everywhere(name: str, robot: Robot, *values: float) -> Terms:
    return tuple(Term(NAMED[name], place, values) for place in NAMED[name].places(robot))


def test_all_drums_are_a_winch_gain() -> None:
    augmented = AugmentedPlant(Plant(load_robot("prism3")))
    drums = moved(augmented, everywhere("drum_radius", augmented.robot, 0.07))
    gain = moved(augmented, (Term(NAMED["winch_gain"], None, (0.07,)),))
    np.testing.assert_allclose(drums, gain, atol=1e-12)


def test_a_drum_of_a_position_winch_winds_up_more_length() -> None:
    robot = load_robot("platform4")
    still = robot.winch_of(robot.keyframe)
    controls = np.tile(np.array([0.1, -0.2, still[2] - 0.2]), (1, 3, 1))
    terms = (Term(NAMED["drum_radius"], 2, (0.1,)),)
    told = AugmentedPlant(Plant(robot)).commands(controls, [terms])
    np.testing.assert_allclose(told[0, :, 2], still[2] - 0.22)
    np.testing.assert_array_equal(told[..., :2], controls[..., :2])


def test_all_bodies_are_the_mass_of_the_robot(augmented: AugmentedPlant) -> None:
    bodies = moved(augmented, everywhere("mass_of_body", augmented.robot, 0.1))
    whole = moved(augmented, (Term(NAMED["body_mass"], None, (0.1,)),))
    np.testing.assert_allclose(bodies, whole, atol=1e-12)


def test_inertia_by_axis_is_what_resists_turning_about_that_axis() -> None:
    robot, model = load_robot("platform4"), Plant(load_robot("platform4")).model
    data = mujoco.MjData(model)

    def resisting() -> np.ndarray:
        """(3,) moments of inertia of the platform about its own axes [kg m^2]."""
        mujoco.mj_forward(model, data)
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        return np.diag(matrix)[3:6]

    before = resisting()
    NAMED["inertia_by_axis"].edit(model, robot, 0, {"x": 0.2, "y": -0.1, "z": 0.0})
    np.testing.assert_allclose(resisting() / before, [1.2, 0.9, 1.0], atol=1e-4)


def test_all_losses_are_the_damping_of_the_plant(augmented: AugmentedPlant) -> None:
    start = augmented.plant.settle(1.0)
    damped = Plant(augmented.robot, parameters=PlantParameters(cable_damping=1.4))
    cables = moved(augmented, everywhere("cable_loss", augmented.robot, 0.4), start)
    np.testing.assert_allclose(cables, moved(AugmentedPlant(damped), (), start), atol=1e-9)


def test_a_longer_cable_is_one_whose_winch_has_paid_out(augmented: AugmentedPlant) -> None:
    plant, robot = augmented.plant, augmented.robot
    start, more = plant.settle(1.0), 0.01 * robot.length
    assert robot.rate_driven[1]  # one that is told a position would go back to it
    winch = plant.winch(start)
    paid_out = State(
        start.qpos, start.qvel, plant.activation(winch + more * np.eye(len(winch[0]))[1])
    )
    (cable,) = robot.winches[1].cables
    longer = moved(augmented, (Term(NAMED["cable_length"], cable, (more,)),), start)
    np.testing.assert_allclose(longer, moved(augmented, (), paid_out), atol=1e-9)


def test_an_end_moved_along_its_cable_is_a_shorter_cable() -> None:
    """Of two ends moved apart by the same vector the cable keeps its length and its pull."""
    augmented = AugmentedPlant(Plant(load_robot("platform4")))
    cable = augmented.robot.cables[0]
    anchor = next(i for i, end in enumerate(cable.ends) if end.body < 0)
    apart = cable.ends[anchor].offset - cable.ends[1 - anchor].offset
    away = 0.02 * apart / np.linalg.norm(apart)
    outwards = (Term(NAMED["cable_end"], anchor, tuple(away.tolist())),)
    inwards = (Term(NAMED["cable_end"], anchor, tuple((-away).tolist())),)
    height = [moved(augmented, terms)[5, :, 2].mean() for terms in (outwards, (), inwards)]
    assert height[0] > height[1] > height[2]  # pulled more, as it hangs, and less


def test_a_centre_of_mass_at_its_bodys_origin_moves() -> None:
    """Until `mj_setConst` MuJoCo takes it for the origin, whatever body_ipos says."""
    augmented = AugmentedPlant(Plant(load_robot("prism3")))
    offset = (0.01, 0.02, -0.03)
    term = Term(NAMED["centre_of_mass"], 1, offset)
    model = edited(augmented._movable, augmented.robot, (term,))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    body = moving_bodies(model)[1]
    moved_by = data.xmat[body].reshape(3, 3).T @ (data.xipos[body] - data.xpos[body])
    np.testing.assert_allclose(moved_by, offset, atol=1e-12)


def test_parts_are_named_after_the_robots() -> None:
    robot = load_robot("prism3")
    assert parts_of(robot, "end")[:2] == ("pull_35.first", "pull_35.last")
    assert parts_of(robot, "winch") == tuple(winch.name for winch in robot.winches)
    assert parts_of(robot, "robot") == ("",)


def test_numbers_together_are_the_numbers_one_by_one(augmented: AugmentedPlant) -> None:
    robot, rng = augmented.robot, np.random.default_rng(0)
    built, *winches = as_built_terms(robot)
    values = 0.5 * np.array(built.known) * rng.normal(size=len(built.known))
    term = Term(built.effect, None, tuple(values.tolist()), built.known)
    parts = taken_apart((term, *winches))
    assert [v for part in parts for v in part.values] == [*values.tolist(), *[0.0] * len(winches)]
    assert [k for part in parts for k in part.known][: len(values)] == list(built.known)
    one_by_one = moved(augmented, parts)
    np.testing.assert_array_equal(moved(augmented, (term,)), one_by_one)
    assert np.abs(one_by_one - moved(augmented, ())).max() > 0


@pytest.mark.parametrize("name", ["winch_gain", "winch_gain_on_length"])
def test_a_gain_of_all_winches_and_drums_of_each_are_not_both_fitted(name: str) -> None:
    gain = Term(NAMED[name], None, (0.0,), (0.1,))
    parts = taken_apart(as_built_terms(load_robot("platform4"), present=(gain,)))
    assert "drum_radius" not in {part.effect.name for part in parts}


def test_a_robot_as_built_has_each_number_once() -> None:
    robot = load_robot("prism3")
    friction = Term(NAMED["ground_friction"], None, (0.0,), (0.1,))
    parts = taken_apart(
        as_built_terms(robot, present=(friction,), named=("mass_of_body", "weak_cable"))
    )
    places = [(part.effect.name, part.place) for part in parts]
    assert len(set(places)) == len(places)
    assert ("ground_friction", None) not in places
    names = {name for name, _ in places}
    assert "mass_of_body" not in names  # it was asked about
    assert "weak_cable" in names  # it is asked about always, and a number, too
    first = {winch.cables[0] for winch in robot.winches}  # whose offsets are fitted anyway
    lengths = {place for name, place in places if name == "cable_length"}
    assert lengths == set(range(len(robot.cables))) - first
    assert all(deviation > 0 for part in parts for deviation in part.known)
    assert not any(value for part in parts for value in part.values)


def test_effects_that_are_not_on_the_model_stay_terms_of_their_own() -> None:
    robot = load_robot("prism3")
    drum = Part(NAMED["drum_radius"], 1, 0.02)
    assert together(robot, [drum]) == (drum.term,)
    built, other = together(robot, [drum, Part(NAMED["mass_of_body"], 0, 0.1)])
    assert isinstance(built.effect, AsBuilt)
    assert other == drum.term


def test_a_number_stays_within_the_bounds_of_its_effect() -> None:
    robot = load_robot("prism3")
    softness = NAMED["contact_softness"]  # at least -0.5, where contacts are twice as stiff
    (term,) = together(robot, [Part(softness, None, 0.4)])
    (size,) = term.effect.sizes
    assert size.low * 0.4 == pytest.approx(-0.5)
    assert size.high == 10.0  # standard deviations


def test_an_effect_and_a_number_of_its_place_say_the_same() -> None:
    robot = load_robot("prism3")
    parts = [Part(NAMED["weak_cable"], place, 0.08) for place in (0, 1)]
    (numbers,) = together(robot, [*parts, Part(NAMED["ground_friction"], None, 0.2)])
    numbers = replace(numbers, values=(0.05, -0.02, 0.1))
    weak = Term(NAMED["weak_cable"], 1, (0.4,))
    creep = Term(NAMED["creep"], None, (0.1, 0.3))
    left, larger, same = handed_over((numbers, weak, creep))
    assert left.values == (0.05, 0.0, 0.1)
    assert larger.values == (pytest.approx(0.38),)
    assert same is creep
    assert handed_back((left, larger), larger) == (replace(numbers, values=(0.05, 0.38, 0.1)),)
    assert handed_back((numbers, creep), creep) == (numbers,)
    assert [usual(replace(weak, values=(size,)), (numbers,), 2.0) for size in (-0.16, 0.2)] == [
        True,
        False,
    ]
    assert not usual(creep, (numbers,), 2.0)
    known = replace(weak, known=(0.1,))  # a number itself
    assert handed_over((numbers, known)) == (numbers, known)
    room = [
        value.room((left, larger)) for value in free_parameters((left, larger), Scales.of(robot))
    ]
    assert [high - low > 0.0 for low, high in room] == [True, False, True, True]
