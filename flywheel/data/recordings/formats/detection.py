"""The format of a log, told by its content; the only place that knows all formats."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import cast

from flywheel.data.recordings.formats.apart import read_apart
from flywheel.data.recordings.formats.stream import Contents, Reader
from flywheel.errors import DataError
from flywheel.files import opened
from flywheel.outputs import printable

BEGIN = 8192  # bytes that tell a format
NEXUS = rb"(Trajectories|Devices|Model Outputs|Joints|Segments|Events)[,\t\r\n]+ *[\d.]+"
# The beginnings of exports with other separators than their programs write.
ANEW = rb'"?(Format Version"?[;\t]|(NO_OF_FRAMES|PathFileType)[;]|NO_OF_FRAMES,|(Trajectories|Devices);)'
ZIP = b"PK\x03\x04"
USER_BLOCKS = (0, 512, 1024, 2048, 4096)  # bytes before the content of an HDF5 file
HDF5 = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
      title: its name for people.
      module: of its reader, in this package.
      tells: True for the first bytes of such a file.
      apart: its library may end the process on a damaged file.
    """

    title: str
    module: str
    tells: Callable[[bytes], bool]
    apart: bool = False

    def read(self, path: Path, names: tuple[str, ...]) -> Contents:
        """The numbers of a file; see `Reader`."""
        if self.apart:
            return read_apart(self.module, path)
        # Some readers need much.
        reader = cast("Reader", import_module(f"flywheel.data.recordings.formats.{self.module}"))
        return reader.read(path, names)


def _line(pattern: bytes) -> Callable[[bytes], bool]:
    """True where a pattern is at the beginning of a text."""
    return lambda begin: re.match(pattern, _plain(begin)) is not None


def _plain(begin: bytes) -> bytes:
    """The beginning of a text in UTF-8."""
    if begin[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return begin.decode("utf-16", "replace").encode()
    return begin.removeprefix(b"\xef\xbb\xbf").lstrip()


def _is_npz(begin: bytes) -> bool:
    """True for a ZIP whose first file is an array of NumPy."""
    length = int.from_bytes(begin[26:28], "little")
    return (
        begin.startswith(ZIP)
        and re.fullmatch(rb"[^/\\]*\.npy", begin[30 : 30 + length]) is not None
    )


def _starts(*magic: bytes) -> Callable[[bytes], bool]:
    return lambda begin: begin.startswith(magic)


FORMATS = {
    "motive": Format("Motive CSV", "motive", _line(rb'"?Format Version"?,')),
    "vicon": Format("Vicon CSV", "vicon", _line(NEXUS)),
    "qualisys": Format("Qualisys TSV", "qualisys", _line(rb"NO_OF_FRAMES\t")),
    "trc": Format("TRC", "trc", _line(rb"PathFileType[\t,]")),
    "c3d": Format("C3D", "c3d", lambda begin: begin[1:2] == b"\x50" and b"\0" in begin[:512], True),
    "mat73": Format("MAT 7.3", "hdf5", _starts(b"MATLAB 7.3 MAT-file"), True),
    "mat": Format("MAT", "mat", _starts(b"MATLAB 5.0 MAT-file"), True),
    "npz": Format("NPZ", "npz", lambda b: b.startswith(b"\x93NUMPY") or _is_npz(b)),
    "hdf5": Format("HDF5", "hdf5", lambda b: any(b[n : n + 8] == HDF5 for n in USER_BLOCKS), True),
    "parquet": Format("Parquet", "parquet", _starts(b"PAR1")),
    "bag": Format("ROS bag", "bags", _starts(b"#ROSBAG V2.0")),
    "db3": Format("ROS 2 bag", "bags", _starts(b"SQLite format 3\0")),
    "mcap": Format("MCAP", "mcap_files", _starts(b"\x89MCAP0\r\n")),
}  # fmt: skip
TABLE = Format("table", "table", lambda begin: True)

# What is refused, and why: first bytes, or a pattern in them.
REFUSED: tuple[tuple[Callable[[bytes], bool], str], ...] = (
    (
        lambda b: (
            re.match(
                rb"\x80[\x02-\x05]|\(?[cdl]p?(numpy|collections|__builtin__|copy_reg|builtins)", b
            )
            is not None
        ),
        "is a pickle, which runs code when it is read. Save the arrays as NPZ, CSV or HDF5.",
    ),
    (
        lambda b: b"!!python/" in b or b"tag:yaml.org,2002:python/" in b,
        "is YAML with Python tags, which run code when they are read. Write plain numbers, as CSV.",
    ),
    (
        lambda b: re.match(rb"(comment|info|rigidbody),|frame, *[\d.]", _plain(b)) is not None,
        "is an export of the old Tracking Tools, in which markers have no names. Export it with Motive.",
    ),
    (
        lambda b: re.match(rb'\{\s*"[^"]*"\s*:|\[\s*[\[{]', _plain(b)) is not None,
        "is JSON. Write its numbers as CSV, or keep them as NPZ, HDF5 or Parquet.",
    ),
    (
        lambda b: re.match(ANEW, _plain(b)) is not None,
        "is a tracker's export that was saved anew, perhaps by a spreadsheet, which may have changed its "
        "numbers. Give the export itself.",
    ),
    (lambda b: b.startswith(b"\x1f\x8b"), "is compressed (gzip). Unpack it."),
    (
        lambda b: b.startswith(ZIP) and not _is_npz(b),
        "is a ZIP archive or a spreadsheet. Unpack it, or save it as CSV.",
    ),
    (
        lambda b: b.startswith((b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")),
        "is compressed. Unpack it.",
    ),
)


def format_of(path: Path) -> Format:
    """The format of a file, or of a folder that is a ROS 2 bag or a LeRobot data set.

    Raises:
      DataError: it cannot be opened, is empty, or of a kind that is not read; the message says which.
    """
    if (path / "metadata.yaml").is_file():
        return FORMATS["db3"]
    if (path / "meta" / "info.json").is_file():
        return FORMATS["parquet"]
    with opened(path, "recording", DataError, None) as file:
        try:
            begin = file.read(BEGIN)
        except OSError as problem:
            raise DataError(f"{printable(path.name)} cannot be read: {problem.strerror}.") from None
    for tells, words in REFUSED:
        if tells(begin):
            raise DataError(f"{printable(path.name)} {words}")
    for found in FORMATS.values():
        if found.tells(begin):
            return found
    if b"\0" in begin and begin[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        titles = ", ".join(dict.fromkeys(each.title for each in FORMATS.values()))
        raise DataError(
            f"{printable(path.name)} is neither text nor of a format that is read: {titles}."
        )
    return TABLE
