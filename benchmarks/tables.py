"""Results of the benchmarks: imported as CSV, and shown as the tables of the pages in docs/results/.

    python -m benchmarks.tables                              makes the tables of the pages anew
    python -m benchmarks.tables collect diagnosis FOLDER     results of `python -m benchmarks.diagnosis`
    python -m benchmarks.tables collect adoption FOLDER      ... of `python -m benchmarks.adoption`
    python -m benchmarks.tables collect sysid FOLDER         ... of `python -m benchmarks.sysid`
    python -m benchmarks.tables collect residual FOLDER      ... of `python -m benchmarks.residual`
    python -m benchmarks.tables collect demo FOLDER          ... of `python -m benchmarks.demo`
    python -m benchmarks.tables collect robot FOLDER         ... of `python -m benchmarks.robot`
    python -m benchmarks.tables collect paper TABLE FOLDER   ... of `python pipelines/paper_table.py`
    python -m benchmarks.tables collect navigation NAME RUN  a run, or a file of `flywheel navigate --results`

A table is in a page between `<!-- table: NAME -->` and `<!-- end -->`.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from benchmarks import (
    adoption,
    budget,
    demo,
    lab_files,
    log_formats,
    navigation,
    networks,
    recipes,
    residual,
    robot,
    steps,
    trunk,
)
from benchmarks.adoption import AdoptionRow, AdoptionStudy
from benchmarks.command import parser_of
from benchmarks.demo import DemoResult, DemoRow
from benchmarks.diagnosis.case_result import CaseResult
from benchmarks.diagnosis.case_row import CaseRow
from benchmarks.diagnosis.rates import hard_table, outside_table, rates_table
from benchmarks.lab_files import LAB_FILES_CSV, LabFileRow
from benchmarks.log_formats import LOG_FORMATS_CSV, LogFormatRow
from benchmarks.navigation import EpisodeRow, ModelRow
from benchmarks.paper.definition import read_table, table_names
from benchmarks.paper.rows import CellRow, left_out_table, plants_table, result_table
from benchmarks.paper.table import Table
from benchmarks.recipes import RECIPES_CSV, RecipeRow
from benchmarks.residual import ResidualRow, ResidualStudy
from benchmarks.robot import DriveRow, ErrorRow
from benchmarks.rows import RESULTS, other_rows, read_rows, rows_there, values_of, write_rows
from benchmarks.steps import REST_CSV, STEPS_CSV, RestRow, StepRow
from benchmarks.sysid import table as sysid
from benchmarks.sysid.study import CaseStudy
from benchmarks.sysid.table import ContenderRow
from benchmarks.trunk import TRUNK_CSV, TrunkRow
from flywheel.cli.driving.drives import read_drives
from flywheel.errors import ConfigError, FlywheelError
from flywheel.outputs import write_output
from flywheel.registry import lookup
from flywheel.results import RunResult

PAGES = Path(__file__).parents[1] / "docs" / "results"
BLOCK = re.compile(r"(?<=<!-- table: )([\w-]+)( -->\n).*?(?=<!-- end -->)", re.DOTALL)
DIAGNOSIS = RESULTS / "diagnosis.csv"
ADOPTION = RESULTS / "adoption.csv"
SYSID = RESULTS / "sysid.csv"
RESIDUAL = RESULTS / "residual.csv"
DEMO = RESULTS / "demo.csv"
ROBOT_ERRORS = RESULTS / "robot_errors.csv"
ROBOT_DRIVES = RESULTS / "robot_drives.csv"
MODELS = RESULTS / "navigation_models.csv"
EPISODES = RESULTS / "navigation_episodes.csv"
PAPER = RESULTS / "paper"  # a file for each table
RUN = ("run", "seed")  # what says which run a row of these two is of


def diagnosis(of_set: str, groups: Iterable[str], size: str = "") -> list[CaseRow]:
    """Cases of prism3 of some groups; of single effects those of one size."""
    return [
        row
        for row in _of_set(of_set)
        if row.robot == "prism3"
        and row.group in groups
        and (not row.group.endswith("single") or f".{size}." in row.name)
    ]


def _of_set(name: str) -> list[CaseRow]:
    return [row for row in read_rows(CaseRow, DIAGNOSIS) if row.set == name]


def robot_errors(of_set: str) -> list[str]:
    """Errors of the models of runs on a robot with a set of hidden effects."""
    return robot.errors_table(read_rows(ErrorRow, ROBOT_ERRORS), of_set)


def robot_drives(of_set: str) -> list[str]:
    """Drives of the planners of runs on a robot with a set of hidden effects."""
    return robot.drives_table(read_rows(DriveRow, ROBOT_DRIVES), of_set)


def paper_rows(name: str) -> list[CellRow]:
    """Collected results of a table of models."""
    return rows_there(CellRow, PAPER / f"{name}.csv")


def paper_left_out() -> list[str]:
    """Cells that no table of models has results of."""
    return left_out_table((read_table(name), paper_rows(name)) for name in table_names())


def paper_plants() -> list[str]:
    """Errors of the long training on each plant, by table, and of exact physics, restarted, in brackets."""
    lines: list[str] = []
    for name, physics in (("long", "sim2sim"), ("perturbed", "perturbed")):
        trained, restarted = (
            [
                replace(row, dataset=f"{name}: {row.dataset}")
                for row in paper_rows(table)
                if (row.robot, row.method) == ("prism3", method)
            ]
            for table, method in ((name, "network_long"), (physics, "restarted"))
        )
        lines += plants_table(trained, restarted)[2 if lines else 0 :]
    return lines


TABLES: dict[str, Callable[[], list[str]]] = {
    "diagnosis": lambda: rates_table(diagnosis("main", ("none", "single"), "x1")),
    "diagnosis-half": lambda: rates_table(diagnosis("main", ("single",), "x0.5")),
    "diagnosis-twice": lambda: rates_table(diagnosis("main", ("single",), "x2")),
    "diagnosis-outside": lambda: outside_table(diagnosis("main", ("outside",))),
    "diagnosis-pairs": lambda: rates_table(diagnosis("main", ("pairs",))),
    "diagnosis-triples": lambda: rates_table(diagnosis("main", ("triples",))),
    "diagnosis-hard": lambda: hard_table(_of_set("main")),
    "diagnosis-fresh": lambda: rates_table(diagnosis("fresh", ("single", "pairs"), "x1")),
    "diagnosis-fresh-outside": lambda: outside_table(diagnosis("fresh", ("outside",))),
    "diagnosis-fresh-hard": lambda: hard_table(_of_set("fresh")),
    "diagnosis-network": lambda: rates_table(diagnosis("network", ("none", "single"), "x2")),
    "as-built-half": lambda: rates_table(diagnosis("as-built-half", ("messy-single",), "x2")),
    "adoption": lambda: adoption.table(read_rows(AdoptionRow, ADOPTION)),
    "residual": lambda: residual.table(read_rows(ResidualRow, RESIDUAL)),
    "demo": lambda: demo.table(read_rows(DemoRow, DEMO)),
    "robot-errors": lambda: robot_errors("library"),
    "robot-drives": lambda: robot_drives("library"),
    "robot-drives-longer": lambda: robot_drives("library_implicitfast"),
    "robot-errors-cogging": lambda: robot_errors("cogging"),
    "robot-errors-rod_flex": lambda: robot_errors("rod_flex"),
    "lab-files": lambda: lab_files.table(read_rows(LabFileRow, LAB_FILES_CSV)),
    "log-formats": lambda: log_formats.table(read_rows(LogFormatRow, LOG_FORMATS_CSV)),
    "networks": networks.table,
    "budget": lambda: budget.table("prism3"),
    "budget-regions": lambda: budget.regions_table("prism3"),
    "recipes": lambda: recipes.table(read_rows(RecipeRow, RECIPES_CSV)),
    "steps": lambda: steps.motions_table(read_rows(StepRow, STEPS_CSV)),
    "steps-others": lambda: steps.others_table(read_rows(StepRow, STEPS_CSV)),
    "steps-rest": lambda: steps.rest_table(read_rows(RestRow, REST_CSV)),
    "sysid": lambda: sysid.table(read_rows(ContenderRow, SYSID)),
    "trunk": lambda: trunk.table(read_rows(TrunkRow, TRUNK_CSV)),
    "navigation": lambda: navigation.run_table(
        "s_course_from_little",
        read_rows(ModelRow, MODELS),
        read_rows(EpisodeRow, EPISODES),
        "s_course",
    ),
    "paper-left-out": paper_left_out,
    "paper-plants": paper_plants,
    **{
        f"paper-{file.stem}": lambda name=file.stem: result_table(  # type: ignore[misc]
            read_table(name), paper_rows(name)
        )
        for file in sorted(PAPER.glob("*.csv"))
    },
    "navigation-courses": lambda: navigation.courses_table(
        read_rows(EpisodeRow, EPISODES),
        {
            "five courses, A*": "A*",
            "five courses, MPPI": "MPPI",
            "five courses, MPPI with turns": "MPPI with turns",
            "five courses, network with turns": "network with turns",
            "five courses, network, turns counted": "network with turns, turns counted",
        },
    ),
    "navigation-episodes": lambda: navigation.episodes_table(read_rows(EpisodeRow, EPISODES)),
}


def with_tables(page: str) -> str:
    """A page with its tables made anew.

    Raises:
      UnknownNameError: there is no table of a name in it.
    """

    def made(block: re.Match[str]) -> str:
        lines = lookup(TABLES, block[1], "table")()
        return f"{block[1]}{block[2]}" + "\n".join(lines) + "\n"

    return BLOCK.sub(made, page)


@dataclass(frozen=True)
class Collected:
    """Conversion of a benchmark's results into a table.

    Attributes:
      file: the CSV file.
      row: class of a row.
      of: names of the fields that identify a result.
      kind: class of a JSON file in the benchmark's folder.
      rows: of one of these.
    """

    file: Path
    row: type[Any]
    of: tuple[str, ...]
    kind: type[BaseModel]
    rows: Callable[[Any], Iterable[Any]]


COLLECTED = {
    "adoption": Collected(
        ADOPTION, AdoptionRow, ("name",), AdoptionStudy, lambda each: [adoption.row_of(each)]
    ),
    "residual": Collected(
        RESIDUAL,
        ResidualRow,
        ("hidden", "minutes", "seed"),
        ResidualStudy,
        lambda each: [residual.row_of(each)],
    ),
    "demo": Collected(DEMO, DemoRow, ("name",), DemoResult, lambda each: [demo.row_of(each)]),
    "sysid": Collected(SYSID, ContenderRow, ("name",), CaseStudy, sysid.rows_of),
}


def collect(kind: str, folder: Path) -> None:
    """Import the results of a benchmark's folder; rows of other results stay."""
    to = COLLECTED[kind]
    new = [row for text in _texts(folder) for row in to.rows(to.kind.model_validate_json(text))]
    kept = other_rows(to.row, to.file, to.of, {values_of(row, to.of) for row in new})
    write_rows(to.file, [*kept, *new])


