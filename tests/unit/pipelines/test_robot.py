"""`flywheel robot check` says what it reads, and fails where a robot cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.robots import ROBOTS, Robot, load_robot
from pipelines.cli import app
from pipelines.robot import settles

run = CliRunner().invoke


@pytest.mark.parametrize("name", ROBOTS)
def test_a_shipped_robot_is_read_and_settles(name: str) -> None:
    done = run(app, ["robot", "check", name], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    robot = load_robot(name)
    for part in (*robot.bodies, *robot.cables, *robot.winches):
        assert part.name in done.output
    assert "It settles" in done.output
    assert "nodes" in done.output  # of the graph


def test_an_mjcf_that_cannot_be_used_fails_with_the_reason(tmp_path: Path) -> None:
    file = tmp_path / "bare.xml"
    file.write_text('<mujoco model="bare"><worldbody/></mujoco>')
    done = run(app, ["robot", "check", str(file)])
    assert done.exit_code == 1
    assert "cannot be used" in done.output
    assert len(done.output.splitlines()) >= 2


def test_a_robot_that_is_not_there_is_bad_input_or_fails_with_its_name(tmp_path: Path) -> None:
    assert run(app, ["robot", "check", "prism4"]).exit_code == 2
    done = run(app, ["robot", "check", str(tmp_path / "none.xml")])
    assert done.exit_code == 1
    assert "none.xml" in done.output


def test_a_robot_that_falls_for_ever_does_not_settle() -> None:
    xml = load_robot("prism3").xml
    falling = Robot.from_mjcf(
        xml.replace('geom name="ground"', 'geom name="ground" pos="0 0 -1000"')
    )
    ok, words = settles(falling)
    assert not ok
    assert "flies away" in words
