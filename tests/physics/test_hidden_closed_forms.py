"""The truth simulator and its effects against formulas."""

import dataclasses

import mujoco
import numpy as np
import pytest

from flywheel.records import State
from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator import HiddenEffect, HiddenMotion, TruthSimulator
from flywheel.truth_simulator.body_effects import AirDrag, Payload
from flywheel.truth_simulator.cable_effects import Capstan, Creep, Hysteresis, Stiffening, WeakCable
from flywheel.truth_simulator.cable_motion import CableMotion
from flywheel.truth_simulator.ground_effects import GroundFriction, Slope
from flywheel.truth_simulator.motors import Motors
from flywheel.truth_simulator.winch_effects import (
    ActuatorLag,
    CommandDelay,
    TorqueSpeed,
    WinchBacklash,
    WinchGain,
)
from tests.physics.small_robots import HEIGHT, MASS, REST, STIFFNESS, hanging

G = 9.81
SLACK = 2.5  # rest length that leaves the cable slack [m]


def run(
    robot: Robot,
    seconds: float,
    *effects: HiddenEffect,
    speed: tuple[float, float, float] = (0.0, 0.0, 0.0),
    contact: str = "elliptic",
) -> HiddenMotion:
    key = robot.keyframe
    start = State(key.qpos, np.array([*speed, 0.0, 0.0, 0.0]), key.act)
    simulator = TruthSimulator(robot, effects, contact)
    return simulator.run(np.zeros((round(seconds / 0.01), 1)), 0.01, start, settle=0.0)


def test_a_slack_cable_lets_it_fall_freely() -> None:
    motion = run(hanging(z=2.0, rest=SLACK), 0.5)
    t = 0.01 * np.arange(51)
    # Semi-implicit Euler: n steps of h fall by g h^2 n (n + 1) / 2.
    np.testing.assert_allclose(motion.points[:, 0, 2], 2.0 - G * t * (t + 0.001) / 2, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "stretch"),
    [
        ((), MASS * G / STIFFNESS),
        ((Payload(0.5, 0),), (MASS + 0.5) * G / STIFFNESS),
        ((WeakCable(0.2, 0),), MASS * G / STIFFNESS / 0.8),
        ((Creep(0.3, 0.1),), MASS * G / STIFFNESS),  # carries nothing at rest
    ],
)
def test_a_hanging_mass_stretches_its_cable(effects, stretch):
    motion = run(hanging(damping=40.0), 8.0, *effects)
    assert HEIGHT - motion.points[-1, 0, 2] - REST == pytest.approx(stretch, rel=1e-5)


@pytest.mark.parametrize("point", range(6))
def test_a_payload_pulls_the_centre_of_mass_towards_its_point(point: int) -> None:
    robot, mass = load_robot("prism3"), 20.0
    centres = []
    for effects in ((), (Payload(mass, point),)):
        model = TruthSimulator(robot, effects).model
        data = mujoco.MjData(model)
        data.qpos[:] = robot.keyframe.qpos
        mujoco.mj_forward(model, data)
        centres.append(np.average(data.xipos, axis=0, weights=model.body_mass))
        total = model.body_mass.sum()
        carrier = data.body(robot.bodies[robot.points[point].body].name)
        place = carrier.xpos + carrier.xmat.reshape(3, 3) @ robot.points[point].offset
    expected = centres[0] + mass / total * (place - centres[0])
    np.testing.assert_allclose(centres[1], expected, atol=1e-9)


@pytest.mark.slow
def test_a_mass_on_stiffening_cable_hangs_where_the_cubic_says() -> None:
    motion = run(hanging(damping=40.0), 8.0, Stiffening(9.0))
    e = HEIGHT - motion.points[-1, 0, 2] - REST
    assert STIFFNESS * e * (1 + 9.0 * (e / REST) ** 2) == pytest.approx(MASS * G, rel=1e-5)


@pytest.mark.slow
def test_on_a_slope_it_hangs_askew() -> None:
    robot = hanging(damping=40.0, z=HEIGHT - REST - MASS * G / STIFFNESS)
    motion = run(robot, 8.0, Slope(0.0, 0.02), AirDrag(10.0))
    x, _, z = motion.points[-1, 0]
    assert np.arctan2(x, HEIGHT - z) == pytest.approx(0.02, rel=0.01)


def test_drag_slows_a_falling_mass_as_it_should() -> None:
    drag = 3.0
    motion = run(hanging(z=2.0, rest=SLACK), 0.4, AirDrag(drag), speed=(0.7, 0.0, 0.0))
    t = 0.01 * np.arange(41)
    expected = 0.7 * MASS / drag * -np.expm1(-drag * t / MASS)
    np.testing.assert_allclose(motion.points[:, 0, 0], expected, atol=3e-4)


