"""Opening a file of any format: told, read, and known again by its digest."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from flywheel.data.recordings.formats.detection import FORMATS, TABLE, format_of
from flywheel.data.recordings.formats.stream import Stream
from flywheel.errors import DataError
from flywheel.files import opened
from flywheel.outputs import printable

AT_ONCE = 1 << 20  # bytes
MOST_FILES = 10_000  # of a log that is a folder


@dataclass(frozen=True)
class LogFile:
    """A file of a log.

    Attributes:
      name: of the file, for messages.
      title: of its format.
      digest: sha256 of its bytes; of a folder, of its files' names and bytes.
      streams: its columns.
      notes: sentences about what was left out.
    """

    name: str
    title: str
    digest: str
    streams: tuple[Stream, ...]
    notes: tuple[str, ...]

    @property
    def columns(self) -> list[str]:
        """Names of all columns of numbers."""
        return [name for stream in self.streams for name in stream.columns]


def open_log(path: Path, kind: str | None = None, names: tuple[str, ...] = ()) -> LogFile:
    """Read a file.

    Args:
      path: of a file, or of a folder that is a ROS 2 bag or a LeRobot data set.
      kind: its format, a key of `FORMATS` or "table"; told by its content if missing.
      names: of the columns of a table without a header.

    Raises:
      DataError: it cannot be read, or is of no format that is; the message says why.
      ConfigError: its format needs a package that is not installed.
    """
    name = printable(path.name)
    found = format_of(path) if kind is None else {**FORMATS, "table": TABLE}[kind]
    digest = _digest(path)
    try:
        contents = found.read(path, names)
    except DataError as error:
        raise DataError(f"{name} ({found.title}): {error}") from None
    except MemoryError:
        raise DataError(f"{name} ({found.title}): there is not enough memory to read it.") from None
    if _digest(path) != digest:
        raise DataError(f"{name} changed while it was read. Is it still being written?")
    return LogFile(name, found.title, digest, contents.streams, contents.notes)


def _digest(path: Path) -> str:
    whole = path.is_dir()
    files = sorted(each for each in path.rglob("*") if each.is_file()) if whole else [path]
    if len(files) > MOST_FILES:
        raise DataError(f"{printable(path.name)} has more than {MOST_FILES:,} files.")
    sha256 = hashlib.sha256()
    for each in files:
        if whole:
            sha256.update(each.relative_to(path).as_posix().encode() + b"\0")
        with opened(each, "recording", DataError, None) as file:
            while block := file.read(AT_ONCE):
                sha256.update(block)
    return sha256.hexdigest()
