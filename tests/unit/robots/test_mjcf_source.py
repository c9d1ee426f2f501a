"""An MJCF is one text, and asks for no more than a robot can need."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from flywheel.errors import RobotError
from flywheel.robots import load_course, load_robot, read_robot
from tests.unit.robots.test_refusals import GOOD, edited

Load = Callable[[str], object]
BEGIN = '<mujoco model="lamp">'
BALL = '<body><freejoint/><geom size=".1"/></body>'
SITE = '<site name="shade"/>'


def with_world(text: str) -> str:
    return edited(("<worldbody>", f"<worldbody>{text}"))


def with_assets(text: str) -> str:
    return edited((BEGIN, f"{BEGIN}<asset>{text}</asset>"))


def with_sizes(text: str) -> str:
    return edited((BEGIN, f"{BEGIN}<size {text}/>"))


def replicated(*counts: int | str) -> str:
    begin = "".join(f'<replicate count="{count}" offset="0 0 1">' for count in counts)
    return f"{begin}{BALL}{'</replicate>' * len(counts)}"


@pytest.mark.parametrize(
    "world",
    [
        replicated(100_000),
        replicated(30, 30, 30),
        replicated(10**30),
        BALL * 3000,
        '<geom size=".1"/>' * 9000,
    ],
    ids=["copies", "copies of copies", "beyond an integer", "bodies", "geoms"],
)
def test_more_elements_than_are_compiled_in_seconds_are_refused(world: str) -> None:
    with pytest.raises(
        RobotError, match=r"more than 8,000 elements, including the copies of <replicate>"
    ):
        read_robot(with_world(world))


def test_few_copies_are_no_more_than_what_they_stand_for() -> None:
    geoms = '<replicate count="20" offset="0 0 1"><geom size=".1" pos="9 9 9"/></replicate>'
    assert len(read_robot(with_world(geoms)).bodies) == 1


def test_a_count_that_is_none_is_left_to_mujoco() -> None:
    with pytest.raises(RobotError, match="MuJoCo cannot compile.*'count'"):
        read_robot(with_world(replicated("1e9")))


@pytest.mark.parametrize("depth", [401, 100_000])
def test_elements_deep_within_each_other_are_refused(depth: int) -> None:
    with pytest.raises(RobotError, match="more than 400 elements within each other"):
        read_robot(with_world("<body>" * depth + "</body>" * depth))


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (with_world(replicated(600)), r"3,606 degrees of freedom; at most 3,000"),
        (with_sizes('memory="100G"'), "107,374,182,400 bytes in <size memory>; at most"),
        (with_sizes('nkey="100000000"'), "100,000,000 in <size nkey>; at most 1,000"),
        (with_sizes('nuser_site="100000000"'), "in <size nuser_site>; at most 1,000"),
        (with_sizes('njmax="2000000000"'), "in <size njmax>; at most 100,000"),
        (
            with_assets('<texture name="t" builtin="flat" width="99999" height="99999"/>'),
            "bytes of textures; at most 200,000,000",
        ),
        (
            with_assets('<texture name="t" type="skybox" builtin="flat" width="9999"/>'),
            "bytes of textures",
        ),
        (
            edited(("<sensor>", '<sensor><user name="u" dim="100000000"/>')),
            "100,000,003 numbers of sensors; at most 100,000",
        ),
        (
            edited(("<framepos", '<framepos nsample="99999999" delay="1" interp="linear"')),
            "numbers of sensors",
        ),
        (
            edited(('<site name="shade"/>', f'<site name="shade" user="{"1 " * 2_500_000}"/>')),
            "characters; at most 5,000,000",
        ),
        (edited((SITE, f'<site name="{"s" * 101}"/>')), "name of 101 characters.*at most 100"),
    ],
    ids=lambda value: "" if value.startswith("\n") else value[:30],
)
def test_what_would_take_much_memory_is_refused(xml: str, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        read_robot(xml)


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (edited(("</actuator>", '<muscle name="m" tendon="cord"/></actuator>')), "has a muscle"),
        (
            edited(
                (
                    "<general ",
                    '<general biastype="muscle" gainprm="0" name="m" tendon="cord"/>\n<general ',
                )
            ),
            "has a muscle",
        ),
        (edited((BEGIN, f'{BEGIN}<compiler><lengthrange mode="all"/></compiler>')), "look for"),
        (with_world('<site name="at 50%"/>'), "a percent sign in an attribute"),
        (edited((BEGIN, f'{BEGIN}<extension><plugin plugin="p"/></extension>')), "needs a plugin"),
        (with_world('<flexcomp name="f" type="grid" count="99 99 1"/>'), "a flexible part"),
        (with_world('<attach model="m" body="b" prefix="p"/>'), "reads another file"),
        (with_assets('<texture name="t" type="2d" file="picture.png"/>'), "reads another file"),
        (with_assets('<mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'), "is no primitive"),
        (with_assets('<hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/>'), "hfield"),
        (
            edited((BEGIN, f'<!DOCTYPE m [<!ENTITY a "b">]>{BEGIN}')).strip(),
            "DOCTYPE 'm'.*has none",
        ),
        ("<!doctype html><html></html>", "not valid XML"),
        ("<html><body/></html>", "begins with <html>; an MJCF begins with <mujoco>"),
        ('<robot name="r"><link name="l"/></robot>', "URDF.*MjSpec.from_file"),
        ("< ", "not valid XML"),
    ],
    ids=lambda value: "" if value.startswith(("\n", "<")) else value[:30],
)
def test_what_is_no_robot_of_rigid_bodies_in_one_file_is_refused(xml: str, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        read_robot(xml)


@pytest.mark.parametrize("mode", ["", 'mode="none"', 'mode="muscle"'])
def test_a_search_for_the_lengths_of_muscles_is_accepted_where_there_are_none(mode: str) -> None:
    element = f'<compiler><lengthrange timestep="0.001" {mode}/></compiler>'
    assert read_robot(edited((BEGIN, f"{BEGIN}{element}"))).name == "lamp"


@pytest.mark.parametrize("load", [load_robot, load_course])
def test_what_is_no_text_is_refused(load: Load, tmp_path: Path) -> None:
    pipe, folder = tmp_path / "pipe.xml", tmp_path / "folder.xml"
    os.mkfifo(pipe)
    folder.mkdir()
    latin, empty = tmp_path / "latin.xml", tmp_path / "empty.xml"
    latin.write_bytes('<mujoco model="é"/>'.encode("latin-1"))
    empty.touch()
    said = {pipe: "is a pipe", folder: "is a folder", latin: "not text in UTF-8", empty: "is empty"}
    for path, message in (said | {tmp_path / "none.xml": "There is no"}).items():
        with pytest.raises(RobotError, match=message):
            load(str(path))
    with pytest.raises(RobotError, match="is a device"):
        (tmp_path / "zero.xml").symlink_to("/dev/zero")
        load(str(tmp_path / "zero.xml"))


def test_a_course_is_as_bounded_as_a_robot(tmp_path: Path) -> None:
    course = tmp_path / "course.xml"
    course.write_text(f'<mujoco model="c"><worldbody>{replicated(100_000)}</worldbody></mujoco>')
    with pytest.raises(RobotError, match="The course has more than 8,000 elements"):
        load_course(str(course))
    course.write_text(
        '<mujoco model="c"><worldbody><geom type="box" size="1 1 1e200"/></worldbody></mujoco>'
    )
    with pytest.raises(
        RobotError, match=r"geom number 0 .* has size 1e\+200 m; allowed 0 to 10000"
    ):
        load_course(str(course))


def test_nothing_is_written_where_mujoco_would_warn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError, match=r"invalid number \(nan\): <geom name='shade' mass='nan'>"):
        read_robot(edited(('mass="1"', 'mass="nan"')))
    assert list(tmp_path.iterdir()) == []


def test_a_robot_of_three_hundred_bodies_is_read() -> None:
    def ball(number: int) -> str:
        return (
            f'<body name="b{number}" pos="{number} 0 1"><freejoint/><geom size=".1" mass="1"/>'
            f'<site name="s{number}"/></body>'
        )

    def cable(number: int) -> str:
        return (
            f'<spatial name="c{number}" stiffness="9" springlength="0 1"><site site="s{number}"/>'
            '<site site="shade"/></spatial>'
        )

    def sensor(number: int) -> str:
        return f'<framepos name="p{number}" objtype="site" objname="s{number}"/>'

    poses = "".join(f" {number} 0 1 1 0 0 0" for number in range(300))
    xml = edited(
        ("</worldbody>", "".join(map(ball, range(300))) + "</worldbody>"),
        ("</tendon>", "".join(map(cable, range(300))) + "</tendon>"),
        ("</sensor>", "".join(map(sensor, range(300))) + "</sensor>"),
        ('qpos="0 0 2 1 0 0 0"', f'qpos="0 0 2 1 0 0 0{poses}"'),
    )
    robot = read_robot(xml)
    assert (len(robot.bodies), len(robot.cables)) == (301, 302)


def test_the_example_is_no_longer_than_it_looks() -> None:
    assert read_robot(GOOD).digest == read_robot("\n" + GOOD).digest
