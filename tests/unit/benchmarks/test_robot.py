"""What the benchmark on a robot asks of a run, and how its tables read."""

import math
from pathlib import Path

import pytest

from benchmarks.robot import SETS, DriveRow, ErrorRow, Study, drives_table, errors_table


def error(seed: int, model: str, iteration: int, e_pos: float, found: str = "payload") -> ErrorRow:
    return ErrorRow("library", seed, model, iteration, 1.3 * iteration, e_pos, 2.0, 1.0, found)


ERRORS = [
    error(0, "noise", 0, 0.4),
    error(0, "given", 0, 20.0),
    error(1, "given", 0, 21.0),
    error(0, "plant", 1, 3.0),
    error(1, "plant", 1, 4.0),
]
DRIVES = [
    DriveRow("library", 0, "given", 24, 0, math.nan, 30.0),
    DriveRow("library", 0, "plant", 24, 20, 12.4, 30.0),
    DriveRow("library", 1, "plant", 24, 22, 11.0, 30.0),
]


def test_a_row_is_a_model_after_an_iteration_and_a_column_a_seed() -> None:
    lines = errors_table(ERRORS, "library")
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| given |  | 0.0 | 20.00 % / 2.0 deg | 21.00 % / 2.0 deg |")
    assert lines[-1].startswith("| noise |"), "the noise is what the others are compared with"


def test_what_was_found_is_of_the_first_seed_in_whatever_order_rows_are() -> None:
    rows = [error(1, "plant", 1, 4.0, "payload"), error(0, "plant", 1, 3.0, "torque_speed")]
    head, _, line = errors_table(rows, "library")
    assert head.endswith("| found (seed 0) |") and line.endswith("| torque_speed |")


def test_who_never_reached_a_goal_has_no_time() -> None:
    given, plant = drives_table(DRIVES, "library")[2:]
    assert given == "| given | 0 of 24 |  |"
    assert plant == "| plant | 20 of 24, 12 s | 22 of 24, 11 s |"


@pytest.mark.parametrize("name", SETS)
def test_each_set_is_a_configuration_that_can_be_run(name: str, tmp_path: Path) -> None:
    study = Study(tmp_path, name, 3)
    config = study.config()
    assert config.robot is not None and config.robot.hidden == SETS[name] and config.seed == 3
    assert config.diagnose.on
    assert study.collects_only == (name == "nothing")


def test_planners_that_have_nothing_from_a_run_drive_once_for_all_seeds(tmp_path: Path) -> None:
    first, second = (Study(tmp_path, "library", seed) for seed in (0, 1))
    assert first.file("given") == second.file("given") and first.file("knows") == second.file(
        "knows"
    )
    assert first.file("plant") != second.file("plant")
    assert first.file("knows") != Study(tmp_path, "cogging", 0).file("knows")
