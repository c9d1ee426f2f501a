import numpy as np
import pytest
from pydantic import ValidationError

from flywheel.dynamics import plant as plant_package
from flywheel.dynamics.plant import Plant, PlantParameters
from flywheel.errors import ModelError
from flywheel.records import State
from flywheel.robots import Box, Robot, load_robot, read_robot
from flywheel.terrain import with_boxes
from tests.physics.small_robots import hanging


@pytest.fixture
def controls(robot: Robot) -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.repeat(rng.uniform(-0.6, 0.6, (3, 5, 6)), 20, axis=1)


def test_each_simulation_may_have_its_own_parameters(robot: Robot, controls: np.ndarray) -> None:
    sets = [PlantParameters(), PlantParameters(friction=0.5), PlantParameters(mass=1.1)]
    together = Plant(robot, parameters=sets, threads=2)
    states = together.simulate(together.rest(3), controls).states
    for index, parameters in enumerate(sets):
        alone = Plant(robot, parameters=parameters)
        expected = alone.simulate(alone.rest(), controls[index : index + 1]).states
        np.testing.assert_array_equal(states.qpos[index], expected.qpos[0])
    assert np.abs(states.qpos[0] - states.qpos[1]).max() > 1e-4
    assert np.abs(states.qpos[0] - states.qpos[2]).max() > 1e-4
    assert len({id(model) for model in together._models}) == 3


def test_equal_parameters_share_one_compiled_model(robot: Robot) -> None:
    sets = [PlantParameters(), PlantParameters(mass=1.1)] * 8
    assert len({id(model) for model in Plant(robot, parameters=sets)._models}) == 2


@pytest.mark.parametrize("name", sorted(PlantParameters.model_fields))
def test_every_parameter_changes_the_motion(name: str, robot: Robot, controls: np.ndarray) -> None:
    nominal = Plant(robot)
    changed = Plant(robot, parameters=PlantParameters(**{name: 0.7}))
    before = nominal.simulate(nominal.rest(), controls[:1]).observations.points
    after = changed.simulate(changed.rest(), controls[:1]).observations.points
    assert np.abs(before - after).max() > 1e-4


def test_a_scaled_mass_is_the_mjcf_with_that_mass() -> None:
    robot = hanging()
    heavy = read_robot(robot.xml.replace('mass="2.0"', 'mass="3.0"'))
    scaled, written = Plant(robot, parameters=PlantParameters(mass=1.5)).model, Plant(heavy).model
    for field in (
        "body_mass",
        "body_inertia",
        "dof_invweight0",
        "body_invweight0",
        "tendon_invweight0",
    ):
        np.testing.assert_allclose(getattr(scaled, field), getattr(written, field), rtol=1e-12)


def test_parameters_are_positive_and_known() -> None:
    for wrong in ({"friction": 0.0}, {"mass": -1.0}, {"colour": 2.0}):
        with pytest.raises(ValidationError):
            PlantParameters(**wrong)
    assert PlantParameters(friction=0.6).changed() == {"friction": 0.6}


def test_a_long_simulation_made_of_pieces_is_the_same(robot, controls, monkeypatch):
    plant = Plant(robot)
    whole = plant.simulate(plant.rest(3), controls)
    monkeypatch.setattr(plant_package.plant, "OUTPUT_BYTES", 3 * 2 * (46 + 18) * 8 * 7)
    calls = []
    run = plant._run
    monkeypatch.setattr(plant, "_run", lambda *a: calls.append(a[1].shape[1]) or run(*a))
    pieces = plant.simulate(plant.rest(3), controls)
    assert calls == [14] * 14 + [4, 1]  # the last is the observation of the end
    np.testing.assert_array_equal(whole.states.qpos, pieces.states.qpos)
    np.testing.assert_array_equal(whole.observations.points, pieces.observations.points)


