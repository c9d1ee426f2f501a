"""The tables of the pages are those that the results make, and results survive as CSV."""

import math
import runpy
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import tables
from benchmarks.demo import DemoResult, DemoRow
from benchmarks.diagnosis.case_result import CaseResult, Named
from benchmarks.diagnosis.case_row import CaseRow
from benchmarks.navigation import EpisodeRow, courses_table, driven_episodes
from benchmarks.robot import DriveRow, ErrorRow
from benchmarks.rows import read_rows, write_rows
from benchmarks.tables import BLOCK, PAGES, TABLES, with_tables
from flywheel.cli.driving.drives import DriveLine, Setting
from flywheel.errors import UnknownNameError
from flywheel.results import Walk

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("page", sorted(PAGES.glob("*.md")), ids=lambda path: path.stem)
def test_the_tables_of_a_page_are_those_of_the_results(page: Path) -> None:
    text = page.read_text()
    assert with_tables(text) == text, "python -m benchmarks.tables makes them anew"


def test_pages_have_tables_that_are_made() -> None:
    named = {block[1] for page in PAGES.glob("*.md") for block in BLOCK.finditer(page.read_text())}
    assert {"diagnosis", "adoption", "sysid"} <= named <= TABLES.keys()


@pytest.mark.parametrize("name", TABLES)
def test_a_table_has_rows_as_long_as_its_head(name: str) -> None:
    for table in "\n".join(TABLES[name]()).split("\n\n"):
        head, rule, *rows = table.splitlines()
        assert rows and set(rule) == set("|-")
        assert {row.count("|") for row in rows} == {head.count("|")}


@pytest.mark.parametrize(("controller", "model"), [("mppi", "oracle"), ("astar", "astar")])
def test_only_mppi_on_the_plant_is_called_the_oracle(controller: str, model: str) -> None:
    setting = Setting(
        robot="prism3", task="reach", model="oracle", controller=controller, samples=48,
        horizon_seconds=3.0, threads=1, config="c",
    )  # fmt: skip
    walk = Walk(path=(), goal=(1, 2), reached=True, seconds=9.0, distance=0.3, seed=0)
    drive = DriveLine(
        setting=setting, seed=0, walk=walk, seconds_allowed=60, tolerance=0.5,
        plan_seconds=(0.4, 0.5), cpu_seconds=20.0,
    )  # fmt: skip
    assert [row.model for row in driven_episodes("run", 0, [drive])] == [model]


def episode(seed: int, reached: bool, where: str = "maze") -> EpisodeRow:
    return EpisodeRow("run", seed, "1", "", where, "", "", 0, reached, 10.0 + seed, 0.5)


@pytest.mark.parametrize(
    ("driven", "cell"),
    [
        ([(0, True), (0, False)], "1 of 2 (1-99), 10 s"),
        ([(1, False), (0, True), (0, True), (1, True)], "3 of 4 (19-99): 2, 1, 10 s"),
        ([(0, True), (0, True), (1, True)], "3 of 3 (29-100): 2 of 2, 1 of 1, 10 s"),
        ([(0, False), (1, False)], "0 of 2 (0-84): 0, 0"),
    ],
)
def test_courses_show_the_goals_of_each_training_seed(driven, cell: str) -> None:
    rows = [episode(seed, reached) for seed, reached in driven]
    assert courses_table(rows, {"run": "network"})[2:] == [
        f"| `maze` | {cell} |",
        f"| all | {cell} |",
    ]


def test_runs_on_a_robot_that_were_collected_before_stay(tmp_path, monkeypatch):
    """Those of the folder take the place of their own rows."""

    def study(of_set: str, e_pos: float) -> SimpleNamespace:
        error = ErrorRow(of_set, 0, "plant", 0, 1.0, e_pos, 1.0, 1.0, "")
        drive = DriveRow(of_set, 0, "plant", 4, 1, 9.0, 30.0)
        return SimpleNamespace(set=of_set, seed=0, errors=lambda: [error], driven=lambda: [drive])

    monkeypatch.setattr(tables, "ROBOT_ERRORS", tmp_path / "errors.csv")
    monkeypatch.setattr(tables, "ROBOT_DRIVES", tmp_path / "drives.csv")
    for studies in ([study("library", 2.0), study("cogging", 3.0)], [study("cogging", 4.0)]):
        monkeypatch.setattr(tables.robot, "found_studies", lambda _, found=studies: found)
        tables.collect_robot(tmp_path)
    errors = read_rows(ErrorRow, tmp_path / "errors.csv")
    assert [(row.set, row.e_pos) for row in errors] == [("library", 2.0), ("cogging", 4.0)]
    assert [row.set for row in read_rows(DriveRow, tmp_path / "drives.csv")] == [
        "library",
        "cogging",
    ]


def test_stories_that_were_collected_before_stay(tmp_path, monkeypatch):
    """Those of the folder take the place of their own rows."""

    def story(seed: int, outcome: str) -> DemoResult:
        return DemoResult(
            name=f"prism3.creep.s{seed}", hidden="creep:2", seed=seed, outcome=outcome, sentence=""
        )

    demo = replace(tables.COLLECTED["demo"], file=tmp_path / "demo.csv")
    monkeypatch.setitem(tables.COLLECTED, "demo", demo)
    for stories in ([story(0, "named"), story(1, "failed")], [story(1, "named")]):
        for file in tmp_path.glob("*.json"):
            file.unlink()
        for each in stories:
            (tmp_path / f"{each.name}.json").write_text(each.model_dump_json())
        tables.collect("demo", tmp_path)
    rows = read_rows(DemoRow, tmp_path / "demo.csv")
    assert [(row.seed, row.outcome) for row in rows] == [(0, "named"), (1, "named")]


def test_a_table_of_another_name_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'sysid'"):
        with_tables("<!-- table: sysd -->\n<!-- end -->\n")


@dataclass(frozen=True)
class Row:
    name: str
    count: int
    size: float
    right: bool


def test_rows_survive_as_csv(tmp_path: Path) -> None:
    rows = [Row('a, "b"', 3, 0.125, True), Row("", 0, math.inf, False)]
    write_rows(tmp_path / "rows.csv", rows)
    assert read_rows(Row, tmp_path / "rows.csv") == rows
    write_rows(tmp_path / "rows.csv", [Row("c", 1, math.nan, True)])
    (row,) = read_rows(Row, tmp_path / "rows.csv")
    assert math.isnan(row.size)


def test_a_case_is_one_row() -> None:
    found = Named(
        effect="payload",
        location="s3",
        values={"mass": 11.42},
        low={"mass": 7.5},
        high={"mass": 15},
    )
    truth = Named(effect="payload", location="s3", values={"mass": 14.6})
    result = CaseResult(
        name="c.s0", group="single", robot="prism3", noise=2.0, truth=(truth,), answers=((found,),),
        held_out=3.0, verdict="EFFECT",
    )  # fmt: skip
    row = CaseRow.of(result)
    assert row.truth == "payload at s3: mass 14.6"
    assert row.answer == "payload at s3: mass 11.42 [7.5, 15]"
    assert (row.right, row.sizes, row.covered, row.held_out) == (True, 1, 1, 1.5)


@pytest.mark.parametrize("file", ["diagnosis/__main__.py", "tables.py"])
def test_a_benchmark_says_what_it_takes(file, monkeypatch, capsys):
    """Those that stand in pipelines/ too are asked there."""
    monkeypatch.setattr(sys, "argv", [file, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "benchmarks" / file), run_name="__main__")
    assert ended.value.code == 0
    assert "usage" in capsys.readouterr().out.lower()
