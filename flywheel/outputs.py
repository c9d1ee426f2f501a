"""Output: files, each written completely or not at all, and text that is safe for a terminal.

The output paths of a command are tested before it computes: `check_output`, `check_folder`.
"""

from __future__ import annotations

import errno
import os
import stat
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from flywheel.errors import DataError, FlywheelError, RunError
from flywheel.faults import fault_of, short, told

PROBE_BYTES = 4096  # one block of a disk: an empty file can be made on a full one
UNFINISHED = ".flywheel-"  # begins the names of files that are being written
LONGEST_NAME = 255  # bytes of one part of a path, on every file system in use


def check_output(path: str | Path, what: str) -> None:
    """Check that a file can be written, without side effects. Missing folders will be made.

    Args:
      path: of the file.
      what: its kind, for the message: "page".

    Raises:
      DataError: it is a folder, or a file is in the place of a folder; the place is read-only; the name
        is too long.
      RunError: the disk is full.
    """
    _checked(_try_file, path, f"The {what} cannot be written", DataError)


def check_outputs(
    outputs: Mapping[str, str | Path | None], inputs: Iterable[str | Path] = ()
) -> None:
    """Check that all outputs of a command can be written without overwriting inputs.

    Args:
      outputs: kind of each file -> its path; None for one that is not requested.
      inputs: of the command; missing ones are ignored.

    Raises:
      DataError: see `check_output`; or two of them are one file, or one is an input.
    """
    taken = {Path(os.path.realpath(path)): "read" for path in inputs if Path(path).exists()}
    for what, path in outputs.items():
        if path is None:
            continue
        check_output(path, what)
        place = Path(os.path.realpath(path))
        if place.exists() and not place.is_file():
            continue  # a device or a pipe takes several
        if place in taken:
            use = taken[place]
            also = "is an input" if use == "read" else f"is the {use}, too"
            raise DataError(f"The {what} would overwrite {short(path)}, which {also}.")
        taken[place] = what


def check_new(path: Path) -> None:
    """Check that nothing is at a path that is not to be overwritten; raises a `DataError`."""
    if path.exists():
        raise DataError(f"The file {path} exists already; it is not overwritten.")


def check_folder(path: str | Path, what: str, error: type[FlywheelError] = DataError) -> None:
    """Check that a folder exists or can be made, and files in it; see `check_output`."""
    _checked(_try_folder, path, f"The {what} cannot be used", error)


def write_output(path: str | Path, content: str | bytes) -> Path:
    """Write a file in one atomic step; makes missing folders. A link or a device is written through.

    Args:
      path: of the file.
      content: bytes, or text that becomes UTF-8.
    """
    path = Path(path)
    data = content if isinstance(content, bytes) else content.encode("utf-8", "backslashreplace")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_symlink() or (path.exists() and not path.is_file()):
        path.write_bytes(data)
        return path
    # Of this thread alone: others of this process write into the same folder, as the tracker does.
    temporary = path.with_name(f"{UNFINISHED}{threading.get_native_id()}.tmp")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None
    return path


def remove_unfinished(folder: Path) -> None:
    """Remove the files in a folder that killed processes did not finish; no other may be writing there."""
    for path in folder.glob(f"{UNFINISHED}*.tmp"):
        path.unlink(missing_ok=True)


def printable(text: str) -> str:
    """Text for a terminal: control and invalid characters are escaped."""
    return "".join(c if c.isprintable() or c in "\n\t" else _written_out(c) for c in text)


def _written_out(character: str) -> str:
    return character.encode("unicode_escape").decode()


def _checked(
    attempt: Callable[[Path], None], path: str | Path, words: str, error: type[FlywheelError]
) -> None:
    try:
        attempt(Path(path))
    except OSError as problem:
        fault = fault_of(problem)
        kind = error if fault is None or fault.by_input else RunError
        raise kind(f"{words}: {told(problem)}") from None
    except ValueError as problem:  # a NUL in the path
        raise error(f"{words}: {short(path)!r}: {problem}.") from None


def _try_file(path: Path) -> None:
    about = _about(path)
    if about is None:
        _try_folder(path.parent)
    elif stat.S_ISDIR(about.st_mode):
        raise _refused(errno.EISDIR, path)
    elif stat.S_ISREG(about.st_mode):
        with path.open("ab"):
            pass
        _try_folder(path.parent)


def _try_folder(path: Path) -> None:
    about = _about(path)
    if about is None:
        _try_folder(path.parent)
    elif not stat.S_ISDIR(about.st_mode):
        raise _refused(errno.ENOTDIR, path)
    else:
        _probe(path)


def _about(path: Path) -> os.stat_result | None:
    """The type of the file; None if the name is free."""
    try:
        return path.stat()
    except FileNotFoundError:
        if len(os.fsencode(path.name)) > LONGEST_NAME:
            raise _refused(errno.ENAMETOOLONG, path) from None
        return None


def _probe(folder: Path) -> None:
    """Write a block into a file without a name."""
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(bytes(PROBE_BYTES))
    except FileNotFoundError:  # /proc is a folder, and takes no files
        raise _refused(errno.ENXIO, folder) from None
    except OSError as error:
        error.filename = str(folder)
        raise


def _refused(number: int, path: Path) -> OSError:
    return OSError(number, os.strerror(number), str(path))
