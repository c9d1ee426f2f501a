"""`flywheel robot adapt` writes what `robot check` accepts, and asks before it guesses."""

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.robot import adapt as command
from flywheel.cli.robot import steps
from flywheel.dynamics.plant import Plant
from flywheel.dynamics.plant.refined import with_steps
from flywheel.robots import load_robot
from tests.unit.robots import lab_files
from tests.unit.robots.test_structures import NET

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


def test_a_structure_gets_the_time_steps_that_cost_the_least(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(steps, "MOTIONS", 2)
    (tmp_path / "prism.yaml").write_text(yaml.safe_dump(NET))
    done = run(app, ["robot", "adapt", "prism.yaml", "--yes"])
    assert done.exit_code == 0, done.output
    robot = load_robot("prism-robot.xml")
    assert f"({robot.integrator}, {1e3 * robot.timestep:.3g} ms)" in done.output
    assert robot.integrator == "Euler"
    # Another motion than those by which they were chosen, beside one in far shorter steps.
    plant, rng = Plant(robot), np.random.default_rng(5)
    told = np.repeat(rng.uniform(-0.1, 0.1, (1, 5, len(robot.winches))), 20, axis=1)
    ends = [
        with_steps(plant, *each).simulate(plant.settle(1.0), told).observations.points[0, -1]
        for each in (("Euler", 1e-4), (robot.integrator, robot.timestep), ("implicitfast", 0.002))
    ]
    chosen, usual = (np.linalg.norm(end - ends[0], axis=-1).max() for end in ends[1:])
    assert chosen < usual / 2
