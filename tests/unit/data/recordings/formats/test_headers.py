"""Tables of laboratories have titles above their header, headers of two rows, and times in two columns."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from flywheel.data.recordings import guess, read_recording
from flywheel.data.recordings.formats import open_log
from flywheel.errors import DataError
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import TIME, check, truth
from tests.unit.data.recordings.formats.truth import Y_UP, Truth

__all__ = ["truth"]
GERMAN = "time;a;b;c\n0,0;1,5;2,5;3\n0,1;1,6;2,6;3\n0,2;1,7;2,7;3\n"
CELLS = {"time": [0, 0.1, 0.2], "a": [1.5, 1.6, 1.7], "b": [2.5, 2.6, 2.7], "c": [3, 3, 3]}


def columns(tmp_path: Path, text: str) -> dict[str, list[float]]:
    (tmp_path / "log.csv").write_text(text)
    (stream,) = open_log(tmp_path / "log.csv").streams
    return {name: values.tolist() for name, values in stream.columns.items()}


@pytest.mark.parametrize(
    "titles",
    [
        "",
        "sep=;\n",
        "Experiment 3\n\n",
        "Versuch 3, am Montag\nDatum: 01.12.2026\n",
        "Date;01.12.2026\nOperator;me\n",
        "Date;01.12.2026;;\n;;;\n",
    ],
)
def test_titles_above_the_header_are_passed_over(titles: str, tmp_path: Path) -> None:
    assert columns(tmp_path, titles + GERMAN) == CELLS
    points = GERMAN.replace(",", ".").replace(";", ",")
    assert columns(tmp_path, titles.replace(";", ",") + points) == CELLS


@pytest.mark.parametrize("between", [";", "\t", " "])
def test_decimal_commas_are_no_separators_without_a_header(between: str, tmp_path: Path) -> None:
    rows = GERMAN.split("\n", 1)[1].replace(";", between)
    assert list(columns(tmp_path, rows).values()) == list(CELLS.values())


def test_a_table_without_names_may_have_a_title(tmp_path: Path) -> None:
    rows = GERMAN.split("\n", 1)[1]
    assert list(columns(tmp_path, f"Experiment 3\n{rows}").values()) == list(CELLS.values())
    with pytest.raises(DataError, match="line 2 has 4 cells, the header has 2"):
        columns(tmp_path, f"a;b\n{rows}")


@pytest.mark.parametrize("row", [",a,,,b,,", "time,a,a,a,b,b,b"])
@pytest.mark.parametrize("units", ["", "s,mm,mm,mm,mm,mm,mm\n"])
def test_axes_below_the_names_of_markers_are_theirs(row: str, units: str, tmp_path: Path) -> None:
    text = f"{row}\ntime,X,Y,Z,X,Y,Z\n{units}0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n"
    names = ["time", "a.x", "a.y", "a.z", "b.x", "b.y", "b.z"]
    assert list(columns(tmp_path, text)) == names


@pytest.mark.parametrize(
    ("sec", "nanosec", "name"),
    [("sec", "nanosec", "time"), ("a.stamp.secs", "a.stamp.nsecs", "a.stamp")],
)
def test_seconds_and_nanoseconds_are_one_time(
    sec: str, nanosec: str, name: str, tmp_path: Path
) -> None:
    found = columns(tmp_path, f"{sec},{nanosec},u\n1764547200,999000000,1\n1764547201,4000000,2\n")
    np.testing.assert_allclose(np.diff(found[name]), 0.005, atol=1e-6)
    taken = columns(tmp_path, f"{sec},{nanosec},{name}\n1,999000000,1\n2,4000000,2\n")
    assert taken[name] == [1, 2]


def test_a_log_with_a_title_needs_no_map(truth: Truth, tmp_path: Path) -> None:
    writers.table(truth, tmp_path / "log.csv", TIME)
    text = (tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text("sep=,\n" + text)
    check(read_recording(tmp_path / "log.csv", truth.robot).episodes[0].trajectory, truth)


def test_a_log_with_decimal_commas_needs_no_map(truth: Truth, tmp_path: Path) -> None:
    writers.table(truth, path := tmp_path / "log.csv", TIME)
    text = path.read_text().replace(",", ";").replace(".", ",")
    names, rows = text.split("\n", 1)
    path.write_text("\n".join([names.replace(",", "."), rows]))
    check(read_recording(path, truth.robot).episodes[0].trajectory, truth)


@pytest.mark.parametrize(
    "text",
    [
        "Format Version;1,23;Take Name;a\n",
        "NO_OF_FRAMES;100\n",
        "PathFileType;4;(X/Y/Z)\n",
        "Trajectories;;;\n100;;;\n",
    ],
)
def test_exports_that_a_spreadsheet_saved_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="saved anew, perhaps by a spreadsheet"):
        columns(tmp_path, text)


@pytest.mark.parametrize("text", ["01.12.2026 10:00:{:06.3f}", "00:{:06.3f}", "{:.2f} AM"])
def test_times_that_cannot_be_read_are_named_and_no_rate_is_invented(
    text: str, truth: Truth, tmp_path: Path
) -> None:
    writers.table(truth, path := tmp_path / "log.csv", TIME)
    header, *rows = path.read_text().splitlines()
    assert header.startswith("t,")
    rows = [f"{text.format(t)},{row.split(',', 1)[1]}" for t, row in zip(TIME, rows, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    draft = guess([path], truth.robot, tmp_path)
    words = f"the times 't' begin with '{text.format(0)}'"
    assert f"# log.csv: {words}" in draft
    assert yaml.safe_load(draft)["files"] == [{"path": "log.csv", "rate": None}]
    (tmp_path / "map.yaml").write_text(draft)
    with pytest.raises(DataError, match=words):
        read_recording(tmp_path / "map.yaml", truth.robot)


def test_a_draft_turns_a_log_that_lacks_a_marker(truth: Truth, tmp_path: Path) -> None:
    first, second, missing = writers.names(truth)
    points = truth.points(TIME) @ Y_UP.T
    names = [f"{name}.{axis}" for name in (first, second) for axis in "xyz"]
    rows = [",".join(map(str, [t, *p[:2].ravel()])) for t, p in zip(TIME, points, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join([",".join(["t", *names]), *rows]) + "\n")
    draft = yaml.safe_load(guess([tmp_path / "log.csv"], truth.robot, tmp_path))
    assert draft["markers"] == {first: first, second: second, missing: None}
    assert draft["axes"] == {"x": "x", "y": "-z", "z": "y"}
