"""Any file is either a table of numbers or refused, in the memory of the numbers that are wanted."""

import csv
import gzip
import hashlib
import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flywheel.data.recordings import read_recording
from flywheel.data.recordings.mapping import RecordingMap
from flywheel.data.recordings.tables.table import LONGEST_LINE, Table, open_table
from flywheel.errors import ConfigError, DataError
from tests.unit.data.recordings.conftest import Sheet


def read(content: str | bytes, folder: Path, *names: str, most: int = 100) -> Table:
    path = folder / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with open_table(path) as sheet:
        return sheet.read(names or sheet.header, most)


@pytest.mark.parametrize(
    "content",
    [
        "a,b\n1,2\n3,\n",
        "a;b\r\n1;2\r\n3;\r\n",
        "a\tb\r1\t2\r3\t",
        '\ufeff\n \n"a","b"\n"1"," 2 "\n,\n\n+3e0,NaN',
        " a , b\n1,2.0\n3, \n",
    ],
)
def test_separators_quotes_blank_rows_and_line_ends_make_no_difference(content, tmp_path):
    table = read(content, tmp_path)
    assert table.names == ("a", "b")
    np.testing.assert_array_equal(table.values, [[1, 2], [3, np.nan]])
    assert table.digest == hashlib.sha256(content.encode()).hexdigest()


def test_each_row_knows_its_line(tmp_path: Path) -> None:
    assert read("\na,b\n1,2\n\n,\n3,4\n", tmp_path).lines.tolist() == [3, 6]


def test_many_numbers_are_those_that_python_reads_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    numbers = np.frombuffer(rng.bytes(8 * 6000))
    numbers = numbers[np.isfinite(numbers)].tolist()
    cells = [form.format(number) for number in numbers for form in ("{!r}", "{:.6g}", "{:.25e}")]
    table = read("a\n" + "\n".join(cells), tmp_path, most=20_000)
    assert table.values.tobytes() == np.array(list(map(float, cells))).tobytes()


def test_numbers_that_are_written_in_an_unusual_way_are_read_too(tmp_path: Path) -> None:
    cells = ["0.1", "1e-400", "-0.0", "2.2250738585072011e-308", "1_000", "inf", "9" * 400, "-nan"]
    table = read("a\n" + "\n".join(cells), tmp_path)
    assert table.values.tobytes() == np.array(list(map(float, cells))).tobytes()


LINES = [
    "1,x,2\n",
    "3,,-4e-3\r\n",
    "\n",
    ",,\n",
    '"5","a\nb", 6\n',
    '7,"8,",9\n',
    "nan,a,1_0\n",
    '1,5",2\n',
    ",,0\n",
]


@pytest.mark.parametrize("at_once", [1, 7, 40, 10_000])
def test_pieces_in_which_a_file_is_read_make_no_difference(at_once, tmp_path, monkeypatch):
    rng = np.random.default_rng(at_once)
    text = "a,note,b\n" + "".join(rng.choice(LINES, 200))
    monkeypatch.setattr("flywheel.data.recordings.tables.table.CHARACTERS_AT_ONCE", at_once)
    table = read(text, tmp_path, "a", "b", most=500)
    reader, values, lines = csv.reader(io.StringIO(text, newline="")), [], []
    for row in reader:
        if any(map(str.strip, row)) and row[0] != "a":
            values.append([float(row[i] or "nan") for i in (0, 2)])
            lines.append(reader.line_num)
    np.testing.assert_array_equal(table.values, values)
    assert table.lines.tolist() == lines


def test_only_the_columns_that_are_wanted_have_to_be_numbers(tmp_path: Path) -> None:
    table = read("a,note,b\n1,fine,2\n3,caf\xe9,4\n".encode("latin-1"), tmp_path, "b", "a")
    assert table.columns(["a", "b"]).tolist() == [[1, 2], [3, 4]]


