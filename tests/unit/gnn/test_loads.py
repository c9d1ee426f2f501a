"""Nodes are shown the accelerations that MuJoCo finds without contacts."""

import mujoco
import numpy as np
import pytest
import torch

from flywheel.dynamics.gnn import NetworkConfig, Simulator
from flywheel.dynamics.gnn.features import MechanicalState
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.poses import FREE_POSITIONS
from flywheel.records import State
from flywheel.robots import GRAVITY, load_robot
from flywheel.rotations import rotate

SAMPLES = 20
WITHOUT = """<mujoco model="arm">
  <option timestep="0.005" integrator="Euler"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <site name="hook" pos="0 0 3"/> <site name="peg" pos="1 1 2.5"/>
    <body name="slab" pos="0.1 0.2 1.5" quat="0.9 0.2 0.3 0.1">
      <freejoint/>
      <geom type="box" size="0.3 0.2 0.05" mass="2" euler="20 30 40"/>
      <geom type="sphere" size="0.05" mass="1" pos="0.4 0.1 0.2"/>
      <site name="a" pos="0.3 0.2 0"/> <site name="b" pos="-0.3 0.2 0.1"/> <site name="c" pos="0 -0.2 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="t0" stiffness="300" damping="20" springlength="0 1.2">
      <site site="hook"/> <site site="a"/>
    </spatial>
    <spatial name="t1" stiffness="100" damping="30" springlength="0 5">
      <site site="peg"/> <site site="b"/>
    </spatial>
    <spatial name="t2"> <site site="peg"/> <site site="c"/> </spatial>
  </tendon>
  <actuator>
    <general name="w" tendon="t2" ctrllimited="true" ctrlrange="-0.3 0.3" dyntype="integrator"
      actlimited="true" actrange="0.5 3" gainprm="500" biastype="affine" biasprm="0 -500 -10"
      forcelimited="true" forcerange="-1e4 0"/>
  </actuator>
  <sensor>
    <framepos objtype="site" objname="a" name="pa"/> <framepos objtype="site" objname="b" name="pb"/>
    <framepos objtype="site" objname="c" name="pc"/>
  </sensor>
  <keyframe><key name="settled" act="1.2" qpos="0.1 0.2 1.5 1 0 0 0"/></keyframe>
</mujoco>"""


def moving(plant: Plant, rng: np.random.Generator) -> State:
    """States near the keyframe, in which no body spins and no winch is at its limit."""
    rest, spread = plant.rest(SAMPLES), 0.01 * plant.robot.length
    qpos, qvel = rest.qpos.copy(), rest.qvel.copy()
    poses = qpos.reshape(SAMPLES, -1, FREE_POSITIONS)
    poses[..., :3] += spread * rng.normal(size=poses[..., :3].shape)
    poses[..., 3:] += 0.02 * rng.normal(size=poses[..., 3:].shape)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    qvel.reshape(SAMPLES, -1, 6)[..., :3] = 0.3 * rng.normal(size=(SAMPLES, poses.shape[1], 3))
    winch = plant.winch(rest)
    return State(qpos, qvel, plant.activation(winch + spread * rng.normal(size=winch.shape)))


def without_contacts(plant: Plant, state: State) -> np.ndarray:
    """(B, P, 3) accelerations of the tracked points by MuJoCo, without the air's resistance [m/s^2]."""
    plant.model.dof_damping[:] = 0.0
    model, data, found = plant.model, mujoco.MjData(plant.model), []
    sites = [
        int(i) for i in model.sensor_objid[model.sensor_type == mujoco.mjtSensor.mjSENS_FRAMEPOS]
    ]
    for qpos, qvel, act in zip(state.qpos, state.qvel, state.act, strict=True):
        data.qpos[:], data.qvel[:], data.act[:] = qpos, qvel, act
        mujoco.mj_forward(model, data)
        data.qacc[:] = data.qacc_smooth
        mujoco.mj_rnePostConstraint(model, data)
        each = np.zeros((len(sites), 6))
        for row, site in zip(each, sites, strict=True):
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_SITE, site, row, 0)
        found.append(each[:, 3:] - [0.0, 0.0, GRAVITY])
    return np.array(found)


@pytest.mark.parametrize("name", ["prism3", "icosa6", "platform4", "of one slab"])
def test_nodes_are_shown_what_mujoco_finds_without_contacts(name, seed, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(WITHOUT)
    robot = load_robot(str(path) if name == "of one slab" else name)
    plant, config = Plant(robot, 0.01), NetworkConfig.lean(yaw_frame=False)
    state = moving(plant, np.random.default_rng(seed))
    parts, points = Simulator(robot, config).parts(), plant.observe(state).points
    frames = parts.frames.of_points(torch.from_numpy(points).float().permute(2, 1, 0))
    poses = state.qpos.reshape(SAMPLES, -1, FREE_POSITIONS)
    sides = np.zeros((3, len(parts.frames.rods), SAMPLES))
    for rod, body in enumerate(parts.frames.rods):
        arms = [parts.frames.across(body, end)[0] for end in (*np.eye(3), np.zeros(3))]
        sides[:, rod] = rotate(poses[:, body, 3:], np.array(arms[:3]) - arms[3]).T
    bodies = [point.body for point in robot.points]
    speeds = state.qvel.reshape(SAMPLES, -1, 6)[:, bodies, :3]  # of bodies that do not turn
    now = MechanicalState(
        frames,
        torch.from_numpy(speeds).float().permute(2, 1, 0),
        torch.from_numpy(plant.winch(state)).float().t(),
        torch.from_numpy(sides).float(),
    )
    origin, winches = torch.zeros(2, SAMPLES), torch.zeros(len(robot.winches), SAMPLES, 0)
    shown = parts.builder(now, origin, None, winches, torch.zeros(1, dtype=torch.int64))
    got = GRAVITY * np.sinh(shown.nodes["body_node"][-3:].permute(2, 1, 0).double().numpy())
    wanted = without_contacts(plant, state)
    assert np.abs(wanted).max() > GRAVITY
    np.testing.assert_allclose(got, wanted, rtol=2e-3, atol=2e-3 * np.abs(wanted).max())


def test_nothing_is_shown_of_loads_in_a_measured_past(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16)
    window, simulator = make_window(robot, config, seed), Simulator(robot, config)
    start = simulator.start(window.past_points, window.past_controls, window.past_winch)
    shown = simulator.parts().builder.memory_features(start.states[0], start.origin)
    assert (shown[-3:] == 0.0).all() and (shown[:3] != 0.0).all()


def test_nodes_are_shown_millimetres_of_their_distance_to_the_ground(robots, make_window, seed):
    robot, config = robots["prism3"], NetworkConfig.lean(width=16)
    window, simulator = make_window(robot, config, seed), Simulator(robot, config)
    parts, radius = simulator.parts(), robot.points[0].radius
    for clearance in (-0.005, 0.0, 0.005, 0.5):
        points = window.past_points.clone()
        points[..., 2] += radius + clearance - points[:, -1:, :, 2].amin(-1, keepdim=True)
        start = simulator.start(points, window.past_controls, window.past_winch)
        state = start.states[-1]
        shown = parts.builder(
            state, start.origin, None, torch.zeros(len(robot.winches), 1, 0), window.dataset
        )
        lowest = shown.nodes["body_node"][-4].amin(0)
        wanted = torch.tensor(clearance / (1e-3 * robot.length)).asinh().expand_as(lowest)
        torch.testing.assert_close(lowest, wanted, rtol=1e-3, atol=1e-3)
