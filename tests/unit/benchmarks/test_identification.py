"""`mujoco.sysid` gets all numbers of an MJCF, and gives back what was planted in them."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mujoco import sysid

from benchmarks.sysid.identification import Piece, _Residuals, identify
from benchmarks.sysid.mjcf_parameters import Block, bare_spec, blocks, open_spec
from flywheel.dynamics.plant import Plant, moved
from flywheel.errors import ConfigError
from flywheel.records import Floats, State
from flywheel.robots import load_robot
from tests import draws
from tests.physics.small_robots import hanging

NEEDED = pytest.mark.skipif(
    not hasattr(sysid, "optimize"), reason="mujoco.sysid lacks packages: mujoco[sysid]"
)
FIELDS = (
    "body_mass", "body_inertia", "body_ipos", "tendon_stiffness", "tendon_damping",
    "tendon_lengthspring", "tendon_frictionloss", "actuator_gainprm", "actuator_biasprm",
    "geom_solref", "geom_friction",
)  # fmt: skip
NOISE = 1e-3  # [m]


@pytest.fixture
def seed() -> int:
    return draws.seed()


def piece(plant: Plant, seed: int) -> Piece:
    """The robot hauling at its cables, measured with little noise."""
    rng = np.random.default_rng(seed)
    start = plant.settle(0.3)
    controls = np.repeat(rng.uniform(-0.6, 0.6, (1, 2, 6)), 15, axis=1)
    points = plant.simulate(start, controls).observations.points[0]
    return Piece(start[0], controls[0], points + rng.normal(0, NOISE, points.shape))


def predicted(plant: Plant, piece: Piece) -> Floats:
    """(T + 1, P, 3) [m]."""
    start = State(*(a[None] for a in (piece.start.qpos, piece.start.qvel, piece.start.act)))
    return plant.simulate(start, piece.controls[None]).observations.points[0]


def shifted(plant: Plant, piece: Piece, change: Floats) -> State:
    """The piece's start, moved along the tangent by (2 nv,)."""
    start = State(*(a[None] for a in (piece.start.qpos, piece.start.qvel, piece.start.act)))
    return moved(plant, start, *np.split(change[None], 2, axis=1))[0]


def error(plant: Plant, xml: str, pieces: list[Piece]) -> float:
    """Root mean square of measured minus predicted, over the noise, from the pieces' starts.

    Of the middle piece: MuJoCo writes the numbers of an MJCF with six digits, and with those a motion
    may hit the ground elsewhere.
    """
    fitted = Plant(replace(plant.robot, xml=xml), plant.dt)
    off = np.stack([predicted(fitted, each) - each.points for each in pieces])
    return float(np.median(np.sqrt(np.square(off).mean(axis=(1, 2, 3)))) / NOISE)


def parameters(found: list[Block]) -> sysid.ParameterDict:
    return sysid.ParameterDict({block.parameter.name: block.parameter for block in found})


@pytest.fixture(scope="module")
def pair() -> tuple[Plant, Plant]:
    """A robot as it is thought to be, and as it is: its winches turn further, one rod is heavier."""
    robot = load_robot("prism3")
    spec = mujoco.MjSpec.from_string(robot.xml)
    for winch in spec.actuators:
        k = winch.gainprm[0]
        winch.gainprm[0], winch.biasprm[0] = (
            1.1 * k,
            -0.1 * k * 1.5,
        )  # about 1.5 m, where they begin
    spec.geom("cap3").mass *= 2.0
    return Plant(robot), Plant(replace(robot, xml=spec.to_xml()))


@pytest.mark.nightly
@pytest.mark.slow
@NEEDED
def test_numbers_are_fitted_down_to_the_noise(pair: tuple[Plant, Plant], seed: int) -> None:
    plant, truth = pair
    pieces = [piece(truth, seed + i) for i in range(3)]
    found = identify(plant, pieces, NOISE, iterations=6)
    before, after = (error(plant, xml, pieces) for xml in (plant.robot.xml, found.xml))
    assert after < min(2.0, 0.5 * before), f"seed {seed}: {before}, {after}, {found.ended}"
    assert all(n.low < n.value < n.high for n in found.numbers if "winch" in n.name), f"seed {seed}"


