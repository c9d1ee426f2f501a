"""One simulated motion on two clocks, written in each format and imported.

    python -m benchmarks.log_formats [--only WORD]
    python -m benchmarks.tables              makes the table of docs/results/log_formats.md

Points are of a tracker's file, commands of another one, whose clock has another offset and runs at another
rate. `flywheel recordings guess` drafts the map from both; a case has the answers that its draft still needs.
Most files are written by tests/unit/data/recordings/formats/writers.py. Writers whose package is missing
are left out: `pip install --no-deps c3d trc-data-reader hdf5storage fastparquet cramjam`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from typer.testing import CliRunner

from benchmarks.command import parser_of
from benchmarks.rows import RESULTS, rows_there, write_rows
from benchmarks.seconds import cpu_seconds
from flywheel.cli.main import app
from flywheel.data import TrajectoryStore
from flywheel.errors import DataError
from flywheel.records import Floats
from flywheel.robots import Robot
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.truth import Truth, made
from tests.unit.data.recordings.formats.writers import COMMANDED, EPOCH, MARKERS, RATE

LOG_FORMATS_CSV = RESULTS / "log_formats.csv"
SECONDS = 32.0  # of the motion
TRACKED = 2.0  # its time at the tracker's time 0 [s]
SEEN = 29.0  # by the tracker [s]
# Its time at the first row of commands; each is logged when it begins to act [s].
COMMANDS_FROM = 0.304
COMMANDS_RATE = 125.0  # [Hz]
# The tracker's time at the controller's time 0 [s]; its seconds per second of it.
OFFSET, PACE = -0.1876, 1.0003
GOALS = (2e-3, 1e-4, 0.1)  # [s], of the rate, [mm]
CLOCK = re.compile(r"its time 0 is (\S+) s of .*?, its second (\S+) s,")

Answers = dict[tuple[str | int, ...], object]  # places in a map -> what a user writes there
COMMANDS_CSV = partial(writers.table, parts=[COMMANDED])
TWO_CLOCKS: Answers = {("files", 1, "align"): "auto"}


@dataclass(frozen=True)
class LogFormat:
    """A format of logs.

    Attributes:
      title: of the format.
      by: the program or library that writes it.
      markers: writes the tracker's file, by motion, path and times.
      commands: writes the controller's; a CSV where the format has none.
      answers: that the draft needs.
      names: of the two files.
      zero: stamp of both clocks' time 0 [s].
      needs: package without which it is left out.
    """

    title: str
    by: str
    markers: Callable[[Truth, Path, Floats], Path]
    commands: Callable[[Truth, Path, Floats], Path] = COMMANDS_CSV
    answers: Answers = field(default_factory=lambda: TWO_CLOCKS)
    names: tuple[str, str] = ("take.dat", "motors.dat")
    zero: float = 0.0
    needs: str = "numpy"


OURS = "own writer"


def _trc(truth: Truth, path: Path, time: Floats) -> Path:
    """A TRC file by trc-data-reader, which takes the markers from a C3D file."""
    from trc import TRCData

    between = _c3d(truth, path.with_suffix(".c3d"), time)
    data = TRCData()
    data.import_from(str(between))
    data.save(str(path))
    between.unlink()
    return path


def _c3d(truth: Truth, path: Path, time: Floats) -> Path:
    """A C3D file by c3d; columns of a point are x, y, z, its residual and its cameras."""
    import c3d

    points = writers.seen(truth, time)
    seen = np.isfinite(points[..., :1])
    rest = [np.where(seen, 0.1, -1.0), np.zeros(seen.shape)]
    rows = np.concatenate([np.nan_to_num(1e3 * points), *rest], axis=2)
    writer = c3d.Writer(point_rate=RATE)
    writer.set_point_labels(writers.names(truth))
    writer.add_frames([(row, np.array([[]])) for row in rows])
    with path.open("wb") as file:
        writer.write(file)
    return path


def _mat73(truth: Truth, path: Path, time: Floats, parts: Sequence[str]) -> Path:
    """A MAT 7.3 file by hdf5storage."""
    import hdf5storage

    made = {"log": writers.arrays(truth, time, parts)}
    hdf5storage.savemat(str(path), made, appendmat=False, store_python_metadata=False)
    return path


def _fastparquet(truth: Truth, path: Path, time: Floats, parts: Sequence[str]) -> Path:
    """A Parquet file by fastparquet."""
    import fastparquet
    import pandas as pd

    fastparquet.write(str(path), pd.DataFrame(writers.flat(truth, time, parts)))
    return path


def _both(title: str, by: str, write: Callable[..., Path], **more: Any) -> LogFormat:
    """A format in which both files are."""
    return LogFormat(
        title, by, partial(write, parts=[MARKERS]), partial(write, parts=[COMMANDED]), **more
    )


FORMATS = (
    _both("CSV", "Python", writers.table),
    LogFormat("Motive CSV 1.1", OURS, partial(writers.motive, version="1.1")),
    LogFormat("Motive CSV 1.23", OURS, writers.motive),
    LogFormat("Motive CSV 1.25 (Motive 3)", OURS, partial(writers.motive, version="1.25")),
    LogFormat("Vicon Nexus CSV", OURS, partial(writers.vicon, parts=[MARKERS])),
    LogFormat("Qualisys TSV", OURS, writers.qualisys),
    LogFormat("TRC", OURS, writers.trc),
    LogFormat("TRC", "trc-data-reader", _trc, needs="trc"),
    LogFormat("C3D", "ezc3d", writers.c3d, needs="ezc3d"),
    LogFormat("C3D", "c3d", _c3d, needs="c3d"),
    _both("MAT 5", "SciPy", writers.mat),
    _both("MAT 7.3", "h5py", writers.mat73, needs="h5py"),
    _both("MAT 7.3", "hdf5storage", _mat73, needs="hdf5storage"),
    _both("NPZ", "NumPy", writers.npz, names=("take.npz", "motors.npz")),
    _both("HDF5", "h5py", writers.hdf5, needs="h5py"),
    _both("Parquet", "PyArrow", writers.parquet),
    _both("Parquet", "fastparquet", _fastparquet, needs="fastparquet"),
    LogFormat(
        "LeRobot 3",
        "PyArrow",
        partial(writers.lerobot, parts=[MARKERS]),
        answers=TWO_CLOCKS | {("files", 0, "where", "episode_index"): 1},
    ),
    _both(
        "ROS 1 bag",
        "rosbags",
        writers.bag1,
        names=("take.bag", "motors.bag"),
        needs="rosbags",
        zero=EPOCH,
    ),
    _both("ROS 2 bag, SQLite", "rosbags", writers.bag2, needs="rosbags", zero=EPOCH),
    _both(
        "ROS 2 bag, MCAP",
        "rosbags",
        partial(writers.bag2, storage="MCAP"),
        needs="rosbags",
        zero=EPOCH,
    ),
    _both("MCAP, JSON", "mcap", writers.mcap, needs="mcap", zero=EPOCH),
)


@dataclass(frozen=True)
class LogFormatRow:
    """A format, and what became of the motion in it.

    Attributes:
      format: its title.
      by: the program or library that wrote the files.
      answers: places of the drafted map that had to be written.
      offset: greatest error of a time of the controller by the tracker's clock [s].
      pace: error of the controller's rate.
      position: greatest error of a coordinate of a point [mm].
      kept: share of the samples that the tracker saw.
      seconds: of one core, for draft and import.
      problem: why there is no recording; "" if there is one.
    """

    format: str
    by: str
    answers: int
    offset: float
    pace: float
    position: float
    kept: float
    seconds: float
    problem: str

    @property
    def good(self) -> bool:
        """True if all is within the goals."""
        found = (self.offset, abs(self.pace), self.position)
        return not self.problem and all(f <= goal for f, goal in zip(found, GOALS, strict=True))


def measured(case: LogFormat, truth: Truth, folder: Path) -> LogFormatRow:
    """The motion in one format, imported."""
    own = np.arange(TRACKED, TRACKED + SEEN, 1 / RATE) - TRACKED
    told = (np.arange(COMMANDS_FROM, truth.seconds, 1 / COMMANDS_RATE) - TRACKED - OFFSET) / PACE
    take, motors = (folder / name for name in case.names)
    case.markers(truth.by(TRACKED), take, own)
    case.commands(truth.by(TRACKED + OFFSET, PACE), motors, told)
    before = cpu_seconds()
    try:
        said = _imported(case, truth.robot, folder)
    except DataError as error:
        none = dict.fromkeys(("offset", "pace", "position", "kept", "seconds"), np.nan)
        return LogFormatRow(case.title, case.by, len(case.answers), **none, problem=str(error))
    seconds = cpu_seconds() - before
    off, pace = _clock_errors(
        [f["words"] for f in said["findings"] if f["kind"] == "clock"], told, case.zero
    )
    store = TrajectoryStore(str(folder / "store"))
    episodes = [store.read(name).trajectory for name in said["episodes"]]
    position, kept = _compared(np.concatenate([e.observations.points for e in episodes]), truth)
    return LogFormatRow(
        case.title, case.by, len(case.answers), off, pace,
        1e3 * position, kept, seconds, "",
    )  # fmt: skip


def _clock_errors(words: Sequence[str], told: Floats, zero: float) -> tuple[float, float]:
    """Greatest error of the times (n,) of commands [s], and of the rate; NaN where no clock was found."""
    if not words or (found := CLOCK.search(words[0])) is None:
        return np.nan, np.nan
    offset, pace = map(float, found.groups())
    off = offset + pace * (zero + told) - (zero + OFFSET + PACE * told)
    return float(np.abs(off).max()), pace - PACE


def _compared(points: Floats, truth: Truth) -> tuple[float, float]:
    """Greatest error of points (N, P, 3) from the tracker's time 0 on [m], and the share of those seen."""
    own = np.arange(round(SEEN * RATE)) / RATE
    true = writers.seen(truth.by(TRACKED), own)
    if len(points) > len(true):
        raise DataError(f"{len(points)} rows were made of {len(true)}")
    off = np.abs(points - truth.by(TRACKED).points(own[: len(points)]))
    return float(np.nanmax(off)), np.isfinite(points).sum() / np.isfinite(true).sum()


