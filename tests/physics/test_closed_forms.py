"""The plant against formulas."""

import numpy as np
import pytest

from flywheel.dynamics.plant import Plant, PlantParameters
from flywheel.records import State, Trajectory
from flywheel.robots import Robot, read_robot
from tests.physics.small_robots import HEIGHT, MASS, REST, STIFFNESS, hanging

G = 9.81
SLACK = 2.5  # rest length that leaves the cable slack [m]


def run(
    robot: Robot,
    seconds: float,
    control: float = 0.0,
    speed: tuple[float, ...] = (0.0, 0.0, 0.0),
    **scales: float,
) -> Trajectory:
    plant = Plant(robot, 0.01, PlantParameters(**scales))
    start = plant.rest()
    velocity = start.qvel.copy()
    velocity[:, :3] = speed
    start = State(start.qpos, velocity, start.act)
    return plant.simulate(start, np.full((1, round(seconds / 0.01), 1), control))


def height(trajectory: Trajectory) -> np.ndarray:
    return trajectory.observations.points[0, :, 0, 2]


def test_a_slack_cable_lets_it_fall_freely() -> None:
    robot = hanging(z=2.0, rest=SLACK)
    trajectory = run(robot, 0.5, speed=(0.7, 0.0, 0.0))
    t = np.arange(51) * 0.01
    # Semi-implicit Euler: n steps of h fall by g h^2 n (n + 1) / 2.
    np.testing.assert_allclose(height(trajectory), 2.0 - G * t * (t + 0.001) / 2, atol=1e-9)
    np.testing.assert_allclose(trajectory.observations.points[0, :, 0, 0], 0.7 * t, atol=1e-9)


@pytest.mark.parametrize(
    ("scales", "factor"),
    [({}, 1.0), ({"mass": 1.3}, 1.3), ({"cable_stiffness": 2.0}, 0.5), ({"friction": 0.3}, 1.0)],
)
def test_a_hanging_mass_stretches_its_cable_by_its_weight(scales, factor):
    trajectory = run(hanging(damping=40.0), 8.0, **scales)
    length = HEIGHT - height(trajectory)[-1]
    assert length - REST == pytest.approx(factor * MASS * G / STIFFNESS, rel=1e-6)


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_it_bounces_on_its_cable_at_the_frequency_of_a_spring(scale: float) -> None:
    stretch = MASS * G / STIFFNESS / scale
    robot = hanging(z=HEIGHT - REST - 1.5 * stretch)
    z = height(run(robot, 4.0, cable_stiffness=scale))
    up = np.flatnonzero((z[:-1] < z.mean()) & (z[1:] >= z.mean()))
    crossing = up + (z.mean() - z[up]) / (z[up + 1] - z[up])
    period = np.diff(crossing).mean() * 0.01
    assert period == pytest.approx(2 * np.pi * np.sqrt(MASS / STIFFNESS / scale), rel=0.01)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_cables_damping_takes_the_energy_that_a_dashpot_does(scale: float) -> None:
    damping = 4.0
    stretch = MASS * G / STIFFNESS
    middle = HEIGHT - REST - stretch
    robot = hanging(z=middle - 0.5 * stretch, damping=damping)
    off = height(run(robot, 2.0, cable_damping=scale)) - middle
    top = np.flatnonzero((off[1:-1] > off[:-2]) & (off[1:-1] >= off[2:]))[-1] + 1
    decay = np.exp(-damping * scale / (2 * MASS) * top * 0.01)
    assert off[top] / (0.5 * stretch) == pytest.approx(decay, rel=0.03)


@pytest.mark.parametrize(("control", "speed"), [(0.3, 1.0), (-0.2, 1.0), (0.3, 1.4), (-0.9, 1.4)])
def test_positive_controls_pay_out_at_their_rate(control: float, speed: float) -> None:
    trajectory = run(hanging(damping=40.0), 0.5, control, winch_speed=speed)
    expected = REST + control * speed * np.arange(51) * 0.01
    np.testing.assert_allclose(trajectory.observations.winch[0, :, 0], expected, atol=1e-9)


def test_controls_and_rest_lengths_end_at_their_limits() -> None:
    paid_out = run(hanging(damping=40.0), 3.0, 5.0)
    assert (paid_out.controls == 1.0).all()
    np.testing.assert_allclose(paid_out.observations.winch[0, 50, 0], REST + 0.5)
    assert paid_out.observations.winch[0, -1, 0] == 2.5


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_friction_stops_a_sliding_box_after_its_distance(scale: float) -> None:
    robot = hanging(z=0.0997, rest=SLACK, shape="box")
    robot = read_robot(robot.xml.replace(f'pos="0 0 {HEIGHT}"', f'pos="0 0 {1.0}"'))
    trajectory = run(robot, 1.5, speed=(1.5, 0.0, 0.0), friction=scale)
    slid = trajectory.observations.points[0, -1, 0, 0]
    assert slid == pytest.approx(1.5**2 / (2 * 0.5 * scale * G), rel=0.06)


def test_contact_stiffness_scales_how_deep_it_rests_in_the_ground() -> None:
    robot = hanging(z=0.1, rest=SLACK)
    robot = read_robot(robot.xml.replace(f'pos="0 0 {HEIGHT}"', f'pos="0 0 {1.0}"'))
    depth = [0.1 - height(run(robot, 3.0, contact_stiffness=s))[-1] for s in (1.0, 0.25)]
    assert depth[0] > 1e-5
    assert depth[1] / depth[0] == pytest.approx(4.0, rel=0.1)


def test_a_passive_cable_with_a_clamped_actuator_only_pulls() -> None:
    below = """
      <general name="tie" tendon="tie" gainprm="0" biastype="affine" biasprm="{pull} -200 -5"
        forcelimited="true" forcerange="-1e4 0"/>
    """
    anchored = '<spatial name="tie"> <site site="floor"/> <site site="bob"/> </spatial>'
    robot = hanging(z=2.0, rest=SLACK)
    xml = (
        robot.xml.replace("</tendon>", anchored + "</tendon>")
        .replace("</actuator>", below.format(pull=200 * 1.8) + "</actuator>")
        .replace('<site name="anchor"', '<site name="floor"/> <site name="anchor"')
    )
    robot = read_robot(xml)
    tie = robot.cables[1]
    assert (tie.winch, tie.stiffness, tie.damping) == (-1, 200.0, 5.0)
    assert tie.rest_length == pytest.approx(1.8)
    assert len(robot.winches) == 1
    z = height(run(robot, 0.4))
    # Pulled down while longer than 1.8 m, then in free fall: never pushed up, even moving fast.
    acceleration = np.diff(z, 2) / 0.01**2
    assert acceleration[0] == pytest.approx(-G - 200 * 0.2 / MASS, rel=0.05)
    falling = np.flatnonzero(z[1:-1] < 1.79)
    np.testing.assert_allclose(acceleration[falling], -G, atol=1e-6)


def test_energy_is_kept_by_an_undamped_cable() -> None:
    stretch = MASS * G / STIFFNESS
    trajectory = run(hanging(z=HEIGHT - REST - 1.9 * stretch), 5.0)
    z, v = height(trajectory), trajectory.states.qvel[0, :, 2]
    spring = STIFFNESS / 2 * np.maximum(HEIGHT - z - REST, 0) ** 2
    energy = MASS * v**2 / 2 + MASS * G * (z - z[0]) + spring
    assert np.ptp(energy) < 0.02 * spring.max()