def collect_diagnosis(folder: Path, of_set: str) -> None:
    """Import the cases of a folder, as those of one set."""
    cases = [CaseResult.model_validate_json(text) for text in _texts(folder)]
    new = [CaseRow.of(case, of_set) for case in cases]
    write_rows(DIAGNOSIS, [*other_rows(CaseRow, DIAGNOSIS, ("set",), {(of_set,)}), *new])


def collect_robot(folder: Path) -> None:
    """Import the finished studies of a folder; others stay."""
    studies = robot.found_studies(folder)
    taken = {(study.set, study.seed) for study in studies}
    errors = [row for study in studies for row in study.errors()]
    drives = [row for study in studies for row in study.driven()]
    write_rows(ROBOT_ERRORS, [*other_rows(ErrorRow, ROBOT_ERRORS, ("set", "seed"), taken), *errors])
    write_rows(ROBOT_DRIVES, [*other_rows(DriveRow, ROBOT_DRIVES, ("set", "seed"), taken), *drives])


def collect_paper(name: str, folder: Path, overrides: Sequence[str] = ()) -> None:
    """Import the cells of a table of models, in its order; others stay.

    Args:
      name: of the table.
      folder: with its results.
      overrides: `key=value`, with which they were made.

    Raises:
      ConfigError: there is none, or one has other settings than the table has.
    """
    table = read_table(name, overrides=overrides)
    if not (new := Table(table, folder).rows()):
        raise ConfigError(f"There is no result of the table {name} in {folder}.")
    file, of = PAPER / f"{name}.csv", ("robot", "dataset", "method", "seed")
    kept = other_rows(CellRow, file, of, {values_of(row, of) for row in new})
    rows = [*kept, *new]
    table = table.model_copy(update={"seeds": sorted({row.seed for row in rows})})
    order = {values_of(cell, of): place for place, cell in enumerate(table.cells())}
    write_rows(file, sorted(rows, key=lambda row: order.get(values_of(row, of), len(order))))


