"""Public MJCFs that were made for other work: what `flywheel robot check` and `adapt` make of them.

    python -m benchmarks.lab_files FOLDER [--loop]
    python -m benchmarks.tables              makes the table of docs/results/lab_files.md

FOLDER has a checkout of each repository in benchmarks/results/lab_files.csv, by its name; nothing is fetched.
A file whose sha256 is another is refused; a new one is a row of the CSV with its first four cells. `--loop`
runs configs/smoke.yaml on each file that becomes a robot, some two minutes for each.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.command import parser_of
from benchmarks.rows import RESULTS, read_rows, write_rows
from flywheel.cli.robot.settling import control_step, verdict
from flywheel.cli.robot.steps import measured
from flywheel.dynamics.plant import Plant, settling
from flywheel.errors import DataError, ModelError
from flywheel.options import AdaptOptions
from flywheel.robots import read_robot
from flywheel.robots.adapt import adapt

LAB_FILES_CSV = RESULTS / "lab_files.csv"
SMOKE = Path(__file__).parents[1] / "configs" / "smoke.yaml"
WITHOUT = ("collect.gaits=0", "collect.drops=0", "evaluate.unseen=[]")  # as `robot check` says
MORE = re.compile(
    r"(, ('[^']*'|without a name|and \d+ more)( \([^)]*\))?)+"
)  # after the first name


@dataclass(frozen=True)
class LabFileRow:
    """A public MJCF, and what became of it.

    Attributes:
      repository: on GitHub.
      licence: of the repository.
      commit: of the repository.
      file: its path there.
      sha256: of its content.
      found: number of problems that `robot check` tells.
      by: the adaptations that were applied.
      outcome: how the robot moves while its winches hold, or the reason why there is none.
      robot: it can be used.
      loop: "passed" or "failed"; "" if the loop was not run.
    """

    repository: str
    licence: str
    commit: str
    file: str
    sha256: str
    found: int
    by: str
    outcome: str
    robot: bool
    loop: str


def judged(row: LabFileRow, folder: Path, loop: bool) -> LabFileRow:
    """A row with what becomes of its file now.

    Raises:
      DataError: the file is missing, or another one.
    """
    path = folder / row.repository.rpartition("/")[2] / row.file
    if not path.exists():
        raise DataError(f"{path} is missing: {row.repository} at {row.commit} has it.")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if row.sha256 not in ("", digest):
        raise DataError(f"{path} is not the file of {row.repository} at {row.commit}.")
    driven = "<actuator" in path.read_text(encoding="utf-8")
    found = adapt(path, AdaptOptions(winches=() if driven else ("*",)))
    used, outcome = (False, found.left[0]) if found.left else moved(found.xml)
    names = " ".join(dict.fromkeys(name for name, _ in found.changes))
    return replace(
        row,
        sha256=digest,
        found=len(found.mended),
        by=names,
        outcome=MORE.sub(" and others", outcome.partition(". ")[0].rstrip(".")),
        robot=used,
        loop=looped(found.xml) if used and loop else row.loop if used else "",
    )


def moved(xml: str) -> tuple[bool, str]:
    """True if the robot of an MJCF can be used, and a sentence on its motion."""
    robot = read_robot(xml)
    plant = Plant(robot, control_step(robot, None))
    try:
        used, words = verdict(robot, settling(plant))
        if used:
            measured(plant)
    except ModelError as error:
        return False, str(error)
    return used, words


def looped(xml: str) -> str:
    """The outcome of the smallest run on an MJCF."""
    with TemporaryDirectory(prefix="flywheel-") as folder:
        mjcf = Path(folder) / "robot.xml"
        mjcf.write_text(xml, encoding="utf-8")
        given = (str(SMOKE), "--folder", f"{folder}/run", f"model={mjcf}", *WITHOUT)
        run = subprocess.run([sys.executable, "-m", "flywheel.cli", "run", *given])
    return "failed" if run.returncode else "passed"


def table(rows: Sequence[LabFileRow]) -> list[str]:
    """Lines of Markdown: one for each file."""
    lines = [
        "| repository | file | found | adapted by | outcome | loop |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        outcome = row.outcome if row.robot else f"refused: {row.outcome}"
        adapted = ", ".join(f"`{name}`" for name in row.by.split())
        cells = [f"`{row.file}`", str(row.found), adapted, outcome, row.loop]
        lines.append(f"| {row.repository}, {row.licence} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Judge all files again."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--loop", action="store_true")
    given = parser.parse_args()
    rows = [judged(row, given.folder, given.loop) for row in read_rows(LabFileRow, LAB_FILES_CSV)]
    write_rows(LAB_FILES_CSV, rows)


if __name__ == "__main__":
    main()
