"""The rigid-body engine against formulas, and against MuJoCo where nothing touches."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from flywheel.dynamics.baselines.engine import CONTACT, USUAL, EngineConfig, RigidBodyEngine
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.rigid_bodies.ground import flat_ground
from flywheel.dynamics.rigid_bodies.mechanics import ContactNumbers, Mechanics, RigidState
from flywheel.records import Floats, State
from flywheel.robots import ROBOTS, Cable, Robot, load_robot, read_robot
from tests.physics.small_robots import HEIGHT, MASS, REST, STIFFNESS, hanging

G, DT, RADIUS = 9.81, 0.002, 0.1
ROD = """
<mujoco model="rod">
  <worldbody>
    <geom type="plane" size="9 9 .1"/> <site name="hook" pos="0 0 5"/>
    <body name="rod" pos="0 0 0.1" euler="0 90 0">
      <freejoint/>
      <geom type="cylinder" size="0.02 0.5" mass="1" contype="0" conaffinity="0"/>
      <geom type="sphere" size="0.1" mass="1" pos="0 0 -0.5"/>
      <geom type="sphere" size="0.1" mass="1" pos="0 0 0.5"/>
      <site name="a" pos="0 0 -0.5"/> <site name="b" pos="0 0 0.5"/>
    </body>
  </worldbody>
  <tendon> <spatial name="c"> <site site="hook"/> <site site="a"/> </spatial> </tendon>
  <actuator>
    <general name="w" tendon="c" dyntype="integrator" ctrllimited="true" ctrlrange="-1 1" actlimited="true"
      actrange="0.2 9" gainprm="1" biastype="affine" biasprm="0 -1 0" forcelimited="true" forcerange="-9 0"/>
  </actuator>
  <sensor>
    <framepos name="a" objtype="site" objname="a"/> <framepos name="b" objtype="site" objname="b"/>
  </sensor>
  <keyframe> <key qpos="0 0 0.1 0.7071067811865476 0 0.7071067811865476 0" act="9"/> </keyframe>