@pytest.mark.parametrize("contact", ["elliptic", "pyramidal", "penalty"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_sliding_box_stops_after_the_way_that_friction_gives(contact: str, share: float) -> None:
    robot = hanging(z=0.1, rest=SLACK, shape="box")
    effects = GroundFriction(share), WeakCable(1.0, 0)  # its cable is out of the way
    motion = run(robot, 0.5, *effects, speed=(1.0, 0.0, 0.0), contact=contact)
    way = 1.0 / (2 * 0.5 * (1 + share) * G)
    assert motion.points[-1, 0, 0] == pytest.approx(way, rel=0.04)


def motors(robot: Robot, controls: np.ndarray, *effects: HiddenEffect) -> np.ndarray:
    """(T + 1, W) motor positions with commands of 0.1 s, looked at every 0.1 s."""
    start = robot.winch_of(robot.keyframe)
    winches = Motors(robot, start, 0.1, 0.001, effects)
    positions = [winches.position]
    for index in range(100 * len(controls)):
        if index % 100 == 0:
            winches.hear(controls[index // 100])
        winches.advance(index * 0.001, np.zeros(len(robot.cables)))
        if index % 100 == 99:
            positions.append(winches.position)
    return np.array(positions) - start


STEADY = np.full((8, 1), 0.2)
TIME = 0.1 * np.arange(9)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (WinchGain(0.3), 0.2 * 1.3 * TIME),
        (CommandDelay(0.0234), 0.2 * np.maximum(0.0, TIME - 0.0234)),
        (ActuatorLag(0.15), 0.2 * (TIME + 0.15 * np.expm1(-TIME / 0.15))),
    ],
)
def test_a_winch_moves_as_its_formula_says(effect: HiddenEffect, expected: np.ndarray) -> None:
    np.testing.assert_allclose(motors(hanging(), STEADY, effect)[:, 0], expected, atol=1e-12)


def test_two_delays_add() -> None:
    both = motors(hanging(), STEADY, CommandDelay(0.02), CommandDelay(0.03))
    np.testing.assert_allclose(both, motors(hanging(), STEADY, CommandDelay(0.05)), atol=1e-12)


def test_a_position_winch_with_gain_has_a_shorter_time_constant() -> None:
    robot = load_robot("platform4")
    rear = [winch.kind for winch in robot.winches].index("position")
    start = robot.winch_of(robot.keyframe)
    controls = np.tile(robot.holding(start), (8, 1))
    controls[:, rear] += 0.1
    lag = robot.winches[rear].time_constant
    moved = motors(robot, controls, WinchGain(0.25))[:, rear]
    np.testing.assert_allclose(moved, -0.1 * np.expm1(-TIME * 1.25 / lag), atol=1e-12)


def test_the_play_of_a_gear_is_used_up_first_and_again_at_every_turn() -> None:
    backlash = WinchBacklash(0.02)
    motor = np.concatenate([np.linspace(0, 0.1, 101), np.linspace(0.1, 0.05, 51)])[:, None]
    spool = [np.zeros(1)]
    for position in motor[1:]:
        spool.append(backlash.spool(position, spool[-1]))
    way = np.array(spool)[:, 0]
    np.testing.assert_allclose(way[:101], np.maximum(0.0, motor[:101, 0] - 0.01), atol=1e-12)
    np.testing.assert_allclose(way[101:], np.minimum(0.09, motor[101:, 0] + 0.01), atol=1e-12)


def test_a_motor_slows_down_under_load_when_hauling_in_only() -> None:
    rate, load = np.array([-0.2, 0.2, -0.2]), np.array([100.0, 100.0, 900.0])
    real = TorqueSpeed(0.002).limit(rate, load, np.zeros(3))
    np.testing.assert_allclose(real, [-0.16, 0.2, 0.0])


def pulled(rates: np.ndarray, extension: float, effect: HiddenEffect) -> np.ndarray:
    """Extra tension of one cable (k = 1000 N/m) that is stretched at the given rates (1 ms each)."""
    memory, found = np.zeros(1), []
    length = 1.0 + extension
    for index, rate in enumerate(rates):
        one = (np.array([x]) for x in (length, rate, 1.0, 0.0, 1000.0))
        extra, memory = effect.extra(CableMotion(0.001 * index, 0.001, *one), memory)
        found.append(float(extra[0]))
        length += 0.001 * rate
    return np.array(found)


def test_a_stretched_cable_relaxes_exponentially() -> None:
    rates = np.zeros(400)
    rates[0] = 10.0  # 10 mm within a millisecond
    extra = pulled(rates, 0.001, Creep(0.2, 0.1))
    first = 0.2 * 1000.0 * 10.0 * 0.1 * -np.expm1(-0.001 / 0.1)  # nearly 0.2 k 10 mm
    np.testing.assert_allclose(extra[1:], first * np.exp(-0.01 * np.arange(399)), rtol=1e-9)
    assert first == pytest.approx(0.2 * 1000.0 * 0.01, rel=0.01)


def test_dahls_friction_saturates_and_a_slack_cable_forgets_it() -> None:
    effect = Hysteresis(500.0, 0.01)
    extra = pulled(np.full(400, 0.2), 0.001, effect)
    way = 0.001 * 0.2 * np.arange(400)
    np.testing.assert_allclose(extra, 5.0 * -np.expm1(-way / 0.01), rtol=1e-9)
    assert (pulled(np.full(50, 0.2), -0.5, effect) == 0).all()


def test_capstan_friction_is_a_share_of_the_tension() -> None:
    extra = pulled(np.full(5, 0.5), 0.01, Capstan(0.05, 0.001))
    tension = 1000.0 * (0.01 + 0.0005 * np.arange(5))
    np.testing.assert_allclose(extra, 0.05 * tension, rtol=1e-9)


@pytest.mark.parametrize("kind", ["cable_damping", "cable_friction", "capstan", "hysteresis",
                                  "creep", "quadratic_damping"])  # fmt: skip
def test_dissipative_laws_take_energy_from_every_cycle(kind: str) -> None:
    from flywheel.truth_simulator import HIDDEN, OUTSIDE

    effect = (HIDDEN | OUTSIDE)[kind].typical(load_robot("prism3"), np.random.default_rng(0))
    time = 0.001 * np.arange(4000)
    rates = 0.02 * 2 * np.pi * np.cos(2 * np.pi * time)  # 2 cm to either side, once a second
    extra = pulled(rates, 0.03, effect)
    work = 0.001 * (extra * rates)[2000:].sum()  # the first cycles set the memory
    assert work > 0


def test_effects_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Creep(0.1, 0.2).share = 0.3  # type: ignore[misc]
