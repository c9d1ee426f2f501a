"""Public files that are judged again: what is known of them stays, what becomes of them is made anew."""

from pathlib import Path

import pytest

from benchmarks.lab_files import LabFileRow, judged, table
from flywheel.errors import DataError
from tests.unit.robots import lab_files

ROW = LabFileRow("lab/robots", "MIT", "0123abc", "a/robot.xml", "", 0, "", "", False, "passed")


@pytest.mark.parametrize(
    ("make", "robot", "outcome", "loop"),
    [
        (lab_files.crossed_bars, True, "It settles", "passed"),
        (lab_files.hinged_leg, False, "It has the joints 'hip' (hinge, of the body 'thigh') and others", ""),
        (lab_files.old_paper, False, "Simulation 0 of 6 of struts diverged", ""),
    ],
)  # fmt: skip
def test_a_file_is_judged_by_what_adapt_makes_of_it(make, robot, outcome, loop, tmp_path: Path):
    (tmp_path / "robots" / "a").mkdir(parents=True)
    make(tmp_path / "robots" / "a")
    row = judged(ROW, tmp_path, loop=False)
    assert (row.robot, row.loop) == (robot, loop) and row.outcome.startswith(outcome)
    assert row.found > 1 and len(row.sha256) == 64
    assert judged(row, tmp_path, loop=False) == row
    (cells,) = table([row])[2:]
    assert cells.startswith(f"| lab/robots, MIT | `a/robot.xml` | {row.found} |")
    assert ("refused: " in cells) == (not robot)


def test_another_file_than_the_one_that_was_judged_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="missing: lab/robots at 0123abc has it"):
        judged(ROW, tmp_path, loop=False)
    (tmp_path / "robots" / "a").mkdir(parents=True)
    path = lab_files.hinged_leg(tmp_path / "robots" / "a")
    row = judged(ROW, tmp_path, loop=False)
    path.write_text(path.read_text() + "\n")
    with pytest.raises(DataError, match="is not the file of lab/robots at 0123abc"):
        judged(row, tmp_path, loop=False)
