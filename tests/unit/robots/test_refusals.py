"""What an MJCF must not be, and the message that says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flywheel.errors import MjcfError, RobotError, UnknownNameError
from flywheel.robots import load_robot, read_robot

GOOD = """
<mujoco model="lamp">
  <worldbody>
    <geom name="ground" type="plane" size="5 5 .1"/>
    <site name="ceiling" pos="0 0 3"/>
    <site name="hook" pos="1 0 3"/>
    <body name="shade" pos="0 0 2">
      <freejoint/>
      <geom name="shade" size=".1" mass="1"/>
      <site name="shade"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cord"><site site="ceiling"/><site site="shade"/></spatial>
    <spatial name="stay" stiffness="20" springlength="0 1.2"><site site="hook"/><site site="shade"/></spatial>
  </tendon>
  <actuator>
    <general name="reel" tendon="cord" dyntype="integrator" ctrllimited="true" ctrlrange="-1 1"
      actlimited="true" actrange="0.5 2" gainprm="500" biastype="affine" biasprm="0 -500 -5"
      forcelimited="true" forcerange="-99 0"/>
  </actuator>
  <sensor><framepos name="light" objtype="site" objname="shade"/></sensor>
  <keyframe><key qpos="0 0 2 1 0 0 0" act="1"/></keyframe>
