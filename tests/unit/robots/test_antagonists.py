"""Two cables on one motor: one reels in what the other pays out."""

import re

import numpy as np
import pytest

from flywheel.data.recordings import read_recording, write_recording
from flywheel.diagnosis.comparison import Subject, compare
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.roll import rest_lengths
from flywheel.effects import EFFECTS
from flywheel.errors import RobotError
from flywheel.options import ComparisonOptions
from flywheel.records import Episode, Observation, Provenance, Trajectory
from flywheel.robots import Robot, read_robot

NOISE = 2e-4  # [m]
RATE = 'dyntype="integrator" ctrllimited="true" ctrlrange="-0.1 0.1"'
POSITION = 'dyntype="filterexact" dynprm="0.05"'
SPRING = (
    'gainprm="900" biastype="affine" biasprm="0 -900 -9" forcelimited="true" forcerange="-300 0"'
)
ANCHORS = [
    ("left", -2, 1),
    ("right", 2, 1),
    ("top", 0, 2.5),
    ("front", 0.3, -0.5),
    ("back", -0.3, -0.5),
]


def antagonists(dynamics: str = RATE, limit: str = "act") -> Robot:
    """A box between a left and a right cable on one drum, held by three stays."""
    sites = "".join(f'<site name="{name}" pos="{x} 0 {z}"/>' for name, x, z in ANCHORS)
    stays = "".join(
        f'<spatial name="{name}_stay" stiffness="200" damping="9" springlength="0 {rest}">'
        f'<site site="{name}"/><site site="{end}"/></spatial>'
        for name, end, rest in (("top", "up", 1.2), ("front", "e", 1.3), ("back", "w", 1.3))
    )
    return read_robot(f"""<mujoco model="pair"><option timestep="0.005" integrator="implicitfast"/>
  <worldbody>{sites}
    <body name="box" pos="0 0 1"><freejoint/>
      <geom type="box" size=".2 .1 .1" mass="3"/>
      <site name="w" pos="-.2 0 0"/><site name="e" pos=".2 0 0"/><site name="up" pos="0 .1 .1"/>
    </body>
  </worldbody>
  <tendon>{stays}
    <spatial name="l"><site site="left"/><site site="w"/></spatial>
    <spatial name="r"><site site="right"/><site site="e"/></spatial>
  </tendon>
  <actuator>
    <general name="in" tendon="l" {dynamics} {limit}limited="true" {limit}range="1.4 2" {SPRING}/>
    <general name="out" tendon="r" {dynamics} {limit}limited="true" {limit}range="1.3 1.9" {SPRING}/>
  </actuator>
  <custom><tuple name="pair">
    <element objtype="actuator" objname="in"/><element objtype="actuator" objname="out" prm="-1"/>
  </tuple></custom>
  <sensor>
    <framepos name="m0" objtype="site" objname="w"/><framepos name="m1" objtype="site" objname="e"/>
    <framepos name="m2" objtype="site" objname="up"/>
  </sensor>
  <keyframe><key qpos="0 0 1 1 0 0 0" act="1.7 1.6"/></keyframe>
</mujoco>""")


@pytest.mark.parametrize(
    ("robot", "told"), [(antagonists(), 0.1), (antagonists(POSITION, "ctrl"), 1.8)]
)
def test_one_cable_reels_in_what_the_other_pays_out(robot: Robot, told: float):
    (pair,) = robot.winches
    assert pair.ratios == (1.0, -1.0) and pair.rest_range == (1.4, 2.0)
    plant = Plant(robot)
    after = plant.simulate(plant.settle(1.0), np.full((1, 100, 1), told)).states[:, -1]
    assert after.act[0] == pytest.approx([1.8, 1.5], abs=1e-6)
    assert plant.activation(plant.winch(after)) == pytest.approx(after.act)
    lengths = dict(
        zip([c.name for c in robot.cables], rest_lengths(robot, plant.winch(after))[0], strict=True)
    )
    assert (lengths["l"], lengths["r"]) == pytest.approx((1.8, 1.5), abs=1e-6)


def test_ranges_that_are_no_mirror_of_each_other_are_refused():
    text = antagonists().xml.replace('actrange="1.3 1.9"', 'actrange="1.3 2"')
    with pytest.raises(RobotError, match=re.escape("(-0.1 m), times -1 (the ratio of their prm)")):
        read_robot(text)


def test_a_log_has_one_column_for_both_and_its_model_is_noise_only(tmp_path):
    robot, rng = antagonists(), np.random.default_rng(0)
    plant, told = Plant(robot), np.repeat(rng.uniform(-0.1, 0.1, (8, 1)), 25, axis=0)
    points = plant.simulate(plant.settle(4.0), told[None]).observations.points[0]
    seen = Observation(points + rng.normal(0, NOISE, points.shape), np.full((201, 1), np.nan))
    episode = Episode("e", Trajectory(seen, told, 0.01), Provenance(robot.digest), "train")
    write_recording(episode, tmp_path / "log.csv", robot)
    (back,) = read_recording(tmp_path / "log.csv", robot).episodes
    found = compare(
        [Subject.of_plant("plant", plant)], [back.trajectory], ComparisonOptions(draws=40)
    )
    assert found.models[0].outcome == "NOISE_ONLY"


def test_networks_and_effects_of_load_have_no_antagonists():
    with pytest.raises(RobotError, match="it has antagonists on one winch"):
        ChunkNetwork(antagonists(), NetworkConfig.lean())
    with pytest.raises(
        RobotError, match="torque_speed has no meaning on pair, whose winches drive"
    ):
        EFFECTS["torque_speed"].require_place(antagonists())
    assert EFFECTS["winch_gain"].places(antagonists()) == (None,)