def _imported(case: LogFormat, robot: Robot, folder: Path) -> dict[str, Any]:
    """The report of `flywheel recordings import` on a drafted map with its answers.

    Raises:
      DataError: a command refuses.
    """
    mjcf, drafted = folder / "robot.xml", folder / "map.yaml"
    mjcf.write_text(robot.xml, encoding="utf-8")
    files = [str(folder / name) for name in case.names]
    _run("recordings", "guess", *files, "--robot", str(mjcf), "-o", str(drafted))
    draft = yaml.safe_load(drafted.read_text(encoding="utf-8"))
    for place, value in case.answers.items():
        _answer(draft, place, value)
    drafted.write_text(yaml.safe_dump(draft), encoding="utf-8")
    where = ("--robot", str(mjcf), "--store", str(folder / "store"), "--json")
    (said,) = json.loads(_run("recordings", "import", "--map", str(drafted), *where))
    return dict(said)


def _answer(draft: Any, place: tuple[str | int, ...], value: object) -> None:
    """Write a value into a map."""
    *path, last = place
    for key in path:
        draft = draft.setdefault(key, {}) if isinstance(draft, dict) else draft[key]
    draft[last] = value


def _run(*arguments: str) -> str:
    """The output of a command.

    Raises:
      DataError: it refuses.
    """
    done = CliRunner().invoke(app, arguments)
    if done.exit_code:
        raise DataError(done.stderr.strip() or repr(done.exception))
    return done.stdout


