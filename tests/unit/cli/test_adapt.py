"""`flywheel robot adapt` writes what `robot check` accepts, and asks before it guesses."""

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.robot import adapt as command
from tests.unit.robots import lab_files

run = CliRunner().invoke
PLATFORM = lab_files.activations_in_the_key


@pytest.fixture
def mjcf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return PLATFORM(tmp_path)


def test_what_it_writes_is_accepted_by_the_check_and_begins_at_rest(mjcf, tmp_path):
    done = run(app, ["robot", "adapt", str(mjcf), "--yes", "-o", "mine.xml"])
    assert done.exit_code == 0, done.output
    assert "servos (equivalent)" in done.output and "random commands: 0 m apart" in done.output
    checked = run(app, ["robot", "check", str(tmp_path / "mine.xml")])
    assert checked.exit_code == 0 and "It settles" in checked.output
    assert "keyframe is" not in checked.output


def test_the_check_tells_what_mends_each_problem_and_the_command_that_does(mjcf):
    told = run(app, ["robot", "check", str(mjcf)])
    assert told.exit_code == 2  # MuJoCo refuses its keyframe
    assert told.output.count("-> adapt mends it") == 4
    assert "-> adapt mends it: servos (equivalent)" in told.output
    assert told.output.splitlines()[-1] == f"All of them are mended by: flywheel robot adapt {mjcf}"


def test_the_check_tells_what_is_left_to_be_done_by_hand(tmp_path):
    path = lab_files.two_motors_on_a_spring(tmp_path)
    told = run(app, ["robot", "check", str(path)])
    assert told.exit_code == 2  # MuJoCo refuses an option
    assert (
        "Mend 2 of them by hand first; the others are then mended by: flywheel robot adapt"
        in told.output
    )


def test_nothing_is_written_in_a_dry_run_or_where_nobody_can_be_asked(mjcf, tmp_path):
    done = run(app, ["robot", "adapt", str(mjcf), "--dry-run"])
    assert done.exit_code == 0 and "Nothing is written" in done.output
    done = run(app, ["robot", "adapt", str(mjcf)])
    assert done.exit_code == 1 and "--yes takes the guesses (forces, points)" in done.output
    assert list(tmp_path.glob("*robot-robot.xml")) == []


@pytest.mark.parametrize(("answers", "code"), [("y\n", 0), ("n\ny\ny\n", 0), ("n\ny\nn\n", 1)])
def test_on_a_terminal_guesses_are_asked_for(answers, code, mjcf, tmp_path, monkeypatch):
    monkeypatch.setattr(command, "on_terminal", lambda: True)
    done = run(app, ["robot", "adapt", str(mjcf)], input=answers)
    assert done.exit_code == code, done.output
    assert (tmp_path / "robot-robot.xml").exists() == (code == 0)
    assert ("nothing is written" in done.output) == (code == 1)


def test_a_robot_stays_as_it_is_and_an_input_is_never_overwritten(mjcf):
    run(app, ["robot", "adapt", str(mjcf), "--yes", "-o", "mine.xml"])
    done = run(app, ["robot", "adapt", "mine.xml"])
    assert done.exit_code == 0 and "mine.xml can be used as it is" in done.output
    assert run(app, ["robot", "adapt", str(mjcf), "--yes", "-o", str(mjcf)]).exit_code == 2


def test_what_is_no_mjcf_or_no_adaptation_is_bad_input(mjcf, tmp_path):
    (tmp_path / "cut.xml").write_text("<mujoco>")
    for arguments in (["cut.xml"], ["none.xml"], [str(mjcf), "--without", "forse"]):
        assert run(app, ["robot", "adapt", *arguments]).exit_code == 2