REFUSED = [
    (",,,,\n,,,\n", "is empty: it has neither a header nor rows"),
    ('""\n', "is empty"),
    (";;;", "is empty"),
    ("\n" * 2000, "is empty"),
    ("a,b\n1,2\n1,x\n", "line 3, column 'b': 'x' is not a number"),
    ("a,b\n1,2\n1\n", "line 3 has 1 cells, the header has 2 columns"),
    ("a,b\n1,2\n1,2,\n", "line 3 has 3 cells, the header has 2 columns"),
    ("a,b\n1,2\n" + "x" * 5000 + ",1\n", r"column 'a': 'x+\.\.\.x+' is not a number"),
    ('a,b\n1,2\n"1,2\n' + "3,4\n" * 40_000, "line .*: field larger .* a quotation mark not closed"),
    (b"a,b\n1,2\n\xe9,2\n", "line 3, column 'a': '.udce9' is not a number.*not in UTF-8"),
    (b"a,\xe9\n1,2\n", "the name of column 2 is '.udce9'.*not in UTF-8"),
    ("a,\x1b[31m\n1,2\n", r"the name of column 2 is '\\x1b\[31m'; .* no control characters"),
    ("a," + "b" * 201 + "\n1,2\n", "a name has at most 200 characters"),
    (",".join(f"c{i}" for i in range(10_001)), "has 10,001 columns; at most 10,000"),
    ("a,b\n1,2\n" + "1," * LONGEST_LINE, "line 3 has more than 1,000,000 characters"),
    ("a,b\n" + "1,2\n" * 100, "has more than 100 lines"),
    ("a,b\n1,2\n" + "\n" * 200, "has more than 100 lines"),
    ("a,b\n1,2\n3,4\n".encode("utf-16"), "not text in UTF-8"),
    ("a,b\n1,2\n3,4\n".encode("utf-16-be"), "not text in UTF-8"),
    (gzip.compress(b"a,b\n1,2\n3,4\n"), "is compressed"),
    (b"PK\x03\x04", "a spreadsheet"),
]


@pytest.mark.parametrize(("content", "message"), REFUSED, ids=range(len(REFUSED)))
def test_what_is_no_table_is_refused(content: str | bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=message) as raised:
        read(content, tmp_path)
    assert "log.csv" in str(raised.value) and len(str(raised.value)) < 500


def test_a_file_that_changes_while_it_is_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("a,b\n1,2\n3,4\n")
    with open_table(path) as sheet:
        with path.open("a") as file:
            file.write("5,6\n")
        with pytest.raises(DataError, match="changed while it was read"):
            sheet.read(["a"], 100)


def test_how_much_is_read_is_told(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("a,b\n" + "1,2\n" * 400_000)
    told: list[tuple[int, int]] = []
    with open_table(tmp_path / "log.csv", lambda read, of: told.append((read, of))) as sheet:
        sheet.read(["b"], 500_000)
    size = 4 * 400_001
    assert len(told) >= 3 and told[-1] == (size, size)
    assert told == sorted(told)


def nothing(path: Path) -> None:
    """No file at all."""


REFUSED_FILES: list[tuple[Callable[[Path], object], str]] = [
    (nothing, "There is no"),
    (os.mkfifo, "is a pipe"),
    (os.mkdir, "is a folder"),
    (lambda path: path.symlink_to("/dev/zero"), "is a device"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED_FILES)
def test_what_is_no_regular_file_is_refused_at_once(make, message, sheet, tmp_path):
    from flywheel.data.recordings import read_map

    robot = sheet().robot
    make(tmp_path / "a")
    with pytest.raises(DataError, match=f"{message}.*recording|recording .*{message}"):
        read_recording(tmp_path / "a", robot)
    with pytest.raises(ConfigError, match=f"{message}.*map|map .*{message}"):
        read_map(tmp_path / "a")


def test_a_file_without_a_name_is_refused(sheet: Callable[..., Sheet]) -> None:
    with pytest.raises(DataError, match="is a folder"):
        read_recording("", sheet().robot)


def test_a_column_of_text_is_no_harm_where_the_map_ignores_it(sheet: Callable[..., Sheet]) -> None:
    log = sheet()
    log.header.insert(3, "note")
    for row in log.rows:
        row.insert(3, 'windy, "very"')
    path = log.save()
    with pytest.raises(DataError, match="1 column that the robot prism3 does not have: note"):
        read_recording(path, log.robot)
    read = read_recording(path, log.robot, how=RecordingMap(ignore=("note",)))
    np.testing.assert_array_equal(read.episodes[0].trajectory.controls, log.made.controls)


MEASURED = """
import resource, sys
from flywheel.data.recordings import read_recording
from flywheel.robots import load_robot
read = read_recording(sys.argv[1], load_robot("prism3"))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
def test_a_log_takes_the_memory_of_its_numbers_a_few_times_and_not_of_its_text(sheet, tmp_path):
    log = sheet()
    rest = [row[1:] for row in log.rows[:-1]]
    there_and_back = [*rest, *rest[::-1]]
    sizes, peaks = [], []
    for count in (10_000, 60_000):
        path = tmp_path / f"{count}.csv"
        with path.open("w") as file:
            file.write(",".join(log.header) + "\n")
            for t in range(count):
                row = there_and_back[t % len(there_and_back)]
                file.write(f"{t / 100:.2f},{','.join(row)}\n")
        done = subprocess.run(
            [sys.executable, "-c", MEASURED, path], capture_output=True, text=True, check=True
        )
        sizes.append(path.stat().st_size)
        peaks.append(1024 * int(done.stdout))
    assert peaks[1] - peaks[0] < 2 * (sizes[1] - sizes[0])