def test_controls_beyond_their_range_are_clipped_and_so_recorded(robot: Robot) -> None:
    plant = Plant(robot)
    trajectory = plant.simulate(plant.rest(), np.full((1, 5, 6), -9.0))
    assert (trajectory.controls == -0.645).all()


def test_the_control_step_must_be_a_multiple_of_the_timestep(robot: Robot) -> None:
    assert Plant(robot, dt=0.05).substeps == 10
    for dt in (0.012, 0.001):
        with pytest.raises(ModelError, match=f"dt {dt} s must be a multiple .* 0.005 s"):
            Plant(robot, dt=dt)


def test_what_does_not_fit_is_said(robot: Robot) -> None:
    plant = Plant(robot)
    rest = plant.rest(2)
    with pytest.raises(ModelError, match=r"controls \(B, T, 6\).*got \(2, 9, 5\)"):
        plant.simulate(rest, np.zeros((2, 9, 5)))
    with pytest.raises(ModelError, match="must be finite"):
        plant.simulate(rest, np.full((2, 9, 6), np.nan))
    with pytest.raises(ModelError, match=r"qpos \(3 or 1, 21\).*got \(2, 21\)"):
        plant.simulate(rest, np.zeros((3, 9, 6)))
    with pytest.raises(ModelError, match="2 sets of parameters.*3 simulations"):
        Plant(robot, parameters=[PlantParameters()] * 2).simulate(
            plant.rest(3), np.zeros((3, 9, 6))
        )


def test_divergence_is_an_error_that_names_simulation_and_time(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot = load_robot("prism3")
    stiff = [PlantParameters(), PlantParameters(contact_stiffness=1e7), PlantParameters()]
    plant = Plant(robot, parameters=stiff, threads=2)
    start = plant.rest(3)
    lifted = start.qpos.copy()
    lifted[:, 2::7] += 0.3
    with pytest.raises(ModelError, match=r"Simulation 1 of 3 of prism3 diverged at \d\.\d+ s"):
        plant.simulate(State(lifted, start.qvel, start.act), np.zeros((3, 100, 6)))
    assert list(tmp_path.iterdir()) == []  # MuJoCo's own log file


def test_a_state_that_is_not_finite_is_an_error(robot: Robot) -> None:
    plant = Plant(robot)
    rest = plant.rest(2)
    qvel = rest.qvel.copy()
    qvel[1, 3] = np.nan
    with pytest.raises(ModelError, match="Simulation 1 of 2"):
        plant.simulate(State(rest.qpos, qvel, rest.act), np.zeros((2, 5, 6)))


def test_boxes_are_in_the_way() -> None:
    robot = hanging(z=2.0, rest=2.5)
    free, blocked = (
        Plant(robot, terrain=with_boxes(None, boxes))
        for boxes in ((), (Box(center=(0, 0, 0.5), half_size=(0.4, 0.4, 0.5)),))
    )
    fall = np.zeros((1, 200, 1))
    ends = [p.simulate(p.rest(), fall).observations.points[0, -1, 0, 2] for p in (free, blocked)]
    assert ends[0] < 0.9
    assert ends[1] == pytest.approx(1.1, abs=0.01)


def test_settling_is_simulating_under_the_holding_command(robot: Robot) -> None:
    plant = Plant(robot)
    assert plant.settle(0.1, n=4).qpos.shape == (4, 21)
    start = plant.rest()
    expected = plant.simulate(start, np.zeros((1, 10, 6))).states
    np.testing.assert_array_equal(plant.settle(0.1).qpos, expected.qpos[:, -1])


@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4"])
def test_points_of_a_state_are_where_its_sensors_see_them(name: str) -> None:
    plant = Plant(load_robot(name))
    low, high = plant.robot.control_low, plant.robot.control_high
    told = np.random.default_rng(0).uniform(low, high, (2, 60, len(low)))
    track = plant.simulate(plant.settle(0.5, 2), told)
    assert track.states is not None
    np.testing.assert_allclose(
        plant.robot.points_of(track.states), track.observations.points, atol=1e-9
    )
