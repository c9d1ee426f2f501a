"""`flywheel diagnose` compared with fitting the same recordings with `mujoco.sysid`.

    python -m benchmarks.sysid OUT_FOLDER

Writes one JSON file per case into the folder, keeps existing ones, and prints the table. Needs `pip
install "mujoco[sysid]"`. `python -m benchmarks.tables collect sysid OUT_FOLDER` imports the results
into benchmarks/results/.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.command import parser_of
from benchmarks.diagnosis.cases import cases
from benchmarks.sysid.study import CaseStudy, study
from benchmarks.sysid.table import HEADER, HIDDEN, line, rows_of
from flywheel.outputs import write_output
from flywheel.registry import lookup
from flywheel.robots import load_robot


def main() -> None:
    """Study the cases that the folder has no result of yet, and print the table of all."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", default="prism3")
    parser.add_argument("--hidden", nargs="*", default=HIDDEN, help="effects to hide")
    given = parser.parse_args()
    known = {
        case.effects[0].name: case
        for case in cases(load_robot(given.robot), ["single"], [1.0], [0])
    }
    wanted = [lookup(known, name, "hidden effect") for name in given.hidden]
    print(HEADER)
    for case in wanted:
        file = given.folder / f"{case.name}.json"
        if not file.exists():
            write_output(file, study(case).model_dump_json(indent=1) + "\n")
        for row in rows_of(CaseStudy.model_validate_json(file.read_text())):
            print(line(row), flush=True)


if __name__ == "__main__":
    main()
