"""Time-step errors beside their closed forms, and the limit from which on explicit damping feeds motion."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, PlantParameters, StepStudy, cable_damping
from flywheel.dynamics.plant.time_steps import energy
from flywheel.robots import GRAVITY, Robot, load_robot
from tests.physics.small_robots import HEIGHT, MASS, REST, STIFFNESS, hanging

FALL, EXACT = 0.4, 0.0001  # [s]
DAMPING = 400.0  # of a cable [N s/m]
NUDGE = 0.01  # [m/s]
STRETCH, SPEED = 0.3, 0.7  # [m], [m/s]


def held(plant: Plant, seconds: float) -> np.ndarray:
    """Commands (1, T, W) that hold the winches."""
    hold = plant.robot.holding(plant.winch(plant.rest()))
    return np.repeat(hold[:, None], round(seconds / plant.dt), axis=1)


def falling() -> Robot:
    """A mass whose cable hangs slack."""
    return hanging(z=HEIGHT - 0.5, rest=2.5)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("timestep", [0.01, 0.005, 0.002])
def test_a_fall_ends_as_far_off_as_the_steps_of_euler_bring_it(integrator, timestep):
    plant = Plant(falling())
    study = StepStudy(plant, plant.rest(), held(plant, FALL), "Euler", EXACT)
    error = study.error(integrator, timestep)
    # Speeds are ahead of the places by half a step.
    assert error.median == pytest.approx(GRAVITY * FALL * (timestep - EXACT) / 2, rel=1e-6)
    assert error.most == error.median
    assert error.speed > 0.0
    faster = GRAVITY * (timestep - EXACT) / 2  # than the place says
    assert error.energy == pytest.approx(MASS * GRAVITY * faster * FALL, rel=1e-6)
    assert (error.integrator, error.timestep) == (integrator, timestep)


def test_a_parabola_costs_rk4_nothing() -> None:
    plant = Plant(falling())
    study = StepStudy(plant, plant.rest(), held(plant, FALL), "RK4", EXACT)
    assert study.error("RK4", 0.01).median < 1e-12


def test_steps_that_diverge_are_infinitely_far_off() -> None:
    robot = load_robot("prism3")
    plant = Plant(robot, dt=0.05)
    study = StepStudy(plant, plant.rest(), held(plant, 1.0), "Euler", 0.001)
    error = study.error("Euler", 0.05)
    assert (error.median, error.most, error.speed) == (np.inf, np.inf, 0.0)
    assert np.isnan(error.energy)


def test_the_damping_of_one_cable_is_known_by_its_mass() -> None:
    found = cable_damping(Plant(hanging(damping=DAMPING)))
    assert found.rate == pytest.approx(DAMPING / MASS, rel=1e-9)
    assert found.own == pytest.approx(DAMPING / MASS, rel=1e-9)
    assert found.cable == "cable"
    assert found.limit("Euler") == pytest.approx(2 * MASS / DAMPING, rel=1e-9)
    assert found.limit("RK4") == pytest.approx(2.785 * MASS / DAMPING, rel=1e-9)
    assert found.limit("implicitfast") == np.inf


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast", "implicit", "discrete"])
@pytest.mark.parametrize("times", [0.8, 1.2])
def test_explicit_damping_feeds_motion_beyond_its_limit(integrator: str, times: float) -> None:
    robot = hanging(z=HEIGHT - REST - MASS * GRAVITY / STIFFNESS, damping=DAMPING)
    limit = cable_damping(Plant(robot)).limit(integrator)
    timestep = times * (limit if np.isfinite(limit) else 2 * MASS / DAMPING)
    plant = Plant(replace(robot, integrator=integrator, timestep=timestep), dt=timestep)
    start = plant.rest()
    start.qvel[0, 2] = NUDGE
    end = plant.settle(100 * timestep, start=start)
    rests = float(np.abs(end.qvel).max()) < 0.1 * NUDGE
    assert rests == (times < 1.0 or not np.isfinite(limit))


def test_two_cables_on_one_body_damp_it_together() -> None:
    found = cable_damping(Plant(load_robot("platform4")))
    assert found.rate > found.own > 0.0


def test_a_robot_without_damping_has_no_limit() -> None:
    found = cable_damping(Plant(hanging()))
    assert found.rate == 0.0
    assert found.limit("Euler") == np.inf


@pytest.mark.parametrize("stiffer", [1.0, 2.0])
def test_energy_is_that_of_speed_height_and_a_taut_cable(stiffer: float) -> None:
    plant = Plant(
        hanging(z=HEIGHT - REST - STRETCH), 0.01, PlantParameters(cable_stiffness=stiffer)
    )
    state = plant.rest(2)
    state.qvel[:, 2] = SPEED
    state.qpos[1, 2] = HEIGHT - REST + 0.1  # slack
    found = energy(plant, state)
    moving = MASS * SPEED**2 / 2
    taut = stiffer * STIFFNESS * STRETCH**2 / 2
    assert found[0] == pytest.approx(moving + MASS * GRAVITY * (HEIGHT - REST - STRETCH) + taut)
    assert found[1] == pytest.approx(moving + MASS * GRAVITY * (HEIGHT - REST + 0.1))