</mujoco>
"""
SECOND_BODY = """
    <body name="weight" pos="0 0 1">
      <freejoint/> <geom name="weight" size=".1" mass="1"/> <site name="weight"/>
    </body>
  </worldbody>"""
SECOND_REEL = """
    <general name="spool" tendon="{tendon}" dyntype="integrator" ctrllimited="true" ctrlrange="-1 1"
      actlimited="true" actrange="{range}" gainprm="500" biastype="affine" biasprm="0 -500 -5"
      forcelimited="true" forcerange="-99 0"/>
  </actuator>"""
PAIR = """
  <custom><tuple name="pair">
    <element objtype="actuator" objname="reel"/> <element objtype="{kind}" objname="{second}"/>
  </tuple></custom>
  <sensor>"""
ALONE = """
  <custom><tuple name="reel"> <element objtype="actuator" objname="spool"/> </tuple></custom>
  <sensor>"""


OFF_SIDEWAYS = '<option gravity="0 -9.81 0"><flag gravity="disable"/></option><worldbody>'


def with_option(attributes: str) -> str:
    return edited(("<worldbody>", f"<option {attributes}/><worldbody>"))


def edited(*edits: tuple[str, str]) -> str:
    xml = GOOD
    for old, new in edits:
        assert old in xml, old
        xml = xml.replace(old, new)
    return xml


def test_the_example_itself_is_accepted() -> None:
    robot = read_robot(GOOD)
    assert [w.name for w in robot.winches] == ["reel"]
    assert [c.winch for c in robot.cables] == [0, -1]
    assert [c.ends[0].body for c in robot.cables] == [-1, -1]
    assert robot.points[0].radius == 0.1
    assert robot.length == 1.2  # one point per body: the longest rest length
    assert robot.grounded


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ([("</mujoco>", "")], "not valid XML"),
        ([('<mujoco model="lamp">', "<mujoco>")], "no name.*<mujoco model="),
        (
            [("<tendon>", '<asset><mesh file="a.obj"/></asset><tendon>')],
            "another file.*mesh.*a.obj",
        ),
        ([('size=".1" mass="1"', 'size="-1" mass="1"')], "MuJoCo cannot compile"),
        ([('name="stay"', 'name="cord"')], "MuJoCo cannot compile.*repeated name"),
        ([('<spatial name="stay"', "<spatial")], "tendon number 1 .*no name"),
        ([('<framepos name="light"', "<framepos")], "sensor number 0 .*no name"),
        ([('<general name="reel"', "<general")], "actuator number 0 .*no name"),
        ([('<body name="shade"', "<body")], "moving body number 1 has no name"),
        ([('<key qpos="0 0 2 1 0 0 0" act="1"/>', "")], "no keyframe"),
        ([(' act="1"/>', "/>")], "'reel' at rest length 0, allowed 0.5 to 2"),
        ([(' act="1"/>', ' act="3"/>')], "'reel' at rest length 3, allowed 0.5 to 2"),
        (
            [('objtype="site" objname="shade"', 'objtype="body" objname="shade"')],
            "'light' must give",
        ),
        ([('objname="shade"/>', 'objname="hook"/>')], "'light' is on a body that cannot move"),
        (
            [('<framepos name="light" objtype="site" objname="shade"/>', "")],
            "no framepos sensor",
        ),
        ([("</worldbody>", SECOND_BODY)], "Nothing measures the body 'weight'"),
        (
            [
                (
                    '<site site="hook"/><site site="shade"/>',
                    '<site site="hook"/><site site="ceiling"/>',
                )
            ],
            "'stay' has both ends on the world",
        ),
        (
            [
                ('<site name="shade"/>', '<site name="shade"/><site name="b"/>'),
                ('<site site="hook"/><site site="shade"/>', '<site site="b"/><site site="shade"/>'),
            ],
            "'stay' has both ends on the body 'shade'",
        ),
        (
            [('<site site="hook"/>', '<site site="hook"/><site site="ceiling"/>')],
            "'stay' passes site -> site -> site",
        ),
        (
            [
                ('<site site="hook"/>', '<site site="hook"/><geom geom="ground"/>'),
                ('type="plane" size="5 5 .1"', 'type="sphere" size=".1" pos="0 0 -1"'),
            ],
            "'stay' passes site -> sphere -> site",
        ),
        (
            [('springlength="0 1.2"', 'springlength="1.2"')],
            "'stay' would push.*springlength=\"0 1.2\"",
        ),
        ([('stiffness="20" springlength="0 1.2"', "")], "Nothing pulls the tendon 'stay'"),
        (
            [('<spatial name="cord">', '<spatial name="cord" stiffness="9">')],
            "'cord' has a winch and",
        ),
        ([('ctrllimited="true" ctrlrange="-1 1"', "")], "'reel' must have a ctrlrange"),
        ([('actlimited="true" actrange="0.5 2"', "")], "'reel' must have an actrange"),
        (
            [('forcerange="-99 0"', 'forcerange="-99 99"')],
            r"'reel' must only pull.*\(-99.0, 99.0\)",
        ),
        ([('biasprm="0 -500 -5"', 'biasprm="0 -5 -5"')], 'gainprm 500 and biasprm "0 -5 -5"'),
        ([('dyntype="integrator"', 'dyntype="filter" dynprm=".1"')], "'reel' must have dyntype"),
        ([('tendon="cord"', 'site="shade"')], "'reel' must drive a tendon"),
        ([('tendon="cord"', 'tendon="cord" gear="2"')], "'reel' must have gear 1"),
        ([('gainprm="500"', 'gainprm="0"')], "no winch"),
        (
            [
                ("</actuator>", SECOND_REEL.format(tendon="cord", range="0.5 2")),
                (' act="1"/>', ' act="1 1"/>'),
            ],
            "'cord' is driven by 'reel' and 'spool'",
        ),
        (
            [
                ("</actuator>", SECOND_REEL.format(tendon="stay", range="0.5 2")),
                ('stiffness="20" springlength="0 1.2"', ""),
                (' act="1"/>', ' act="1 1.1"/>'),
                ("<sensor>", PAIR.format(kind="actuator", second="spool")),
            ],
            "'reel' and 'spool' of winch 'pair' must have the same",
        ),
        (
            [("<sensor>", PAIR.format(kind="body", second="shade"))],
            "tuple 'pair' must list actuators of winches only",
        ),
        (
            [
                ("</actuator>", SECOND_REEL.format(tendon="stay", range="0.6 2.1")),
                ('stiffness="20" springlength="0 1.2"', ""),
                (' act="1"/>', ' act="1 1.1"/>'),
                ("<sensor>", ALONE),
            ],
            "both named 'reel'",
        ),
        (
            [("<sensor>", '<sensor><user name="time" objtype="actuator" objname="reel" dim="1"/>')],
            "2 columns .* named 'time'",
        ),
        (
            [('name="reel"', 'name="x"'), ('<framepos name="light"', '<framepos name="ctrl"')],
            "named 'ctrl.x'",
        ),
        (
            [
                ("<worldbody>", '<option actuatorgroupdisable="1 3"/><worldbody>'),
                ("<general", '<general group="3"'),
            ],
            "'reel' is in group 3, which .* switches off",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_it_is_refused_with_the_element_named(edits: list[tuple[str, str]], message: str) -> None:
    with pytest.raises(RobotError, match=message):
        read_robot(edited(*edits))


@pytest.mark.parametrize(
    ("gravity", "where"),
    [
        ("0 -98.1 0", r"-y .*write gravity=\"0 0 -98.1\""),
        ("0 0 9.81", r"\+z"),
        ("-9.81 0 0", "-x"),
        ("1.7 0 -9.66", "a slanting line"),
    ],
)
def test_gravity_that_is_not_downwards_is_bad_input(gravity: str, where: str) -> None:
    with pytest.raises(MjcfError, match=f"gravity along {where}"):
        read_robot(with_option(f'gravity="{gravity}"'))


@pytest.mark.parametrize(
    "option", ['gravity="0 0 -1.62"', 'gravity="0 0 0"', 'gravity="0.004 0 -9.81"']
)
def test_any_strength_of_gravity_and_none_are_accepted(option: str) -> None:
    assert read_robot(with_option(option)).name == "lamp"


def test_gravity_that_is_switched_off_has_no_direction() -> None:
    xml = edited(("<worldbody>", OFF_SIDEWAYS))
    assert read_robot(xml).name == "lamp"


def test_a_winch_may_drive_two_cables_that_start_at_different_rest_lengths() -> None:
    robot = read_robot(
        edited(
            ("</actuator>", SECOND_REEL.format(tendon="stay", range="0.6 2.1")),
            ('stiffness="20" springlength="0 1.2"', ""),
            (' act="1"/>', ' act="1 1.1"/>'),
            ("<sensor>", PAIR.format(kind="actuator", second="spool")),
        )
    )
    (winch,) = robot.winches
    assert (winch.name, winch.cables, winch.actuators) == ("pair", (0, 1), (0, 1))
    assert [c.rest_length for c in robot.cables] == [1.0, 1.1]


def test_an_actuator_whose_control_does_nothing_is_no_control() -> None:
    lifting = '<motor name="lift" site="shade" gear="0 0 1 0 0 0"/></actuator>'
    with pytest.raises(RobotError, match="'lift' must drive a tendon .or have gainprm 0"):
        read_robot(edited(("</actuator>", lifting)))
    passive = lifting.replace("<motor", "<general").replace("site=", 'gainprm="0" site=')
    assert len(read_robot(edited(("</actuator>", passive))).winches) == 1


def test_what_is_welded_to_a_body_is_part_of_it() -> None:
    arm = '<body name="arm" pos="0.5 0 0"><geom name="arm" size=".1" mass="3"/></body></body>'
    robot = read_robot(edited(("</body>", arm)))
    (body,) = robot.bodies
    assert [p.name for p in body.primitives] == ["shade", "arm"]
    assert body.mass == 4.0
    assert body.com.tolist() == [0.375, 0.0, 0.0]
    # Parallel axes: two balls of 0.4 m r^2, apart by 0.5 m.
    ball = 0.4 * 0.1**2 * 4
    assert sorted(body.inertia) == pytest.approx([ball, ball + 0.75 * 0.25, ball + 0.75 * 0.25])


def test_masses_given_by_an_inertial_are_spread_over_the_pieces() -> None:
    inertial = '<inertial pos="0 0 0" mass="7" diaginertia="1 1 1"/><site name="shade"/>'
    (body,) = read_robot(edited(('<site name="shade"/>', inertial))).bodies
    assert body.mass == 7.0
    assert [p.mass for p in body.primitives] == [7.0]


def test_a_shell_turns_as_a_shell() -> None:
    (body,) = read_robot(edited(('size=".1"', 'size=".1" shellinertia="true"'))).bodies
    np.testing.assert_allclose(body.primitives[0].inertia, body.inertia)
    assert body.inertia[0] == pytest.approx(2 / 3 * 0.1**2)


def test_files_and_names_that_do_not_exist_are_said(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="There is no MJCF .*nowhere.xml"):
        load_robot(str(tmp_path / "nowhere.xml"))
    with pytest.raises(UnknownNameError, match="Did you mean 'prism3'"):
        load_robot("prism")
    path = tmp_path / "lamp.xml"
    path.write_text(GOOD)
    assert load_robot(str(path)).digest == read_robot(GOOD).digest
