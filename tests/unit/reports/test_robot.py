"""What a run came to on its robot is on the page, in MLflow's names, and in two sentences."""

from pathlib import Path

import pytest

from flywheel.reports.conclusions import conclusions, headline
from flywheel.reports.page import render_page, robot_rows, robot_time
from flywheel.results import RunResult
from flywheel.runtime.run.publish import iteration_values
from tests.unit.reports.fake_run import fake_run, with_robot


@pytest.fixture(scope="module")
def run() -> RunResult:
    return with_robot(fake_run(3))


def test_the_headline_is_about_the_robot(run: RunResult) -> None:
    words = headline(run)
    assert words.startswith("The error of the MJCF on the robot fell from ")
    assert "(noise 0.42 %), with effect_0, effect_1 added. The network's error" in words
    assert " ".join(each.text for each in conclusions(run)[:2]) == words
    assert "on the robot" not in headline(fake_run(3))


def test_a_plant_that_came_no_nearer_is_said_to_have_not(run: RunResult) -> None:
    scores = tuple(
        s.model_copy(update={"errors": run.on_robot[1].errors}) if s.model == "plant" else s
        for s in run.on_robot
    )
    assert conclusions(run.model_copy(update={"on_robot": scores}))[0].answer == "no"
    nothing = tuple(i.model_copy(update={"diagnosis": None}) for i in run.iterations)
    found = conclusions(run.model_copy(update={"iterations": nothing}))[0]
    assert found.answer == "open" and "no effect was added" in found.text


def test_every_model_has_a_row_in_every_iteration(run: RunResult) -> None:
    rows = robot_rows(run)
    assert [(row.iteration, row.model) for row in rows] == [
        (str(number), model)
        for number in range(3)
        for model in ("MJCF as given", "MJCF with identified effects", "network")
    ]
    assert rows[0].success == "" and "/8" in rows[1].success
    assert float(rows[1].short) > float(rows[4].short) > float(rows[7].short)
    assert rows[0].short == rows[3].short == rows[6].short, "on the same recordings"
    assert robot_rows(fake_run(3)) == [] and robot_time(fake_run(3)) == []


def test_robot_time_is_counted_until_the_error_is_near_its_least(run: RunResult) -> None:
    assert run.minutes_to_best("plant") == 7.0
    assert run.minutes_to_best("plant", within=10.0) == 1.0
    assert run.minutes_to_best("nobody") is None
    words = robot_time(run)
    assert "MJCF with identified effects: 7.0 minutes until" in words[0] and "of 7.0" in words[0]


def test_the_page_tells_of_the_robot_and_of_each_diagnosis(run: RunResult, tmp_path: Path) -> None:
    page = render_page(run, tmp_path)
    assert "<h2>On the robot</h2>" in page and 'id="robot"' in page
    assert page.count("EFFECT: the plant now has effect_") == 2


def test_mlflow_gets_the_robot_under_fixed_names(run: RunResult) -> None:
    values = iteration_values(run.iterations[1])
    wanted = {
        *(f"robot/error_{s}/{m}" for s in ("1s", "2s") for m in ("network", "given", "plant")),
        *(f"robot/rotation_2s/{m}" for m in ("network", "given", "plant")),
        *(f"robot/success/{planner}" for planner in ("network", "plant")),
        *(f"robot/seconds_to_goal/{planner}" for planner in ("network", "plant")),
        "robot/minutes", "robot/minutes_driven", "robot/error_of_noise",
    }  # fmt: skip
    assert {name for name in values if name.startswith("robot/")} == wanted
    assert values["robot/error_1s/plant"] < values["robot/error_2s/plant"]
    assert not any(
        name.startswith("robot/") for name in iteration_values(fake_run(2).iterations[0])
    )