def _texts(folder: Path) -> list[str]:
    files = (file for file in sorted(folder.glob("*.json")) if ".model." not in file.name)
    if not (texts := [file.read_text(encoding="utf-8") for file in files]):
        raise ConfigError(f"There is no result in {folder}.")
    return texts


def collect_navigation(name: str, source: Path, seed: int) -> None:
    """Import the episodes of a run's folder, or of a file of `flywheel navigate --results`."""
    if source.is_dir():
        result = RunResult.load(source)
        seed = result.config["seed"]
        models = other_rows(ModelRow, MODELS, RUN, [(name, seed)])
        write_rows(MODELS, [*models, *navigation.models_of(name, result)])
        new = list(navigation.episodes_of(name, result))
    else:
        new = list(navigation.driven_episodes(name, seed, read_drives(source)))
    write_rows(EPISODES, [*other_rows(EpisodeRow, EPISODES, RUN, [(name, seed)]), *new])


def main() -> None:
    """Rebuild the tables of the pages, or import results."""
    parser = parser_of(__file__, __doc__)
    verbs = parser.add_subparsers(dest="verb")
    verb = verbs.add_parser("collect", help="import results as CSV")
    kinds = verb.add_subparsers(dest="kind", required=True)
    for kind in ("diagnosis", "robot", *COLLECTED):
        kinds.add_parser(kind).add_argument("folder", type=Path)
    kinds.choices["diagnosis"].add_argument("--set", default="main", help="of the cases")
    paper = kinds.add_parser("paper")
    paper.add_argument("table", help="its name")
    paper.add_argument("folder", type=Path)
    paper.add_argument("overrides", nargs="*", help="KEY=VALUE, with which it was made")
    driven = kinds.add_parser("navigation")
    driven.add_argument("name", help="of the run")
    driven.add_argument("run", type=Path, help="its folder, or a file of episodes")
    driven.add_argument("--seed", type=int, default=0, help="of the run, for a file of episodes")
    given = parser.parse_args()
    try:
        _do(given)
    except FlywheelError as error:
        parser.error(str(error))


def _do(given: argparse.Namespace) -> None:
    if given.verb is None:
        for page in sorted(PAGES.glob("*.md")):
            write_output(page, with_tables(page.read_text(encoding="utf-8")))
    elif given.kind == "navigation":
        collect_navigation(given.name, given.run, given.seed)
    elif given.kind == "paper":
        collect_paper(given.table, given.folder, given.overrides)
    elif given.kind == "diagnosis":
        collect_diagnosis(given.folder, given.set)
    elif given.kind == "robot":
        collect_robot(given.folder)
    else:
        collect(given.kind, given.folder)


if __name__ == "__main__":
    main()
