"""Every number that is read off an MJCF is finite, and in its range."""

import re

import pytest

from flywheel.errors import RobotError
from flywheel.robots import ROBOTS, load_robot, read_robot
from tests.unit.robots.test_refusals import edited

BEGIN = '<mujoco model="lamp">'
STAY = '<spatial name="stay"'
HINGE = ("<freejoint/>", '<joint name="pin" range="-10 10"/>')
BALL = 'size=".1" mass="1"'


def option(text: str) -> tuple[str, str]:
    return (BEGIN, f"{BEGIN}<option {text}/>")


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ([option('timestep="inf"')], "<option> has timestep inf s; allowed 1e-05 to 0.1 s"),
        ([option('timestep="1e-9"')], "has timestep 1e-09 s"),
        ([option('timestep="10"')], "has timestep 10 s"),
        ([option('gravity="0 0 inf"')], "has gravity inf m/s^2"),
        (
            [option('gravity="0 0 -9810"')],
            "to 1000 m/s^2. Lengths are in metres, not in millimetres.",
        ),
        ([option('impratio="-1"')], "has impratio -1"),
        ([option('iterations="999999999" tolerance="0"')], "has iterations 1e+09; allowed 1 to"),
        ([option('o_solref="-1 1"')], "<option> needs solref with two numbers above 0"),
        ([(STAY, f'{STAY} damping="-inf"')], "tendon 'stay' has damping -inf N s/m; allowed 0 to"),
        ([('stiffness="20"', 'stiffness="-20"')], "tendon 'stay' has stiffness -20 N/m"),
        ([('springlength="0 1.2"', 'springlength="0 inf"')], "'stay' has springlength inf m"),
        ([(STAY, f'{STAY} limited="true" range="1 2"')], "'stay' (1 m) would push when shorter"),
        ([(BALL, 'size=".1" mass="inf"')], "body 'shade' has mass inf kg"),
        ([(BALL, 'size="1e200" mass="1"')], "geom 'shade' has size 1e+200 m"),
        ([(BALL, f'{BALL} friction="-1 0 0"')], "geom 'shade' has friction -1"),
        ([(BALL, f'{BALL} solref="-1 1"')], "geom 'shade' needs solref"),
        ([(BALL, f'{BALL} solimp="5 6 -1 2 0"')], "geom 'shade' has solimp 5 6 -1 2 0"),
        ([('<site name="shade"/>', '<site name="shade" pos="1e9 0 0"/>')], "'shade' has pos 1e+09"),
        (
            [('qpos="0 0 2', 'qpos="1e300 0 2')],
            "keyframe number 0 (counted from 0) has qpos 1e+300",
        ),
        ([(' act="1"/>', ' act="inf"/>')], "has act inf m"),
        ([(' act="1"/>', ' act="1" qvel="1e9 0 0 0 0 0"/>')], "has qvel 1e+09 m/s"),
        ([('gainprm="500"', 'gainprm="inf"')], "actuator 'reel' has gainprm inf"),
        ([('ctrlrange="-1 1"', 'ctrlrange="-inf inf"')], "actuator 'reel' has ctrlrange -inf"),
        ([('ctrlrange="-1 1"', 'ctrlrange="0.5 1"')], "'reel' must be able to hold"),
        ([('actrange="0.5 2"', 'actrange="-2 2"')], "'reel' must have no actrange below 0"),
        (
            [
                ('dyntype="integrator"', 'dyntype="filterexact"'),
                ('ctrlrange="-1 1"', 'ctrlrange="1.5 2"'),
            ],
            "actuator 'reel' at rest length 1, allowed 1.5 to 2 m",
        ),
        ([HINGE, ('qpos="0 0 2 1 0 0 0"', 'qpos="5"')], "joint 'pin' at 5, allowed -0.17"),
        ([("<worldbody>", '<worldbody><camera pos="inf 0 0"/>')], "camera number 0 (counted from"),
        ([("<sensor>", '<custom><numeric name="n" data="inf"/></custom><sensor>')], "has data inf"),
        ([(BEGIN, f'{BEGIN}<option><flag sensor="disable"/></option>')], "switches off a"),
        (
            [("<framepos", '<framepos nsample="9" delay=".01" interp="linear"')],
            "has a state beyond positions",
        ),
        (
            [
                ('actrange="0.5 2"', 'actrange="1e-9 2"'),
                (' act="1"/>', ' act="1e-9"/>'),
                ('"0 1.2"', '"0 1e-9"'),
            ],
            "is 1e-09 m; at least 0.001 m",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_number_that_makes_no_sense_is_refused_with_its_element(edits, message):
    with pytest.raises(RobotError, match=re.escape(message)):
        read_robot(edited(*edits))


def test_bodies_within_each_other_are_refused() -> None:
    balls = (
        '<replicate count="110"><body pos="0 0 9"><freejoint/><geom size=".1"/></body></replicate>'
    )
    bodies = edited(("<worldbody>", f"<worldbody>{balls}"))
    poses = " 0 0 9 1 0 0 0" * 110
    with pytest.raises(RobotError, match="5,995 contacts, at most 5,000 are allowed"):
        read_robot(
            bodies.replace('<key qpos="', f'<key qpos="{poses} ').replace(
                "<body pos", '<body name="b" pos'
            )
        )


@pytest.mark.parametrize("name", ROBOTS)
def test_the_shipped_robots_have_sensible_numbers_only(name: str) -> None:
    assert load_robot(name).length > 0