def table(rows: Sequence[LogFormatRow]) -> list[str]:
    """Lines of Markdown: one for each format."""
    lines = [
        "| format | written by | answers | offset [ms] | rate | positions [mm] | kept | CPU [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [
            f"{1e3 * row.offset:.2f}", f"{row.pace:.1e}", f"{row.position:.4f}", f"{row.kept:.2%}",
            f"{row.seconds:.1f}",
        ]  # fmt: skip
        cells = [f"refused: {row.problem}", "", "", "", ""] if row.problem else cells
        lines.append(f"| {row.format} | {row.by} | {row.answers} | {' | '.join(cells)} |")
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure all formats; the exit code is 1 if one misses a goal."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument(
        "--only", default="", help="formats whose title has this; rows of others stay"
    )
    given = parser.parse_args(arguments)
    truth = made(SECONDS)
    rows = {(row.format, row.by): row for row in rows_there(LogFormatRow, LOG_FORMATS_CSV)}
    for case in FORMATS:
        if given.only in case.title and find_spec(case.needs):
            with TemporaryDirectory(prefix="flywheel-") as folder:
                rows[case.title, case.by] = row = measured(case, truth, Path(folder))
            print("\n".join(table([row])[2:]), flush=True)
    places = [(case.title, case.by) for case in FORMATS]
    found = [rows[place] for place in places if place in rows]
    write_rows(LOG_FORMATS_CSV, found)
    return int(not all(row.good for row in found))


if __name__ == "__main__":
    raise SystemExit(main())
