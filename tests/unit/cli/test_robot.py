"""`flywheel robot check` says what it reads, and how to run it; it fails where a robot cannot be used."""

import math
import os
import re
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.robot import steps
from flywheel.cli.robot.steps import advice
from flywheel.dynamics.plant import Plant, StepError
from flywheel.dynamics.plant.time_steps import CableDamping
from flywheel.effects import WrittenTerm
from flywheel.options import AdaptOptions
from flywheel.results import RunResult
from flywheel.robots import ROBOTS, load_robot
from flywheel.robots.adapt import adapt
from flywheel.runtime.config.run_config import load_config
from flywheel.runtime.run.suitability import check_suits
from tests.unit.robots.lab_files import old_paper
from tests.unit.runtime.tiny_run import Bench

ROOT = Path(__file__).parents[3]
SWING = (ROOT / "tests" / "contracts" / "robots" / "swing.xml").read_text()
FREE, HINGE = "<freejoint/>", '<joint type="hinge" axis="0 1 0"/>'
POSE = 'qpos="0 0 1 1 0 0 0"'
AWAY = (POSE, 'qpos="0.2 0.1 1.1 1 0 0 0"')
run = CliRunner().invoke


def checked(folder: Path, *edits: tuple[str, str], more: str = "", code: int = 0) -> str:
    """What the check says of the beam on cables of the docs, edited."""
    xml = SWING
    for old, new in edits:
        assert old in xml, old
        xml = xml.replace(old, new)
    (folder / "mine.xml").write_text(xml)
    done = run(app, ["robot", "check", str(folder / "mine.xml"), *shlex.split(more)])
    assert done.exit_code == code, done.output
    return done.output