</mujoco>
"""
SLACK = 2.5  # rest length that leaves the cable slack [m]


def moved(
    robot: Robot,
    steps: int,
    velocity: tuple[float, ...] = (0.0, 0.0, 0.0),
    height: float | None = None,
    **contact: float,
) -> Floats:
    """(steps + 1, 3) path of the ball of a robot of `small_robots`, in steps of DT."""
    engine = RigidBodyEngine(robot, DT, EngineConfig(attachments="mjcf"))
    engine.substeps = 1
    key = robot.keyframe
    qpos, qvel = key.qpos[None].copy(), np.zeros((1, 6))
    qpos[0, 2] = key.qpos[2] if height is None else height
    qvel[0, :3] = velocity
    rest = engine.rest(np.repeat(key.act[None, None], steps + 1, axis=1))
    numbers = torch.tensor([contact.get(name, usual) for name, (_, usual, _) in CONTACT.items()])
    begun = State(qpos, qvel, key.act[None])
    return np.asarray(engine.simulate(begun, rest, numbers, flat_ground)[:, :, 0, 0])


def test_without_forces_but_gravity_it_falls_freely() -> None:
    path, t = moved(hanging(z=2.0, rest=SLACK), 100, velocity=(0.7, 0.0, 0.0)), DT * np.arange(101)
    np.testing.assert_allclose(path[:, 2], 2.0 - G * t * (t + DT) / 2, atol=1e-12)
    np.testing.assert_allclose(path[:, 0], 0.7 * t, atol=1e-12)


def test_it_bounces_on_its_cable_at_the_frequency_of_a_spring() -> None:
    stretch = MASS * G / STIFFNESS
    z = moved(hanging(z=HEIGHT - REST - 1.5 * stretch), 1500)[:, 2]
    up = np.flatnonzero((z[:-1] < z.mean()) & (z[1:] >= z.mean()))
    crossing = DT * (up + (z.mean() - z[up]) / (z[up + 1] - z[up]))
    assert np.diff(crossing).mean() == pytest.approx(
        2 * np.pi * np.sqrt(MASS / STIFFNESS), rel=1e-3
    )
    assert np.ptp(z) == pytest.approx(stretch, rel=1e-2)


def test_a_damped_cable_comes_to_rest_at_the_weight_over_its_stiffness() -> None:
    z = moved(hanging(damping=40.0), 3000)[:, 2]
    assert HEIGHT - z[-1] - REST == pytest.approx(MASS * G / STIFFNESS, rel=1e-6)


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_sliding_ball_slows_by_friction_until_it_rolls_at_five_sevenths(friction: float) -> None:
    speed = 2.0
    robot = hanging(z=RADIUS, rest=SLACK)
    numbers = {"restitution": 0.0, "sticking": 1.0, "friction": friction}
    x = moved(replace(robot, cables=loose(robot)), 1000, velocity=(speed, 0, 0), **numbers)[:, 0]
    v, t = np.diff(x) / DT, DT * np.arange(1000)
    rolls = 2 / 7 * speed / (friction * G)
    sliding = t < 0.9 * rolls
    np.testing.assert_allclose(v[sliding], speed - friction * G * (t + DT)[sliding], atol=1e-3)
    np.testing.assert_allclose(v[t > 1.2 * rolls], 5 / 7 * speed, rtol=1e-3)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_a_ball_bounces_to_the_square_of_the_restitution(restitution: float) -> None:
    drop = 0.5
    robot = hanging(z=RADIUS + drop, rest=SLACK)
    z = moved(replace(robot, cables=loose(robot)), 400, restitution=restitution)[:, 2] - RADIUS
    landed = int(np.argmax(z < 5e-3))
    assert z[landed + 3 :].max() == pytest.approx(restitution**2 * drop, abs=0.02 * drop)
    assert z.min() > -1e-3


def test_a_ball_at_rest_stays_at_rest() -> None:
    robot = hanging(z=RADIUS, rest=SLACK)
    path = moved(replace(robot, cables=loose(robot)), 500, restitution=0.0)
    np.testing.assert_allclose(path, path[:1].repeat(501, axis=0), atol=1e-4)


def test_a_step_removes_the_given_share_of_a_penetration() -> None:
    robot = hanging(z=RADIUS, rest=SLACK)
    numbers = {"restitution": 0.0, "depth_share": 0.25}
    z = moved(replace(robot, cables=loose(robot)), 1, height=RADIUS - 0.02, **numbers)[:, 2]
    assert z[1] - RADIUS == pytest.approx(-0.75 * 0.02, abs=1e-12)


def stepped(
    robot: Robot, velocity: Floats, height: float, h: float, **contact: float
) -> RigidState:
    """The state after one step of a robot of one body at a height, moving and turning, without gravity."""
    key = robot.keyframe
    qpos = key.qpos[None].copy()
    qpos[0, 2] = height
    state = RigidState.of(robot, State(qpos, np.zeros((1, 6)), key.act[None]))
    speeds = torch.tensor(velocity, dtype=torch.float64)[:, None, None]
    state = RigidState(
        state.centre,
        state.axes,
        speeds[:3] + h * torch.tensor([[[0.0]], [[0.0]], [[G]]]),
        speeds[3:],
    )
    numbers = {name: contact.get(name, usual) for name, (_, usual, _) in CONTACT.items()}
    tensors = {name: torch.tensor(value) for name, value in numbers.items()}
    rest = torch.full((1, 1), 9.0, dtype=torch.float64)
    return Mechanics(robot).step(state, rest, h, ContactNumbers(**tensors), flat_ground)


def test_a_ball_gets_its_impulse_when_it_arrives() -> None:
    h, robot = 0.01, hanging(z=RADIUS, rest=SLACK)
    robot = replace(robot, cables=loose(robot))
    numbers = {"restitution": 0.0, "sticking": 1.0, "friction": 1e6}
    got = stepped(robot, np.array([1.0, 0, -2.0, 0, 0, 0]), RADIUS + 0.01, h, **numbers)
    assert got.centre[2].item() == pytest.approx(RADIUS, abs=1e-9)
    assert got.velocity[2].item() == pytest.approx(0.0, abs=1e-9)
    # Half of the step it flew at 1 m/s, then it rolled at 5/7 of that.
    assert got.centre[0].item() == pytest.approx((1.0 + 5 / 7) * h / 2, abs=1e-9)
    turned = np.arccos((got.axes[:, 0, 0, 0] @ start_axes(robot)[:, 0, 0, 0]).item())
    assert got.rate[1].item() == pytest.approx(5 / 7 / RADIUS, abs=1e-6)
    assert turned == pytest.approx(5 / 7 / RADIUS * h / 2, rel=1e-3)


def start_axes(robot: Robot) -> torch.Tensor:
    key = robot.keyframe
    return RigidState.of(robot, State(key.qpos[None], np.zeros((1, 6)), key.act[None])).axes


@pytest.mark.parametrize(("rolling", "left"), [(0.0, 1.0), (0.25, 0.75), (1.0, 0.0)])
def test_a_touching_rod_loses_a_share_of_its_spin(rolling, left) -> None:
    robot, spin = read_robot(ROD), np.array([0, 0, -1e-9, 3.0, 0, 0])
    numbers = {"friction": 1e-9, "rolling": rolling}
    assert stepped(robot, spin, 0.1, 0.01, **numbers).rate[0].item() == pytest.approx(3.0 * left)
    assert stepped(robot, spin, 0.3, 0.01, **numbers).rate[0].item() == pytest.approx(3.0)


def test_a_rod_that_may_not_roll_stops_where_it_sticks() -> None:
    robot, pushed = read_robot(ROD), np.array([0, 1.0, -1e-9, 0, 0, 0])
    numbers = {"sticking": 1.0, "friction": 1e12}
    held = stepped(robot, pushed, 0.1, 0.01, rolling=1.0, **numbers)

    assert held.rate[0].item() == pytest.approx(0.0, abs=1e-9)
    alone = stepped(robot, pushed, 0.1, 0.01, rolling=0.0, **numbers)
    assert abs(held.velocity[1].item()) < abs(alone.velocity[1].item())
    assert alone.rate[0].item() < -1.0


def test_slack_cables_pull_nothing_and_passive_ones_still_damp() -> None:
    robot = load_robot("prism3")
    mechanics, rest = Mechanics(robot), torch.full((15, 1), 9.0, dtype=torch.float64)
    still = RigidState.of(robot, Plant(robot).rest())
    assert all(part.abs().max() == 0.0 for part in mechanics.cables.wrench(still, rest))
    moving = RigidState(still.centre, still.axes, still.centre.clone(), still.rate)
    force, _ = mechanics.cables.wrench(moving, rest)
    assert force.abs().max() > 1.0


def loose(robot: Robot) -> tuple[Cable, ...]:
    """Its cables without any force."""
    return tuple(replace(cable, stiffness=0.0, damping=0.0) for cable in robot.cables)


@pytest.mark.parametrize(("speed", "tolerance"), [(0.0, 1e-3), (0.3, 1e-2)])
def test_without_contact_it_moves_as_mujoco_does(speed: float, tolerance: float) -> None:
    robot, steps = load_robot("prism3"), 30
    plant = Plant(robot, 0.01)
    start, rng = plant.rest(), np.random.default_rng(0)
    qpos = start.qpos.copy()
    qpos.reshape(-1, 7)[:, 2] += 50.0  # falls for a while, pulled by its cables
    start = State(qpos, speed * rng.normal(size=start.qvel.shape), start.act)
    winch = np.repeat(plant.winch(start)[:, None], steps + 1, axis=1)
    truth = plant.simulate(start, robot.holding(winch)[:, 1:]).observations.points

    engine = RigidBodyEngine(robot, 0.01, EngineConfig(attachments="mjcf"))
    engine.substeps = plant.substeps
    found = engine.simulate(start, engine.rest(winch), torch.tensor(USUAL), None)
    off = np.abs(found.permute(3, 0, 2, 1).numpy() - truth).max()
    assert off < tolerance * np.abs(truth - truth[:, :1]).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_momentum_changes_by_weight_and_anchors_alone(name: str) -> None:
    robot = load_robot(name)
    state = RigidState.of(robot, Plant(robot).rest())
    mechanics = Mechanics(robot)
    rest = torch.full((len(robot.cables), 1), 0.3, dtype=torch.float64)
    force, torque = mechanics.cables.wrench(state, rest)
    assert force.abs().max() > 1.0
    if robot.tethered:
        return
    weight = force.abs().max()
    moment = (torch.linalg.cross(state.centre, force, dim=0) + torque).sum(1)
    np.testing.assert_allclose(force.sum(1) / weight, 0.0, atol=1e-9)
    np.testing.assert_allclose(moment / weight, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_state_has_the_points_and_speeds_of_the_plants(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(1)
    rest = Plant(robot).rest(3)
    qpos = rest.qpos + 0.1 * rng.normal(size=rest.qpos.shape)
    quaternions = qpos.reshape(3, -1, 7)[..., 3:]
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    state = State(qpos, rng.normal(size=rest.qvel.shape), rest.act)
    mechanics, moving = Mechanics(robot), RigidState.of(robot, state)
    seen = mechanics.seen(moving).permute(2, 1, 0).numpy()
    np.testing.assert_allclose(seen, robot.points_of(state), atol=1e-12)
    h, points = 1e-6, mechanics.points
    speed = points.velocities(moving, points.arms(moving)).permute(2, 1, 0).numpy()
    later = RigidState(
        moving.centre + h * moving.velocity,
        moving.axes
        + h * torch.linalg.cross(moving.rate[:, None].expand_as(moving.axes), moving.axes, dim=0),
        moving.velocity,
        moving.rate,
    )
    np.testing.assert_allclose(
        (mechanics.seen(later).permute(2, 1, 0).numpy() - seen) / h, speed, atol=1e-5
    )


def test_a_gradient_is_the_slope() -> None:
    robot = load_robot("prism3")
    engine, plant = RigidBodyEngine(robot, 0.01), Plant(robot)
    start = plant.settle(1.0)
    qvel = start.qvel.copy()
    qvel[:, [0, 6, 12]] = 1.0  # slides
    start = State(start.qpos, qvel, start.act)
    rest = engine.rest(np.repeat(plant.winch(start)[:, None], 6, axis=1))

    def far(contact: torch.Tensor) -> torch.Tensor:
        return engine.simulate(start, rest, contact, flat_ground)[-1, 0].sum()

    contact = torch.tensor(USUAL, requires_grad=True)
    (slope,) = torch.autograd.grad(far(contact), contact)
    assert slope.abs().max() > 1e-3
    for i in range(len(USUAL)):
        step = 1e-6 * torch.eye(len(USUAL), dtype=torch.float64)[i]
        difference = (far(contact + step) - far(contact - step)) / 2e-6
        assert slope[i].item() == pytest.approx(difference.item(), rel=1e-3, abs=1e-6)
