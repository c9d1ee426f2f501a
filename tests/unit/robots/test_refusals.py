"""What an MJCF must not be, and the message that says so."""

import re
from pathlib import Path

import numpy as np
import pytest

from flywheel.errors import MjcfError, RobotError, UnknownNameError
from flywheel.robots import load_robot, read_robot
from flywheel.robots.remarks import remarks

GOOD = """
<mujoco model="lamp">
  <option cone="elliptic"/>
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
            "no primitive.*mesh.*a.obj",
        ),
        ([('size=".1" mass="1"', 'size="-1" mass="1"')], "MuJoCo cannot compile"),
        ([('name="stay"', 'name="cord"')], "MuJoCo cannot compile.*repeated name"),
        ([('<spatial name="stay"', "<spatial")], "tendon number 1 .*no name"),
        ([('<framepos name="light"', "<framepos")], "sensor number 0 .*no name"),
        ([('<general name="reel"', "<general")], "actuator number 0 .*no name"),
        ([('<body name="shade"', "<body")], "moving body number 1 .*has no name"),
        ([('<key qpos="0 0 2 1 0 0 0" act="1"/>', "")], "no keyframe"),
        ([(' act="1"/>', "/>")], "'reel' at rest length 0, allowed 0.5 to 2"),
        ([(' act="1"/>', ' act="3"/>')], "'reel' at rest length 3, allowed 0.5 to 2"),
        (
            [('objtype="site" objname="shade"', 'objtype="body" objname="shade"')],
            r"no framepos sensor.*'light': not of a site",
        ),
        (
            [('objname="shade"/>', 'objname="hook"/>')],
            r"no framepos sensor.*'light': not of a site that moves",
        ),
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
            "'stay' must connect two bodies.*both ends on the world",
        ),
        (
            [
                ('<site name="shade"/>', '<site name="shade"/><site name="b"/>'),
                ('<site site="hook"/><site site="shade"/>', '<site site="b"/><site site="shade"/>'),
            ],
            "'stay' must connect.*both ends on the body 'shade'",
        ),
        (
            [('<site site="hook"/>', '<site site="hook"/><site site="ceiling"/>')],
            "'stay' must be straight.*got site -> site -> site",
        ),
        (
            [
                ('<site site="hook"/>', '<site site="hook"/><geom geom="ground"/>'),
                ('type="plane" size="5 5 .1"', 'type="sphere" size=".1" pos="0 0 -1"'),
            ],
            "'stay' must be straight.*got site -> geom -> site",
        ),
        (
            [('springlength="0 1.2"', 'springlength="1.2"')],
            r"'stay' \(1.2 m\) would push.*springlength=\"0 L\"",
        ),
        ([('stiffness="20" springlength="0 1.2"', "")], "Nothing pulls the tendon 'stay'"),
        (
            [('<spatial name="cord">', '<spatial name="cord" stiffness="9">')],
            "'cord' must not have a winch and",
        ),
        ([('ctrllimited="true" ctrlrange="-1 1"', "")], "'reel' must have a ctrlrange"),
        ([('actlimited="true" actrange="0.5 2"', "")], "'reel' must have an actrange"),
        (
            [('forcerange="-99 0"', 'forcerange="-99 -9"')],
            r"'reel' must only pull.*\(-99.0, -9.0\)",
        ),
        (
            [('forcerange="-99 0"', 'forcerange="-99 99"')],
            r"'reel' must only pull.*\(-99.0, 99.0\)",
        ),
        (
            [('<spatial name="cord">', '<spatial name="cord" actuatorfrcrange="-60 0">')],
            "'reel' must have its limit as its forcerange, not as its tendon's actuatorfrcrange",
        ),
        ([('biasprm="0 -500 -5"', 'biasprm="0 -5 -5"')], 'gainprm 500 and biasprm "0 -5 -5"'),
        ([('dyntype="integrator"', 'dyntype="filter" dynprm=".1"')], "'reel' must have dyntype"),
        (
            [("<actuator>", '<actuator><pid name="servo" tendon="stay" kp="9" kv="1"/>')],
            "take several commands, or none \\('servo'\\), as a <pid>",
        ),
        (
            [('tendon="cord"', 'site="shade"')],
            r"1\. The actuator 'reel' must drive a tendon.*\n2\. Nothing pulls the tendon 'cord'",
        ),
        (
            [('biasprm="0 -500 -5"', 'biasprm="0 0 -5"')],
            "^The actuator 'reel' must have a stiffness[^\n]*$",
        ),
        (
            [('stiffness="20"', 'stiffness="20 3"')],
            "'stay' must have a stiffness and a damping of one number",
        ),
        (
            [("<freejoint/>", ""), ("<body ", '<body mocap="true" ')],
            r"mocap bodies \('shade'\)",
        ),
        ([('tendon="cord"', 'tendon="cord" gear="2"')], "'reel' must have gear 1"),
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


SERVO = '<position name="reel" tendon="cord" kp="500" gear="2"/>'
REEL = GOOD[GOOD.index("    <general ") : GOOD.index("  </actuator>")]
KEY = '<key qpos="0 0 2 1 0 0 0" act="1"/>'


def problems(xml: str, error: type[RobotError] = RobotError) -> list[str]:
    """The problems of an MJCF, as they are numbered."""
    with pytest.raises(error) as caught:
        read_robot(xml)
    assert type(caught.value) is error or error is RobotError
    return [line.partition(". ")[2] for line in str(caught.value).splitlines() if line]


def test_all_problems_are_told_at_once_and_those_of_actuators_before_that_of_the_keyframe() -> None:
    sensor = '<framepos name="light" objtype="site" objname="shade"/>'
    found = problems(edited((REEL, SERVO), (KEY, ""), (sensor, "")))
    assert [words in each for words, each in zip(
        ("dyntype", "only pull", "a ctrlrange", "gear 1", "no keyframe", "no framepos"), found, strict=True
    )] == [True] * 6  # fmt: skip


def test_a_keyframe_that_does_not_fit_actuators_that_are_no_winches_is_told_after_them() -> None:
    found = problems(edited((REEL, SERVO)), MjcfError)
    assert "dyntype" in found[0]
    assert "MuJoCo cannot compile the MJCF" in found[-1] and "invalid act size" in found[-1]
    with pytest.raises(MjcfError, match="^MuJoCo cannot compile .*invalid act size"):
        read_robot(edited((' act="1"/>', ' act="1 1"/>')))


def test_what_makes_an_mjcf_no_robot_at_all_is_told_first() -> None:
    found = problems(edited(("<freejoint/>", ""), (REEL, ""), (KEY, "")))
    assert found[0] == "No body moves: give 'shade' a <freejoint/>."
    assert found[1] == (
        "The tendons 'cord', 'stay' must connect two bodies, or one body with the world; got both ends on "
        "the world."
    )
    tendons = GOOD[GOOD.index("  <tendon>") : GOOD.index("  <sensor>")]
    found = problems(edited((tendons, ""), (KEY, "")))
    assert found[0].startswith("The MJCF has no tendon")


def test_joints_are_told_first_where_an_mjcf_is_refused() -> None:
    hinge = ("<freejoint/>", '<joint name="pin" type="hinge"/>')
    found = problems(edited(hinge, (KEY, ""), ('springlength="0 1.2"', 'springlength="1.2"')))
    assert found[0].startswith("It has the joint 'pin' (hinge, of the body 'shade').")
    assert "no keyframe" in found[1] and "would push" in found[2]


def test_a_joint_that_limits_what_cables_do_to_it_is_refused() -> None:
    joint = '<joint name="pin" type="{}" pos="0 0 .5" axis="0 1 0" actuatorfrcrange="-5 5"/>'
    read_robot(edited(("<freejoint/>", joint.format("free"))))  # MuJoCo ignores it
    hinged = KEY.replace("0 0 2 1 0 0 0", "0.1")
    found = problems(edited(("<freejoint/>", joint.format("hinge")), (KEY, hinged)))
    (limit,) = found[1:]
    assert (
        limit.startswith("The joint 'pin' must have no actuatorfrcrange") and "(-5.0, 5.0)" in limit
    )


def test_a_missing_name_sideways_gravity_and_a_slack_spring_are_told_at_once() -> None:
    found = problems(
        edited(
            ('<mujoco model="lamp">', '<mujoco><option gravity="0 -9.81 0"/>'),
            ('springlength="0 1.2"', 'springlength="1.2"'),
            ('<framepos name="light"', "<framepos"),
        ),
        MjcfError,
    )
    expected = ("no name:", "gravity along -y", "The sensor number 0", "'stay' (1.2 m) would push")
    assert len(found) == 4 and all(map(str.__contains__, found, expected))


def test_tendons_that_would_push_are_told_together_and_even_without_tracked_points() -> None:
    path = '<site site="hook"/><site site="shade"/>'
    second = f'<spatial name="{{}}" stiffness="9" springlength="{{}}">{path}</spatial>'
    sensor = '<framepos name="light" objtype="site" objname="shade"/>'
    more = second.format("a", 0.5) + second.format("b", 0.7)
    found = problems(edited(("</tendon>", f"{more}</tendon>"), (sensor, "")))
    assert found[1] == (
        "The tendons 'a' (0.5 m), 'b' (0.7 m) would push when shorter than that (springlength); a cable only "
        'pulls: write springlength="0 L".'
    )


def test_all_wrong_numbers_and_all_other_files_are_told_at_once() -> None:
    found = problems(
        edited(('size=".1" mass="1"', 'size=".1" mass="inf"'), ('"0 0 3"', '"0 0 9e9"')), MjcfError
    )
    assert "'ceiling' has pos 9e+09 m" in found[0] and "'shade' has mass inf" in found[1]
    files = '<asset><mesh file="a.obj"/><mesh file="b.obj"/></asset><include file="c.xml"/><tendon>'
    with pytest.raises(MjcfError, match="(?s)a.obj.*b.obj.*self-contained.*c.xml"):
        read_robot(edited(("<tendon>", files)))


def test_a_cable_with_two_actuators_is_told_beside_what_they_lack() -> None:
    second = '<velocity name="damper" tendon="cord" kv="3"/></actuator>'
    found = problems(edited(("</actuator>", second)))
    assert "'damper' must have a stiffness" in found[0]
    assert any("'cord' is driven by 'reel' and 'damper'" in each for each in found)


def test_actuators_that_lack_the_same_are_told_together() -> None:
    second = REEL.replace("reel", "spool").replace("cord", "stay")
    both = (REEL, (REEL + second).replace('actlimited="true" actrange="0.5 2"', ""))
    plain = ('stiffness="20" springlength="0 1.2"', "")
    with pytest.raises(RobotError, match="^The actuators 'reel', 'spool' must have an actrange"):
        read_robot(edited(both, plain, (' act="1"/>', ' act="1 1"/>')))


def test_one_requirement_is_told_once_whatever_numbers_are_there() -> None:
    one = re.sub(r'forcerange="[^"]*"', 'forcerange="-7 7"', REEL)
    two = re.sub(r'forcerange="[^"]*"', 'forcerange="-9 9"', REEL)
    two = two.replace("reel", "spool").replace("cord", "stay")
    plain = ('stiffness="20" springlength="0 1.2"', "")
    words = 'only pull, with a forcerange "-F 0"; got (-7.0, 7.0), (-9.0, 9.0).'
    with pytest.raises(RobotError) as refused:
        read_robot(edited((REEL, one + two), plain, (' act="1"/>', ' act="1 1"/>')))
    assert str(refused.value) == f"The actuators 'reel', 'spool' must {words}"


def test_a_velocity_is_no_motor_that_takes_tensions() -> None:
    speed = '<velocity name="reel" tendon="cord" kv="30" ctrlrange="-1 1"/>'
    with pytest.raises(RobotError, match="'reel' must have a stiffness, .* <intvelocity kp="):
        read_robot(edited((REEL, speed), (' act="1"/>', "/>")))


@pytest.mark.parametrize("limit", ["ctrl", "act", "force"])
def test_a_range_that_a_default_switches_off_is_told_as_such(limit: str) -> None:
    off = f'<default><general {limit}limited="false"/></default><worldbody>'
    xml = edited(("<worldbody>", off), (f'{limit}limited="true"', ""))
    with pytest.raises(RobotError, match=f'{limit}limited is false .*write {limit}limited="true"'):
        read_robot(xml)


@pytest.mark.parametrize(
    "sensor",
    [
        '<framepos name="pose" objtype="body" objname="shade"/>',
        '<framepos name="pose" objtype="geom" objname="shade"/>',
        '<framepos name="pose" objtype="site" objname="hook"/>',
        '<framepos name="pose" objtype="site" objname="shade" reftype="site" refname="hook"/>',
        '<gyro name="pose" site="shade"/>',
    ],
)
def test_sensors_of_something_else_than_sites_that_move_are_passed_over_and_said(sensor):
    robot = read_robot(edited(("<sensor>", f"<sensor>{sensor}")))
    assert [point.name for point in robot.points] == ["light"]
    (words,) = remarks(robot)
    assert "passed over: 'pose'" in words


def test_lengths_in_decimetres_are_asked_for() -> None:
    begin = '<mujoco model="lamp">'
    robot = read_robot(edited((begin, f'{begin}<option gravity="0 0 -98.1"/>')))
    assert any("98.1 m/s^2: are its lengths in decimetres" in words for words in remarks(robot))


def test_the_example_needs_no_remark() -> None:
    assert list(remarks(read_robot(GOOD))) == []


@pytest.mark.parametrize(
    ("element", "attribute", "damping"),
    [
        ('<spatial name="cord"', 'damping="3"', 8.0),
        ('<general name="reel"', 'damping="3"', 8.0),
        ('<spatial name="cord"', 'armature="3"', 5.0),
        ('<general name="reel"', 'armature="3"', 5.0),
        ('<spatial name="cord"', 'frictionloss="3"', 5.0),
    ],
)
def test_what_acts_at_a_slack_cable_is_said_and_its_damping_counts(element, attribute, damping):
    robot = read_robot(edited((element, f"{element} {attribute}")))
    (words,) = remarks(robot)
    word = attribute.partition("=")[0]
    assert f"The {word} of the winched tendons 'cord' acts while they are slack" in words
    assert robot.cables[0].damping == pytest.approx(damping)


def test_forces_that_are_no_cables_are_said() -> None:
    weld = '<equality><connect name="pin" body1="shade" anchor="0 0 0"/></equality></mujoco>'
    (words,) = remarks(read_robot(edited(("</mujoco>", weld))))
    assert "Equality constraints (pin)" in words
    beside = '<general name="beside" tendon="cord" gainprm="0" biastype="affine" biasprm="9 -9"/>'
    (words,) = remarks(read_robot(edited(("</actuator>", f"{beside}</actuator>"))))
    assert "Passive actuators (beside) act beside the cables" in words


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('cone="elliptic"', 'cone="pyramidal"'), True),
        ((' cone="elliptic"', ""), True),
        (('<option cone="elliptic"/>', '<default><geom condim="1"/></default>'), False),
        (('cone="elliptic"', 'timestep="0.002"'), True),
    ],
)
def test_friction_that_depends_on_the_direction_is_said(change, said: bool) -> None:
    words = " ".join(remarks(read_robot(edited(change))))
    assert ("Its friction depends on the direction" in words) == said == bool(words)


def test_a_pyramid_without_a_ground_needs_no_remark() -> None:
    plane = '<geom name="ground" type="plane" size="5 5 .1"/>'
    assert not list(remarks(read_robot(edited((' cone="elliptic"', ""), (plane, "")))))


@pytest.mark.parametrize(("fastest", "said"), [("0.001", True), ("0.1", False)])
def test_a_winch_that_is_out_of_scale_is_said(fastest: str, said: bool) -> None:
    slow = edited(('ctrlrange="-1 1"', f'ctrlrange="-{fastest} {fastest}"'))
    words = " ".join(remarks(read_robot(slow)))
    assert ("The winches 'reel' take at least 1.5e+03 s" in words) == said == bool(words)


def test_a_robot_spans_the_space_between_its_fixed_cable_ends() -> None:
    assert read_robot(GOOD).span == pytest.approx(1.0)


def test_a_tendon_that_is_longer_than_its_range_is_said() -> None:
    limited = edited(('<spatial name="cord"', '<spatial name="cord" limited="true" range="0 0.7"'))
    (words,) = remarks(read_robot(limited))
    assert "'cord' may be 0.7 m long at most (its range), and is 1 m at the keyframe" in words
    assert not list(remarks(read_robot(limited.replace('"0 0.7"', '"0 1.0"'))))


def test_a_structure_without_tension_is_said() -> None:
    slack = edited((' act="1"/>', ' act="1.6"/>'), ('springlength="0 1.2"', 'springlength="0 2"'))
    assert any("No cable is taut" in words for words in remarks(read_robot(slack)))


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
