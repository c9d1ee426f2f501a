"""Where a store's files live: a local folder, or a prefix on an S3-compatible service.

A place holds files under relative names. A segment appears at once and whole: locally by a rename,
on S3 by its receipt, which is written last and only if there is none.
"""

from __future__ import annotations

import errno
import os
import shutil
import socket
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from flywheel.data.zarr_files import Files
from flywheel.errors import DataError, RunError

SYNCS_AT_ONCE = 16
ABANDONED_SECONDS = 86400.0  # after which no writer on another machine is still at work


class Place(Protocol):
    """Where files are kept."""

    def read(self, name: str) -> bytes:
        """Contents of a file; FileNotFoundError if there is none."""
        ...

    def read_all(self, folder: str) -> Files:
        """Contents of all files of a folder by their path in it; empty if there is no folder.

        Raises:
          DataError: one of them cannot be read.
        """
        ...

    def names(self, folder: str) -> list[str]:
        """Sorted names of the entries of a folder."""
        ...

    def segments(self) -> list[str]:
        """Sorted names of the segments that have appeared."""
        ...

    def put_new(self, name: str, text: bytes) -> bool:
        """Write a file durably unless it exists; whether it was written."""
        ...

    def publish(self, files: Files, folder: str) -> bool:
        """Make files appear as `folder`, durably; False if it was there already."""
        ...

    def move(self, folder: str, to: str) -> None:
        """Move a folder within the place; FileNotFoundError if there is none."""
        ...

    def sweep(self) -> int:
        """Remove what writers that are gone have left unfinished; how many folders."""
        ...


class LocalPlace:
    """A folder on a POSIX file system."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def read(self, name: str) -> bytes:
        return (self._root / name).read_bytes()

    def read_all(self, folder: str) -> Files:
        root = self._root / folder
        try:
            return {
                path.relative_to(root).as_posix(): path.read_bytes()
                for path in sorted(root.rglob("*"))
                if not path.is_dir()
            }
        except OSError as error:  # a bad disk, or set aside at this moment
            raise DataError(f"{folder} cannot be read: {error}.") from error

    def names(self, folder: str) -> list[str]:
        path = self._root / folder
        return sorted(p.name for p in path.iterdir()) if path.is_dir() else []

    def segments(self) -> list[str]:
        return self.names("segments")

    def put_new(self, name: str, text: bytes) -> bool:
        target = self._root / name
        work = new_workspace(self._root)
        try:
            _write(work, {"new": text})
            _make(target.parent)
            os.link(work / "new", target)  # unlike a rename, fails where a file exists
        except FileExistsError:
            return False
        finally:
            shutil.rmtree(work, ignore_errors=True)
        _sync(target.parent)
        return True

    def publish(self, files: Files, folder: str) -> bool:
        target = self._root / folder
        work = new_workspace(self._root)
        try:
            _write(work, files)
            _make(target.parent)
            work.rename(target)  # fails where there is a folder that is not empty
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
            return False
        finally:
            shutil.rmtree(work, ignore_errors=True)
        _sync(target.parent)
        return True

    def move(self, folder: str, to: str) -> None:
        source, target = self._root / folder, self._root / to
        _make(target.parent)
        source.rename(target)
        _sync(target.parent)
        _sync(source.parent)

    def sweep(self) -> int:
        return sweep_workspaces(self._root)


def new_workspace(root: Path) -> Path:
    """An empty folder below `root`, to prepare what is then renamed into place."""
    path = root / "tmp" / f"{socket.gethostname()}+{os.getpid()}+{uuid.uuid4().hex}"
    path.mkdir(parents=True)
    return path


def sweep_workspaces(root: Path) -> int:
    """Remove workspaces whose makers are gone; how many."""
    gone = [path for path in (root / "tmp").glob("*") if _abandoned(path)]
    for path in gone:
        shutil.rmtree(path, ignore_errors=True)
    return len(gone)


@contextmanager
def full_disk_told(what: str, where: object) -> Iterator[None]:
    """Turn "no space left" into a message that says what was not written and what is safe."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise RunError(
            f"The disk under {where} is full: {what}. What was committed before is safe; free some "
            "space and resume."
        ) from error


def local_folder(url: str) -> Path | None:
    """The folder of a URL; None where it is not on this machine's file systems."""
    scheme, found, rest = url.partition("://")
    if not found:
        return Path(url)
    return Path(rest) if scheme == "file" else None


def place_at(url: str, options: dict[str, object]) -> Place:
    """The place of a URL: s3://bucket/prefix, file:///folder, or a folder's path."""
    if (folder := local_folder(url)) is not None:
        return LocalPlace(folder)
    if url.startswith("s3://"):
        from flywheel.data.s3 import S3Place  # an optional dependency

        return S3Place(url, options)
    raise DataError(f"A store is at a folder or at s3://bucket/prefix, got {url!r}.")


def _write(folder: Path, files: Files) -> None:
    """Write files into a folder, flush all to the disk, and read them back."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    # Side by side, the file system flushes them together: ten times faster than one by one.
    with ThreadPoolExecutor(SYNCS_AT_ONCE) as threads:
        list(threads.map(_sync, (folder, *folder.rglob("*"))))
    for name, content in files.items():
        if (folder / name).read_bytes() != content:
            raise DataError(f"{name} reads back as something else than was written: a bad disk?")


def _make(folder: Path) -> None:
    """Make a folder and those above it, each durably."""
    if not folder.is_dir():
        _make(folder.parent)
        folder.mkdir(exist_ok=True)
        _sync(folder.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _abandoned(path: Path) -> bool:
    host, _, rest = path.name.partition("+")
    pid = rest.partition("+")[0]
    if host == socket.gethostname() and pid.isdigit() and not _alive(int(pid)):
        return True
    try:
        return time.time() - path.stat().st_mtime > ABANDONED_SECONDS
    except FileNotFoundError:
        return False


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
