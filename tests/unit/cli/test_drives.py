import io

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from flywheel.cli.driving.driver import PlantDriver
from flywheel.cli.driving.drives import (
    DriveLine,
    Setting,
    append_drive,
    drive_picture,
    drive_table,
    read_drives,
)
from flywheel.cli.main import app
from flywheel.errors import DataError
from flywheel.results import Walk
from flywheel.robots import load_robot
from flywheel.runtime.config.shipped import config_file
from tests import draws


def drive(seed: int, model: str = "champion", reached: bool = True) -> DriveLine:
    setting = Setting(
        robot="icosa6", task="obstacle_course", course="maze", model=model, samples=48,
        horizon_seconds=3.0, threads=2, config="c",
    )  # fmt: skip
    way = tuple(
        map(tuple, np.random.default_rng(draws.seed()).normal(size=(20, 2)).round(3).tolist())
    )
    walk = Walk(
        path=way, goal=(1, 2), reached=reached, seconds=10.0 + seed, distance=0.3, seed=seed
    )
    return DriveLine(
        setting=setting, seed=seed, walk=walk, seconds_allowed=120, tolerance=0.5,
        plan_seconds=(0.4, 0.5), cpu_seconds=20.0,
    )  # fmt: skip


def test_what_is_added_is_read_and_a_damaged_line_is_named(tmp_path):
    path, drives = tmp_path / "new" / "a.jsonl", [drive(s, reached=s > 0) for s in range(3)]
    assert read_drives(path) == []
    for each in drives:
        append_drive(path, each)
    assert read_drives(path) == drives
    path.write_text(path.read_text() + "{}\n")
    with pytest.raises(DataError, match="line 4"):
        read_drives(path)


def test_the_table_counts_each_setting_apart():
    console = Console(width=200, record=True, file=io.StringIO())
    drives = [drive(s, reached=s > 0) for s in range(4)] + [drive(0, "oracle")]
    with_astar = drives[-1].setting.model_copy(update={"controller": "astar"})
    drives.append(drives[-1].model_copy(update={"setting": with_astar}))
    console.print(drive_table(drives))
    text = console.export_text()
    assert "3 of 4" in text
    assert "19-99 %" in text  # Clopper and Pearson's
    assert "1 of 1" in text
    assert "astar, oracle" in text
    assert "12" in text  # median of 11, 12, 13 s


def test_the_picture_has_a_part_for_each_setting(tmp_path):
    path = tmp_path / "pictures" / "a.png"
    drive_picture([drive(0), drive(1), drive(0, "oracle")], path)
    assert path.read_bytes().startswith(b"\x89PNG")
    without = drive(0).model_copy(update={"walk": drive(0).walk.model_copy(update={"path": ()})})
    with pytest.raises(DataError, match="path to draw"):
        drive_picture([without], path)


def test_a_star_goes_by_the_plant_alone_and_has_its_own_lines(tmp_path):
    results = tmp_path / "results.jsonl"
    words = ["navigate", "smoke", "task.seconds=0.3", "--no-film", "--results", str(results)]

    def ask(*more: str) -> str:
        done = CliRunner().invoke(app, [*words, "--controller", "astar", *more])
        assert done.exit_code == (0 if "oracle" in more else 2), done.output
        return done.output

    assert "needs --model oracle, got 'champion'" in ask().replace("\n", " ")
    ask("--model", "oracle")
    (line,) = read_drives(results)
    assert (line.setting.controller, line.setting.model) == ("astar", "oracle")


def test_an_episode_that_two_processes_drove_counts_once(tmp_path):
    one, other, oracle = drive(0), drive(1), drive(1, "oracle")
    for each in (one, other, other, oracle, one):
        append_drive(tmp_path / "a.jsonl", each)
    assert read_drives(tmp_path / "a.jsonl") == [one, other, oracle]


def test_an_edited_mjcf_is_another_robot(tmp_path):
    own, source, text = tmp_path / "my.xml", config_file("smoke"), load_robot("prism3").xml
    settings = []
    for edited in (text, text, text.replace('friction="0.8', 'friction="0.7')):
        own.write_text(edited)
        settings.append(PlantDriver(source, (f"model={own}",), "oracle", (), "mppi").setting)
    assert settings[0] == settings[1] != settings[2]
    assert PlantDriver(source, (), "oracle", (), "mppi").setting.mjcf == ""


def test_a_robot_is_on_its_own_ground():
    words = ["drive", "smoke", "--model", "plant", "terrain.kinds=[bumps]"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and "has no effect" in done.output, done.output


@pytest.mark.slow
def test_a_drive_that_the_results_have_is_not_driven_again(tmp_path):
    results = tmp_path / "results.jsonl"
    small = ["task.seconds=0.3", "mppi.samples=2", "mppi.horizon_seconds=0.5", "mppi.elites=1"]

    def ask(logs: str, *more: str) -> str:
        kept = ["--results", str(results), "--logs", str(tmp_path / logs)]
        done = CliRunner().invoke(app, ["drive", "smoke", *small, "--model", "plant", *kept, *more])
        assert done.exit_code == 0, done.output
        return done.output

    ask("a")
    assert "1 of 2 episodes are in" in ask("b", "--episodes", "2").replace("\n", " ")
    ask("c", "--noise", "0.01")  # other sensors, and another robot, are something else
    ask("d", "--hidden", "payload")
    settings = [each.setting for each in read_drives(results)]
    assert [each.seed for each in read_drives(results)] == [0, 1, 0, 0]
    assert settings[0] == settings[1] and len({s.link for s in settings}) == 2
    assert settings[3].hidden == ("payload",)
