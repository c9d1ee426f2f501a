"""The clock of a second file is found from what the points and the winches have both seen."""

from pathlib import Path

import numpy as np
import pytest

from flywheel.data.recordings import Imported, read_map, read_recording
from flywheel.dynamics.plant import cables_by_winches
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.reports.alignment_figure import alignment_figure
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import COMMANDS, MOTORS
from tests.unit.data.recordings.formats.truth import Truth, made

OFFSET, PACE = 1.8124, 1.0003
WINCHES = (
    "winches:\n"
    "  winch_fl: {from: ticks, unit: ticks, per: 4096, drum: 0.02}\n"
    "  rear: {from: rear, unit: mm}\n"
)
AUTO = "{path: take.tsv}, " + MOTORS.replace("}", ", align: auto}")


@pytest.fixture(scope="module")
def truth() -> Truth:
    return made(32.0)


@pytest.fixture
def files(truth: Truth, tmp_path: Path) -> Path:
    """A tracker's file of 29 s, and a controller's that begins 2 s later, by its own clock."""
    writers.qualisys(truth, tmp_path / "take.tsv", np.arange(2900) / writers.RATE)
    moved(truth, tmp_path, np.arange(2.0, 31.5, 1 / 125))
    return tmp_path


def moved(truth: Truth, folder: Path, time: Floats) -> None:
    writers.motors(truth, folder / "motors.txt", time, clock=(time - OFFSET) / PACE)


def aligned(folder: Path, truth: Truth, files: str, winches: str = WINCHES) -> Imported:
    (folder / "map.yaml").write_text(f"files: [{files}]\n{COMMANDS}{winches}")
    how = read_map(folder / "map.yaml")
    return read_recording(folder / "take.tsv", truth.robot, how=how, follow=cables_by_winches)


def clock(found: Imported) -> tuple[float, float]:
    """Offset and pace, from the words about them."""
    (words,) = [
        f.words for f in found.report.findings if f.kind == "clock" and f.action == "aligned"
    ]
    numbers = words.replace(",", "").split()
    return float(numbers[4]), float(numbers[numbers.index("second") + 1])


@pytest.mark.parametrize("winches", [WINCHES, ""])
def test_offset_and_pace_are_found(winches: str, files: Path, truth: Truth) -> None:
    found = aligned(files, truth, AUTO, winches)
    offset, pace = clock(found)
    middle = 15.0
    assert offset + pace * middle == pytest.approx(OFFSET + PACE * middle, abs=5e-4)
    assert pace == pytest.approx(PACE, abs=2e-5)
    track = found.episodes[0].trajectory
    time = 2.0 + 0.01 * np.arange(track.steps + 1)
    assert np.nanmax(np.abs(track.observations.points - truth.points(time))) < 1e-4
    for cable in found.compared:
        assert cable.file == "motors.txt"
        made = np.interp(cable.time, cable.winch_time, cable.made, left=np.nan, right=np.nan)
        assert np.nanmax(np.abs(made - cable.lengths)) < 5e-3 < np.nanstd(cable.lengths)
    figure = alignment_figure(found.compared)
    assert figure is not None and len(figure.axes) == len(found.compared) > 0


def test_a_short_recording_has_no_pace_of_its_own(files: Path, truth: Truth) -> None:
    moved(truth, files, np.arange(2.0, 7.0, 1 / 125))
    offset, pace = clock(aligned(files, truth, AUTO))
    assert pace == pytest.approx(PACE, abs=5e-4)
    assert offset + pace * 2.7 == pytest.approx(OFFSET + PACE * 2.7, abs=2e-3)


def test_the_file_with_the_points_comes_first(files: Path, truth: Truth) -> None:
    with pytest.raises(DataError, match="all points in the first file"):
        aligned(files, truth, f"{MOTORS}, {{path: take.tsv, align: auto}}")


def test_files_of_different_motions_have_no_common_clock(files: Path) -> None:
    other = made(32.0, seed=8)
    writers.qualisys(other, files / "take.tsv", np.arange(2900) / writers.RATE)
    with pytest.raises(DataError, match=r"align: auto (found no offset|cannot tell)"):
        aligned(files, other, AUTO)


def test_a_clock_is_not_found_from_winches_at_rest(files: Path, truth: Truth) -> None:
    (files / "map.yaml").write_text(
        f"files: [{AUTO}]\ncommands: {{winch_fl: hold, winch_fr: hold, rear: hold}}\n"
    )
    with pytest.raises(DataError, match="needs commands or positions of winches in motors.txt"):
        read_recording(files / "take.tsv", truth.robot, how=read_map(files / "map.yaml"))
