"""Tables with a row for each marker and time are tables with the markers as columns."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import yaml
from pyarrow import parquet

from flywheel.data.recordings import guess, read_recording
from flywheel.data.recordings.formats import open_log
from flywheel.errors import DataError
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.test_formats import TIME, check, imported, truth
from tests.unit.data.recordings.formats.truth import Truth

__all__ = ["truth"]


def rows(truth: Truth, order: np.random.Generator | None = None) -> list[dict[str, object]]:
    """A row for each marker that was seen, with the commands of its time, in any order."""
    made = [
        {
            "stamp": t,
            "marker": name,
            "x [mm]": 1e3 * p[0],
            "y [mm]": 1e3 * p[1],
            "z [mm]": 1e3 * p[2],
        }
        | {f"u{i}": u for i, u in enumerate(told)}
        for t, points, told in zip(
            TIME, writers.seen(truth, TIME), truth.commands(TIME), strict=True
        )
        for name, p in zip(writers.names(truth), points, strict=True)
        if np.isfinite(p[0])
    ]
    return made if order is None else [made[i] for i in order.permutation(len(made))]


def csv(path: Path, made: list[dict[str, object]]) -> Path:
    lines = [list(made[0]), *(each.values() for each in made)]
    path.write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    return path


@pytest.mark.parametrize("kind", ["csv", "parquet", "dictionary"])
def test_the_draft_of_a_long_table_is_its_map(kind: str, truth: Truth, tmp_path: Path) -> None:
    made, path = rows(truth, np.random.default_rng(0)), tmp_path / "log.dat"
    if kind == "csv":
        csv(path, made)
    else:
        table = pa.Table.from_pylist(made)
        if kind == "dictionary":
            names = table["marker"].dictionary_encode()
            table = table.set_column(1, "marker", names)
        parquet.write_table(table, path)
    text = guess([path], truth.robot, tmp_path)
    assert "log.dat has a row for each marker and time" in text
    draft = yaml.safe_load(text)
    assert draft["markers"] == {name: name for name in writers.names(truth)}
    assert "units" not in draft  # those of the header
    (tmp_path / "map.yaml").write_text(text)
    check(read_recording(tmp_path / "map.yaml", truth.robot).episodes[0].trajectory, truth)


def test_where_still_chooses_rows_of_a_long_table(truth: Truth, tmp_path: Path) -> None:
    path = csv(tmp_path / "log.csv", rows(truth))
    entries = [f"{{path: log.csv, time: stamp, where: {{marker: {n}}}}}" for n in ("front", "left")]
    text = (
        f"files: [{entries[0]}]\nunits: {{points: mm}}\n"
        "markers: {front: ['x [mm]', 'y [mm]', 'z [mm]'], left: null, right: null}\n"
        "commands: {winch_fl: u0, winch_fr: u1, rear: {from: u2, unit: m}}\n"
    )
    track, _ = imported(path, text, truth)
    points = truth.points(TIME)
    np.testing.assert_allclose(track.observations.points[:, 0], points[:, 0], atol=1e-9)


def table(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_markers_that_have_numbers_are_named_by_them(tmp_path: Path) -> None:
    path = table(
        tmp_path / "a.csv",
        "Frame;Point ID;Pos_X;Pos_Y;Pos_Z;lamp",
        *("2;7;1;2;3;0", "1;7;4;5;6;1", "1;12;7;8;9;1", "2;;0;0;0;0", "2;;1;1;1;0"),
    )
    (stream,) = open_log(path).streams
    assert list(stream.columns) == [
        "Frame", "lamp", "12.x", "7.x", "12.y", "7.y", "12.z", "7.z",
    ]  # fmt: skip
    np.testing.assert_array_equal(stream.columns["Frame"], [1, 2])
    np.testing.assert_array_equal(stream.columns["lamp"], [1, 0])
    np.testing.assert_array_equal(stream.columns["7.y"], [5, 2])
    np.testing.assert_array_equal(stream.columns["12.z"], [9, np.nan])


def test_two_rows_of_one_marker_at_one_time_are_refused(tmp_path: Path) -> None:
    lines = ["0,a,1,1,1", "0,b,2,2,2", "0.5,b,1,1,1", "0.5,a,1,1,1", "0.5,b,3,3,3"]
    path = table(tmp_path / "a.csv", "time,marker,x,y,z", *lines)
    with pytest.raises(DataError, match=r"the marker 'b' has 2 rows at 0.5, in 1 places"):
        open_log(path)


@pytest.mark.parametrize(
    ("header", "lines"),
    [
        ("time,marker,x,y,z", ["0,a,1,1,1", "1,b,2,2,2"]),  # a time has one row
        ("time,marker,x,y,z", ["0,a,1,1,1", "0,a,2,2,2"]),  # one marker: sent twice
        ("time,kind,x,y,z", ["0,a,1,1,1", "0,b,2,2,2"]),  # no column of markers
        ("time,marker,x,y,v", ["0,a,1,1,1", "0,b,2,2,2"]),  # no three coordinates
        ("when,marker,x,y,z", ["0,a,1,1,1", "0,b,2,2,2"]),  # no time
    ],
)
def test_other_tables_stay_as_they_are(header: str, lines: list[str], tmp_path: Path) -> None:
    (stream,) = open_log(table(tmp_path / "a.csv", header, *lines)).streams
    assert stream.rows is None and len(stream.columns["x"]) == 2
