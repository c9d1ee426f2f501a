"""Laws of effects against closed forms."""

from itertools import pairwise

import numpy as np
import pytest

from flywheel.effects import EFFECTS, Cables, CommandEffect, TensionEffect, WinchEffect, Winches
from flywheel.robots import Robot
from tests import draws

DT = 0.01


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(draws.seed())


def commanded(name: str, controls: np.ndarray, robot: Robot, **values: float) -> np.ndarray:
    effect = EFFECTS[name]
    assert isinstance(effect, CommandEffect)
    full = {key: np.full(controls[:, 0].shape, value) for key, value in values.items()}
    return effect.command(controls, full, robot, DT)


def steps(robot: Robot, rng: np.random.Generator, count: int = 60) -> np.ndarray:
    held = rng.uniform(-1, 1, (2, count // 10, len(robot.winches))) * robot.control_high
    return np.repeat(held, 10, axis=1)


def cables(length: float, speed: float, rest: float = 1.0, stiffness: float = 1e4) -> Cables:
    one = np.ones((1, 1))
    elastic = stiffness * max(length - rest, 0.0) * one
    return Cables(length * one, speed * one, rest * one, stiffness * one, elastic, DT, 0.01)


def tension(name: str, path: np.ndarray, **values: float) -> np.ndarray:
    """Of one cable whose length goes along a path."""
    effect = EFFECTS[name]
    assert isinstance(effect, TensionEffect)
    full = {key: np.full((1, 1), value) for key, value in values.items()}
    memory, found = np.zeros((1, 1)), []
    for now, later in pairwise(path):
        extra, memory = effect.tension(cables(now, (later - now) / DT), memory, full)
        found.append(extra.item())
    return np.array(found)


@pytest.mark.parametrize("name", ["command_delay", "sensor_latency"])
def test_a_delay_of_whole_steps_shifts(name: str, robot: Robot, rng: np.random.Generator) -> None:
    controls, late = steps(robot, rng), int(rng.integers(1, 8))
    told = commanded(name, controls, robot, time=late * DT)
    assert np.array_equal(told[:, late:], controls[:, :-late])
    assert (told[:, :late] == 0).all()


def test_a_delay_of_part_of_a_step_keeps_the_way(robot: Robot, rng: np.random.Generator) -> None:
    controls = steps(robot, rng)
    controls[:, -10:] = 0
    told = commanded("command_delay", controls, robot, time=0.034)
    assert told.sum(axis=1) == pytest.approx(controls.sum(axis=1))


def test_a_lag_answers_a_step_exponentially(robot: Robot) -> None:
    controls, lag = np.ones((1, 50, len(robot.winches))), 0.07
    told = commanded("actuator_lag", controls, robot, time=lag)
    way = np.cumsum(told, axis=1)[0, -1] * DT
    time = 50 * DT
    assert way == pytest.approx(time - lag * (1 - np.exp(-time / lag)))


def test_play_loses_its_width_at_every_turn(robot: Robot) -> None:
    width, there = 0.02, np.full((1, 20, len(robot.winches)), 0.3)
    told = commanded("winch_backlash", np.concatenate([there, -there], axis=1), robot, width=width)
    out, back = told[0, :20].sum(axis=0) * DT, told[0, 20:].sum(axis=0) * DT
    assert out == pytest.approx(0.06 - width / 2)
    assert back == pytest.approx(-0.06 + width)


def test_a_gain_scales_the_way(robot: Robot, rng: np.random.Generator) -> None:
    controls = steps(robot, rng)
    told = commanded("winch_gain", controls, robot, share=0.1)
    assert told == pytest.approx(1.1 * controls)


def test_a_loaded_winch_hauls_slower_and_pays_out_as_ever(rng: np.random.Generator) -> None:
    effect = EFFECTS["torque_speed"]
    assert isinstance(effect, WinchEffect)
    rate, load = rng.uniform(-1, 1, (50, 3)), rng.uniform(0, 2000, (50, 3))
    got = effect.rate(rate, Winches(np.ones_like(load), load), {"slope": np.full((50, 3), 1e-3)})
    hauls = rate < 0
    assert got[~hauls] == pytest.approx(rate[~hauls])
    assert got[hauls] == pytest.approx((rate * np.maximum(0, 1 - load / 1000))[hauls])


@pytest.mark.parametrize(
    "name", ["cable_damping", "cable_friction", "capstan", "hysteresis", "creep"]
)
def test_what_rubs_takes_energy_around_a_closed_path(name: str, rng: np.random.Generator) -> None:
    effect = EFFECTS[name]
    phase = np.linspace(0, 6 * np.pi, 900)
    path = 1.1 + 0.02 * np.sin(phase + rng.uniform(0, 6))
    values = {p.name: 1.0 for p in effect.parameters} | {"length": 0.005, "time": 0.2}
    values = {p.name: values[p.name] for p in effect.parameters}
    work = tension(name, path, **values) * np.diff(path)
    assert work[300:].sum() > 0  # two whole turns


def test_dahl_ends_at_its_force_on_either_side() -> None:
    there = np.linspace(1.1, 1.3, 400)
    found = tension("hysteresis", np.concatenate([there, there[::-1]]), force=7.0, length=0.004)
    assert found[390] == pytest.approx(7.0, rel=1e-6)
    assert found[-1] == pytest.approx(-7.0, rel=1e-6)


def test_a_stretched_cable_relaxes_with_its_time_constant() -> None:
    path = np.concatenate([np.full(5, 1.1), np.full(100, 1.2)])
    found = tension("creep", path, share=0.5, time=0.3)
    assert found[:5] == pytest.approx(0.0)
    assert found[5] == pytest.approx(0.5 * 1e4 * 0.1)
    later = 60 * DT
    assert found[65] == pytest.approx(found[5] * np.exp(-later / 0.3))


def test_stiffening_grows_with_the_cube_of_the_stretch() -> None:
    small, large = (tension("stiffening", np.full(2, 1.0 + e), coefficient=1.0) for e in (0.1, 0.2))
    assert large == pytest.approx(8 * small)
