"""Whether a robot comes to rest, and where."""

from dataclasses import replace

import numpy as np
import pytest

from flywheel.diagnosis.fitting.model import ModelUnderTest
from flywheel.dynamics.plant import Plant, settling, swing_period
from flywheel.errors import ModelError
from flywheel.records import Observation, State, Trajectory
from flywheel.robots import GRAVITY, load_robot, read_robot
from tests import draws

PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <site name="hook" pos="0 0 3"/>
    <body name="bob" pos="0 0 2">
      <freejoint/> <geom size=".1" mass="1"/> <site name="bob"/> <site name="end" pos="0 0 -.1"/>
    </body>
  </worldbody>
  <tendon><spatial name="cord" damping="{damping}"><site site="hook"/><site site="bob"/></spatial></tendon>
  <actuator>
    <general name="reel" tendon="cord" dyntype="integrator" ctrllimited="true" ctrlrange="-1 1"
      actlimited="true" actrange="0.5 2" gainprm="5000" biastype="affine" biasprm="0 -5000 0"
      forcelimited="true" forcerange="-999 0"/>
  </actuator>
  <sensor>
    <framepos name="bob" objtype="site" objname="bob"/> <framepos name="end" objtype="site" objname="end"/>
  </sensor>
  <keyframe><key qpos="{x} 0 2 1 0 0 0" act="0.998"/></keyframe>
</mujoco>
"""


def hanging(x: float, damping: float = 5.0) -> Plant:
    return Plant(read_robot(PENDULUM.format(x=x, damping=damping)))


def test_what_lies_still_is_at_rest_where_it_is() -> None:
    plant = Plant(load_robot("prism3"))
    found = settling(plant)
    assert found.still and not found.lost
    assert found.moved < 1e-3 * plant.robot.length
    assert found.rest is not None


def test_a_pendulum_swings_about_where_it_rests() -> None:
    found = settling(hanging(0.03))
    assert not found.still and not found.lost and not found.grows
    assert found.early == pytest.approx(0.03 * np.sqrt(9.81 / 2), rel=0.1)  # half the energy moves
    assert found.rest is not None
    assert np.abs(found.rest.qpos[0, :3] - [0, 0, 2]).max() < 1e-3
    assert found.moved == pytest.approx(0.03, abs=2e-3)
    assert found.period == pytest.approx(2 * np.pi / np.sqrt(9.81), rel=0.005)


def test_windows_of_a_hanging_robot_are_as_long_as_it_swings() -> None:
    swinging, calm = hanging(0.03), Plant(load_robot("platform4"))
    period = 2 * np.pi / np.sqrt(9.81)
    assert swing_period(swinging) == pytest.approx(period, rel=0.005)
    assert swing_period(calm) == swing_period(Plant(load_robot("prism3"))) == 0.0
    assert swing_period(hanging(0.0)) == 0.0
    for plant, wanted in ((swinging, period), (calm, 1.8 * np.sqrt(calm.robot.length / GRAVITY))):
        steps = round(12.0 / plant.dt)
        hold = plant.robot.holding(plant.robot.winch_of(plant.robot.keyframe))
        seen = plant.simulate(plant.rest(), np.tile(hold, (1, steps, 1))).observations[0]
        points = seen.points + np.random.default_rng(draws.seed()).normal(
            0, 1e-4, seen.points.shape
        )
        track = Trajectory(Observation(points, seen.winch), np.tile(hold, (steps, 1)), plant.dt)
        windows = ModelUnderTest(plant, None, 0).windows([track])
        assert windows.steps * plant.dt == pytest.approx(wanted, rel=0.1)
        asked = ModelUnderTest(plant, None, 0).windows([track], seconds=0.7)
        assert asked.steps * plant.dt == pytest.approx(0.7, rel=0.1)


def test_its_time_constant_is_that_of_its_motion() -> None:
    found = settling(hanging(0.3, damping=20.0))
    assert found.time_constant == pytest.approx(10.0 / np.log(found.early / found.late))
    assert replace(found, late=found.early).time_constant == np.inf
    assert replace(found, late=2 * found.early).grows


def test_what_falls_for_ever_is_lost() -> None:
    xml = load_robot("prism3").xml.replace(
        'geom name="ground"', 'geom name="ground" pos="0 0 -999"'
    )
    assert settling(Plant(read_robot(xml))).lost


def test_nobody_waits_for_ever() -> None:
    with pytest.raises(ModelError, match=r"too slow: 0.25 s took .* s"):
        settling(hanging(0.0), patience=0.0)


def test_watching_changes_nothing() -> None:
    plant = hanging(0.03)
    found = settling(plant)
    again: State = plant.settle(5.0)
    assert found.rest is not None and not np.array_equal(found.rest.qpos, again.qpos)
    still = Plant(load_robot("platform4"))
    rest = settling(still).rest
    assert rest is not None
    np.testing.assert_array_equal(rest.qpos, still.settle(5.0).qpos)