def suggested(output: str) -> list[str]:
    """The overrides of the command that a check prints last."""
    command = shlex.split(output.splitlines()[-1].removeprefix("Run it with: "))
    assert command[:3] == ["flywheel", "run", "prism3"]
    return command[3:]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_shipped_robot_is_read_and_settles_and_the_command_printed_can_be_run(name: str) -> None:
    done = run(app, ["robot", "check", name], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    robot = load_robot(name)
    for part in (*robot.bodies, *robot.cables, *robot.winches):
        assert part.name in done.output
    assert "It settles" in done.output
    assert "nodes" in done.output  # of the graph
    assert "keyframe is" not in done.output
    assert "Its time steps cost" in done.output
    assert "With Euler the damping of its cables is explicit" in done.output
    settings = load_config(ROOT / "configs" / "prism3.yaml", suggested(done.output))
    check_suits(settings, load_robot(settings.model))


@pytest.mark.parametrize("config", ["prism3", "smoke"])
@pytest.mark.parametrize(
    "edits",
    [
        (),
        ((FREE, HINGE), (POSE, 'qpos="0"')),
        (('timestep="0.005"', 'timestep="0.003"'),),
        (('<framepos name="right" objtype="site" objname="right_end"/>', ""),),
    ],
    ids=["as in the docs", "hinged", "another time step", "one tracked point"],
)
def test_the_command_it_prints_can_be_run(config, edits, tmp_path):
    overrides = suggested(checked(tmp_path, *edits))
    settings = load_config(ROOT / "configs" / f"{config}.yaml", overrides)
    check_suits(settings, load_robot(settings.model))


def test_names_are_printed_as_they_are(tmp_path: Path) -> None:
    names = (("beam", "[red]beam"), ("left_winch", "[bold]w[/bold]"), ('"swing"', '"[/x]"'))
    folder = tmp_path / "[blue]a"
    folder.mkdir()
    output = checked(folder, *((f'name="{a}"', f'name="{b}"') for a, b in names[:2]), names[2])
    for name in ("[red]beam", "[bold]w[/bold]", "[/x]:"):
        assert name in output
    broken = checked(folder, ("<keyframe>", "<!--"), ("</keyframe>", "-->"), code=1)
    assert f"{folder / 'mine.xml'} cannot be used:" in broken.replace("\n", "")
    mine = folder / "[red]x.xml"
    mine.write_text(SWING)
    overrides = suggested(run(app, ["robot", "check", str(mine)]).output)
    assert load_config(ROOT / "configs" / "prism3.yaml", overrides).model == str(mine)


def test_a_swing_that_dies_away_slowly_can_be_used(tmp_path: Path) -> None:
    output = checked(tmp_path, AWAY)
    assert re.search(r"It swings every [\d.]+ s, with a time constant of 4\d\.\d s", output)


def test_a_keyframe_away_from_rest_is_said_with_a_better_one(tmp_path: Path) -> None:
    output = checked(tmp_path, AWAY)
    assert "Its keyframe is 24.5 % of L from where it rests" in output
    (better,) = re.findall(r"<key .*/>", output)
    again = checked(tmp_path, (re.findall(r"<key .*/>", SWING)[0], better))
    assert "It settles" in again and "keyframe is" not in again


def test_distances_of_a_small_robot_are_shares_of_the_space_it_hangs_in_too(tmp_path: Path) -> None:
    near = [(f'pos="{sign}0.5 0 0"', f'pos="{sign}0.2 0 0"') for sign in ("-", "")]
    output = checked(tmp_path, *near, AWAY)
    assert "% of the 2.69 m between fixed cable ends" in output


def test_a_time_step_that_does_not_divide_has_its_own_control_step(tmp_path: Path) -> None:
    step = ('timestep="0.005"', 'timestep="0.003"')
    assert "Give them --dt 0.009" in checked(tmp_path, step)
    assert "network.dt=0.012" in checked(tmp_path, step, more="--dt 0.012")
    said = checked(tmp_path, step, more="--dt 0.01", code=2)
    assert "not a multiple of the timestep of swing, 0.003 s; 0.009 or 0.012 s is" in said
    checked(tmp_path, step, more="--dt nan", code=2)


@pytest.mark.parametrize(
    ("gravity", "word", "code"),
    [
        ("-98.1", "lengths in decimetres?", 0),
        ("-981", "lengths in centimetres?", 1),  # it tears itself off
        ("-50", "5.1 times the Earth's. Is it meant?", 0),
        ("0", "There is no gravity", 0),
    ],
)
def test_gravity_that_is_not_the_earths_is_said(tmp_path, gravity, word, code):
    option = ('timestep="0.005"', f'timestep="0.005" gravity="0 0 {gravity}"')
    assert word in checked(tmp_path, option, code=code).replace("\n", " ")


def test_a_robot_whose_gravity_is_sideways_is_bad_input(tmp_path: Path) -> None:
    option = ('timestep="0.005"', 'timestep="0.005" gravity="0 -9.81 0"')
    assert "gravity along -y" in checked(tmp_path, option, code=2)


def test_the_moon_is_nothing_to_be_said(tmp_path: Path) -> None:
    output = checked(tmp_path, ('timestep="0.005"', 'timestep="0.005" gravity="0 0 -1.62"'))
    assert "ravity" not in output


def test_a_robot_in_millimetres_is_said(tmp_path: Path) -> None:
    long = [('pos="-0.5 0 0"', 'pos="-500 0 0"'), ('pos="0.5 0 0"', 'pos="500 0 0"')]
    xml = SWING
    for old, new in long:
        assert old in xml, old
        xml = xml.replace(old, new)
    (tmp_path / "mine.xml").write_text(xml)
    said = run(app, ["robot", "check", str(tmp_path / "mine.xml")]).output
    assert "L = 1000 m: lengths in millimetres or centimetres?" in said


def test_what_joints_and_single_points_hinder_is_said(tmp_path: Path) -> None:
    output = checked(tmp_path, (FREE, HINGE), (POSE, 'qpos="0"'))
    assert "compare and diagnose, which restart it from what is seen, cannot use it" in output
    assert "evaluate.floor=false" in output
    output = checked(tmp_path, ('<framepos name="right" objtype="site" objname="right_end"/>', ""))
    assert "one or in one place (beam)" in output


def test_an_mjcf_that_cannot_be_used_fails_with_the_reason(tmp_path: Path) -> None:
    file = tmp_path / "bare.xml"
    file.write_text('<mujoco model="bare"><worldbody/></mujoco>')
    done = run(app, ["robot", "check", str(file)])
    assert done.exit_code == 1
    assert "cannot be used" in done.output
    assert len(done.output.splitlines()) >= 2


def test_a_robot_that_nothing_holds_or_that_explodes_fails(tmp_path: Path) -> None:
    ball = '<body name="sky"><freejoint/><geom size=".1"/><site name="sky"/></body>'
    falling = (
        ("<body name", f"{ball}<body name"),
        ("</sensor>", '<framepos name="sky" objtype="site" objname="sky"/></sensor>'),
        (POSE, 'qpos="5 0 9 1 0 0 0 0 0 1 1 0 0 0"'),
    )
    assert "It flies away" in checked(tmp_path, *falling, code=1)
    stiff = ('gainprm="2000"', 'gainprm="1e9"'), ("0 -2000 -50", "0 -1e9 -50"), ("-500 0", "-1e9 0")
    assert re.search("It flies away|diverged", checked(tmp_path, *stiff, code=1))


def test_a_robot_that_nothing_holds_falls(tmp_path: Path) -> None:
    file = tmp_path / "loose.xml"
    xml = (ROOT / "flywheel/robots/mjcf/prism3.xml").read_text()
    plane = re.findall(r'<geom [^>]*type="plane"[^>]*/>', xml)
    for each in plane:
        xml = xml.replace(each, "")
    assert plane
    file.write_text(xml)
    done = run(app, ["robot", "check", str(file)])
    assert done.exit_code == 1
    assert "Nothing holds it, and it falls" in done.output


def test_what_cannot_be_read_is_bad_input(tmp_path: Path) -> None:
    assert run(app, ["robot", "check", "prism4"]).exit_code == 2
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "cut.xml").write_text(SWING[:300])
    (tmp_path / "many.xml").write_text(
        SWING.replace("<body", '<replicate count="100000"/><body', 1)
    )
    (tmp_path / "endless.xml").write_text(SWING.replace('damping="20"', 'damping="inf"'))
    assert (tmp_path / "endless.xml").read_text() != SWING
    for name in ("none.xml", "pipe.xml", "cut.xml", "many.xml", "endless.xml"):
        done = run(app, ["robot", "check", str(tmp_path / name)])
        assert done.exit_code == 2
        assert name in done.output