@NEEDED
def test_a_start_that_is_moved_back_leaves_what_is_known_of_it(pair, seed):
    """Of two pieces in one batch, each with a start of its own."""
    plant, _ = pair
    rng, spread = np.random.default_rng(seed), np.repeat([0.01, 0.05], 18)
    exact = [piece(plant, seed), piece(plant, seed + 1)]
    exact = [replace(each, points=predicted(plant, each)) for each in exact]
    shift = rng.normal(0, 1, (2, 36))
    off = [
        replace(p, start=shifted(plant, p, x * spread)) for p, x in zip(exact, shift, strict=True)
    ]
    spec = bare_spec(plant.robot.xml)
    residuals = _Residuals(plant, spec, off, NOISE, spread)
    params = parameters(blocks(spec))
    numbers = params.as_vector()
    for start in residuals.starts:
        params.add(start)
    back = np.concatenate([numbers, *-shift])
    columns = np.stack([back, np.concatenate([numbers, np.zeros(72)])], axis=1)
    for index, left in enumerate(residuals(columns, params)[0]):
        np.testing.assert_allclose(left[:-36, 0], 0.0, atol=1e-6, err_msg=f"seed {seed}")
        np.testing.assert_allclose(left[-36:, 0], -shift[index], err_msg=f"seed {seed}")
        assert np.abs(left[:-36, 1]).max() > 1.0, f"seed {seed}"


@NEEDED
def test_at_their_nominal_values_the_numbers_change_nothing() -> None:
    xml = load_robot("prism3").xml
    expected, spec = open_spec(xml).compile(), bare_spec(xml)
    params = parameters(blocks(spec))
    assert sum(len(b.labels) for b in blocks(spec)) == params.size == 101
    for _ in range(2):  # writing twice is writing once
        model = sysid.apply_param_modifiers(params, spec)
        for field in FIELDS:
            np.testing.assert_allclose(
                getattr(model, field), getattr(expected, field), rtol=1e-9, atol=1e-9
            )


@NEEDED
def test_every_number_changes_the_model_and_each_the_body_it_names(seed: int) -> None:
    spec = bare_spec(load_robot("prism3").xml)
    before = spec.compile()
    every = blocks(spec)
    params = parameters(every)
    low, high = params.get_bounds()
    share = np.random.default_rng(seed).uniform(0.4, 0.6, params.size)
    params.update_from_vector((1 - share) * low + share * high)
    after = sysid.apply_param_modifiers(params, spec)
    for field in FIELDS:
        assert np.abs(getattr(after, field) - getattr(before, field)).max() > 0, f"{field} {seed}"
    for block in every[-3:]:
        body = block.labels[0][0].split(".")[0]
        shown = block.shown(params[block.parameter.name].as_vector())
        assert shown[0] == pytest.approx(after.body(body).mass[0])
        np.testing.assert_allclose(shown[-3:], after.body(body).ipos, atol=1e-9)


@NEEDED
def test_a_winch_with_a_gain_turns_further_about_where_it_began(seed: int) -> None:
    robot = load_robot("prism3")
    spec = bare_spec(robot.xml)
    winches = blocks(spec)[0].parameter
    gain, offset = np.random.default_rng(seed).uniform([0.8, -0.1], [1.2, 0.1])
    winches.value[2] = [gain, offset, 1.0, 1.0]
    winches.apply_modifier(spec)
    model = spec.compile()
    act = robot.keyframe.act[2] + 0.3
    k = -model.actuator_biasprm[2, 1]
    rest = (model.actuator_gainprm[2, 0] * act + model.actuator_biasprm[2, 0]) / k
    assert rest == pytest.approx(robot.keyframe.act[2] + 0.3 * gain + offset), f"seed {seed}"


def test_missing_packages_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(sysid, "optimize", raising=False)
    with pytest.raises(ConfigError, match=r"mujoco\[sysid\]"):
        identify(Plant(hanging()), [], NOISE)
