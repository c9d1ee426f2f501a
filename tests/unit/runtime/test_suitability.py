"""A run that its robot cannot do is refused before it begins, with what would make it run."""

import shlex
from pathlib import Path

import pytest

from flywheel.errors import ConfigError, UnknownNameError
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.runtime.config.run_config import RunConfig, load_config
from flywheel.runtime.loop import run
from flywheel.runtime.run.suitability import check_suits, misfits

ROOT = Path(__file__).parents[3]
CONFIGS = sorted(
    path.relative_to(ROOT / "configs").as_posix() for path in (ROOT / "configs").rglob("*.yaml")
)
HINGED = (
    (ROOT / "tests" / "contracts" / "robots" / "swing.xml")
    .read_text()
    .replace("<freejoint/>", '<joint type="hinge" axis="0 1 0"/>')
    .replace('qpos="0 0 1 1 0 0 0"', 'qpos="0"')
)


def refused(config: RunConfig, robot: Robot) -> list[str]:
    """The overrides that a refusal gives."""
    with pytest.raises(ConfigError, match=f"{robot.name} cannot do this run") as refusal:
        check_suits(config, robot)
    return shlex.split(str(refusal.value).splitlines()[-1].removeprefix("To leave these out: "))


@pytest.mark.parametrize("name", CONFIGS)
def test_the_shipped_configurations_suit_their_robots(name: str) -> None:
    config = load_config(ROOT / "configs" / name)
    check_suits(config, load_robot(config.model))


@pytest.mark.parametrize("name", CONFIGS)
@pytest.mark.parametrize("robot", ["platform4", HINGED], ids=["hanging", "hinged"])
def test_a_refusal_says_all_that_has_to_be_left_out(name: str, robot: str, tmp_path: Path) -> None:
    if robot == HINGED:
        (tmp_path / "hinged.xml").write_text(robot)
        robot = str(tmp_path / "hinged.xml")
    file = ROOT / "configs" / name
    config = load_config(file, [f"model={robot}"])
    if not misfits(config, load_robot(robot)):
        check_suits(config, load_robot(robot))
        return
    overrides = refused(config, load_robot(robot))
    check_suits(load_config(file, [f"model={robot}", *overrides]), load_robot(robot))


def test_only_what_a_robot_cannot_do_is_left_out() -> None:
    smoke, icosa = load_config(ROOT / "configs" / "smoke.yaml"), load_robot("icosa6")
    assert refused(smoke, icosa) == ["collect.gaits=0"]
    hanging = refused(smoke, load_robot("platform4"))
    assert hanging == ["collect.gaits=0", "collect.drops=0", "evaluate.unseen=[]"]
    assert refused(smoke, read_robot(HINGED)) == [*hanging, "evaluate.floor=false"]


def test_what_needs_free_bodies_names_joints() -> None:
    config = load_config(ROOT / "configs" / "terrain.yaml")
    robot = read_robot(HINGED)
    why = {misfit.override: misfit.why for misfit in misfits(config, robot)}
    assert "it has joints" in why["evaluate.floor=false"]
    assert "it has joints" in why["terrain.kinds=[]"]
    assert "hangs on cables" in why["collect.drops=0"]


def test_a_control_step_is_a_multiple_of_the_time_step() -> None:
    xml = load_robot("prism3").xml.replace('timestep="0.005"', 'timestep="0.003"')
    file = ROOT / "configs" / "smoke.yaml"
    robot = read_robot(xml)
    overrides = refused(load_config(file), robot)
    assert overrides[0] == "network.dt=0.009"
    check_suits(load_config(file, overrides), robot)


@pytest.mark.slow
def test_a_course_that_a_robot_does_not_fit_is_found_before_the_run() -> None:
    config = load_config(ROOT / "configs" / "smoke.yaml", ["task.clearance=3.0"])
    assert refused(config, load_robot("prism3")) == ["evaluate.unseen=[]"]


@pytest.mark.slow
def test_courses_that_do_not_fit_are_left_out_together() -> None:
    """Nine metres from walls there is no start and no goal, while a ramp is no wall."""
    courses = "collect.courses=[corridor,incline,s_course]"
    asked = ["task.clearance=3.0", "evaluate.unseen=[]", courses]
    config = load_config(ROOT / "configs" / "smoke.yaml", asked)
    assert refused(config, load_robot("prism3")) == ["collect.courses=[incline]"]


def test_an_effect_at_a_place_that_is_not_there_is_found_before_the_run() -> None:
    effect = {"effect": "payload", "location": "s99", "parameters": {"mass": 1.0}}
    config = RunConfig.model_validate({"effects": [effect]})
    with pytest.raises(UnknownNameError, match="s99"):
        check_suits(config, load_robot("prism3"))


def test_too_few_episodes_are_found_before_the_run() -> None:
    config = load_config(ROOT / "configs" / "smoke.yaml", ["collect.random=0"])
    with pytest.raises(ConfigError, match="Iteration 0 would record no"):
        check_suits(config, load_robot("prism3"))


def test_a_run_that_is_refused_leaves_nothing(tmp_path: Path) -> None:
    config = load_config(ROOT / "configs" / "smoke.yaml", ["model=platform4"])
    with pytest.raises(
        ConfigError, match=r"platform4 cannot do this run:\n  collect.gaits=1: The gaits"
    ):
        run(config, tmp_path / "run", tracked=False)
    assert list(tmp_path.iterdir()) == []