def test_what_was_hidden_is_revealed_beside_what_was_found(tmp_path):
    bench = Bench(
        tmp_path / "run",
        iterations=0,
        robot={"hidden": ["torque_speed:2", "cogging", "payload@s5"]},
    )
    bench.files.path.mkdir()
    bench.files.begin(bench.config, resume=False)
    effects = (
        WrittenTerm(effect="slope", parameters={"about_x": 0.01, "about_y": 0.0}),
        WrittenTerm(effect="payload", location="s5", parameters={"mass": 12.5}),
    )
    found = {"effects": [effect.model_dump() for effect in effects]}
    key = bench.files.begun().identity.key
    RunResult(name="r", key=key, config=found).save(bench.files.path)
    words = run(app, ["robot", "reveal", str(bench.files.path)]).output
    assert re.search(r"torque_speed .* slope \S+ 1/N .* no ", words)
    assert re.search(r"cogging .* no ", words) and re.search(
        r"slope .* not there .* about_x 0.01", words
    )
    assert re.search(r"payload at s5 .* mass \S+ kg .* mass 12.5", words)
    assert "noise of 0.30% of the length" in words


def test_a_run_without_a_stand_in_has_nothing_to_reveal(tmp_path):
    bench = Bench(tmp_path / "run")
    bench.files.path.mkdir()
    bench.files.begin(bench.config, resume=False)
    RunResult(name="r", key=bench.files.begun().identity.key).save(bench.files.path)
    done = run(app, ["robot", "reveal", str(bench.files.path)])
    assert done.exit_code == 2 and "has no stand-in" in done.output


def test_damping_that_is_too_much_for_the_steps_is_named_with_its_limit(tmp_path: Path) -> None:
    stiff = SWING.replace('damping="20"', 'damping="5000"')
    beyond = (
        "damping of its cables is explicit, and stable in steps below 1.96 ms: c dt / m is 5.09"
    )
    for integrator, named in (("Euler", True), ("implicitfast", False)):
        (tmp_path / "mine.xml").write_text(stiff.replace("implicitfast", integrator))
        done = run(app, ["robot", "check", str(tmp_path / "mine.xml")])
        before_it_moves = " ".join(re.split("diverged|It settles", done.output)[0].split())
        assert (f"With {integrator} the {beyond}" in before_it_moves) == named
        assert done.exit_code == named


def step_error(integrator: str, timestep: float, median: float, most: float = 1.0) -> StepError:
    return StepError(integrator, timestep, median, most, 1.0, 100.0)


PRISM = load_robot("prism3")  # 2.95 m long
STEPS = {"integrator": "implicitfast", "timestep": 0.005}
OWN = step_error("implicitfast", 0.005, 0.012)


@pytest.mark.parametrize(
    ("others", "advised"),
    [
        ([step_error("Euler", 0.005, 0.0046)], 'timestep="0.005" integrator="Euler"'),
        ([step_error("Euler", 0.005, 0.0115)], ""),
        ([step_error("Euler", 0.01, 0.011)], 'timestep="0.01" integrator="Euler"'),
        ([step_error("Euler", 0.01, 0.021)], ""),
        ([step_error("Euler", 0.01, 0.021, 0.0028)], 'timestep="0.01" integrator="Euler"'),
        ([step_error("Euler", 0.005, math.inf)], ""),
        ([step_error("implicitfast", 0.0025, 0.003)], ""),
    ],
)
def test_other_steps_are_advised_where_they_are_nearer_or_fewer(others, advised):
    said = advice([OWN, *others], replace(PRISM, **STEPS), CableDamping(20.0, "a", 10.0))
    assert said.startswith("Its time steps cost 12 mm after 2 s (implicitfast, 5 ms), 0.41 % of L")
    assert (f"<option {advised}/>" in said) if advised else ("<option" not in said)


def test_explicit_steps_near_their_limit_are_not_advised() -> None:
    others = [step_error("Euler", 0.005, 0.001)]
    for rate, advised in ((201.0, False), (199.0, True)):
        said = advice([OWN, *others], replace(PRISM, **STEPS), CableDamping(rate, "a", 10.0))
        assert ("<option" in said) == advised


def test_steps_of_a_robot_that_is_too_slow_are_not_measured(monkeypatch):
    monkeypatch.setattr(steps, "PATIENCE", 0.0)
    assert steps.measured(Plant(PRISM)) == []


def test_a_robot_that_rests_and_diverges_under_commands_cannot_be_used(tmp_path: Path) -> None:
    struts = adapt(old_paper(tmp_path), AdaptOptions(winches=("*",))).xml  # through each other
    (tmp_path / "struts.xml").write_text(struts)
    done = run(app, ["robot", "check", str(tmp_path / "struts.xml")])
    assert done.exit_code == 1 and "It diverges under random commands. Simulation" in done.output
    assert "Run it with" not in done.output
