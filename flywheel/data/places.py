"""Places of a store's files: a local folder, or a prefix on an S3-compatible service.

A place contains files under relative names. A segment appears at once and complete: locally by a
rename, on S3 by its receipt, which is written last and only if there is none.
"""

from __future__ import annotations

import errno
import os
import shutil
import socket
import time
import uuid
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from flywheel.data.catalogue import LARGEST_LISTING
from flywheel.data.s3 import S3Place
from flywheel.data.segments import ABANDONED_SECONDS
from flywheel.errors import DataError, RunError
from flywheel.files import read_bytes

if TYPE_CHECKING:
    from flywheel.data.zarr_files import Files

SYNCS_AT_ONCE = 16


class Place(Protocol):
    """Location of files."""

    def read(self, name: str) -> bytes:
        """Contents of a text; FileNotFoundError if there is none.

        Raises:
          DataError: it cannot be read, is not a regular file, or is too large.
        """
        ...

    def sizes(self, folder: str) -> dict[str, int]:
        """Bytes of every file of a folder by its path in it; empty if there is no folder."""
        ...

    def read_all(self, folder: str, sizes: Mapping[str, int]) -> Files:
        """Contents of files of a folder.

        Args:
          folder: of the files.
          sizes: path in it -> bytes; no more are read.

        Raises:
          DataError: one of them cannot be read, or is larger by now.
        """
        ...

    def names(self, folder: str) -> list[str]:
        """Sorted names of the entries of a folder; none if there is no folder.

        Raises:
          DataError: it is not a folder, or cannot be read.
        """
        ...

    def segments(self) -> list[str]:
        """Sorted names of the segments that have appeared."""
        ...

    def put_new(self, name: str, text: bytes) -> bool:
        """Write a file durably unless it exists; True if it was written."""
        ...

    def publish(self, files: Files, folder: str) -> bool:
        """Make files appear as `folder`, durably; False if it exists already."""
        ...

    def move(self, name: str, to: str) -> None:
        """Move a folder or a file within the place; FileNotFoundError if there is none."""
        ...

    def sweep(self) -> int:
        """Remove unfinished folders of dead writers; returns their number."""
        ...


class LocalPlace:
    """A folder on a POSIX file system."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def read(self, name: str) -> bytes:
        path = self._root / name
        try:
            path.lstat()
        except NotADirectoryError:
            raise FileNotFoundError(path) from None
        except PermissionError:
            pass  # reading reports it
        return read_bytes(path, "file", DataError, LARGEST_LISTING)

    def sizes(self, folder: str) -> dict[str, int]:
        root = self._root / folder
        return dict(sorted(_sizes_below(root, root))) if root.is_dir() else {}

    def read_all(self, folder: str, sizes: Mapping[str, int]) -> Files:
        return {
            path: read_bytes(self._root / folder / path, "file", DataError, size)
            for path, size in sizes.items()
        }

    def names(self, folder: str) -> list[str]:
        path = self._root / folder
        try:
            return sorted(entry.name for entry in path.iterdir())
        except FileNotFoundError:
            return []
        except OSError as error:
            raise DataError(f"{path} is not a folder that can be read: {error.strerror}.") from None

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

    def move(self, name: str, to: str) -> None:
        source, target = self._root / name, self._root / to
        _make(target.parent)
        source.rename(target)
        _sync(target.parent)
        _sync(source.parent)

    def sweep(self) -> int:
        return sweep_workspaces(self._root)


def _sizes_below(root: Path, folder: Path) -> Iterator[tuple[str, int]]:
    """Path below the root and size of every entry except folders."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    yield from _sizes_below(root, Path(entry))
                else:
                    yield Path(entry).relative_to(root).as_posix(), entry.stat().st_size
    except OSError as error:  # a bad disk, a broken link, or quarantined at this moment
        where = error.filename or folder
        raise DataError(f"{where} cannot be read: {error.strerror}.") from None


def new_workspace(root: Path) -> Path:
    """An empty folder below `root`, to be filled and then renamed into place."""
    path = root / "tmp" / f"{socket.gethostname()}+{os.getpid()}+{uuid.uuid4().hex}"
    path.mkdir(parents=True)
    return path


def sweep_workspaces(root: Path) -> int:
    """Remove workspaces of dead processes; returns their number."""
    gone = [path for path in (root / "tmp").glob("*") if _abandoned(path)]
    for path in gone:
        shutil.rmtree(path, ignore_errors=True)
    return len(gone)


@contextmanager
def full_disk_told(what: str, where: object) -> Iterator[None]:
    """Turn "no space left" into a message that names the lost and the safe data."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise RunError(
            f"The disk under {where} is full: {what}. Committed data are safe; free some space "
            "and resume."
        ) from error


def local_folder(url: str) -> Path | None:
    """The folder of a URL; None if it is not on this machine's file systems."""
    scheme, found, rest = url.partition("://")
    if not found:
        return Path(url)
    return Path(rest) if scheme == "file" else None


def place_at(url: str, options: dict[str, object]) -> Place:
    """The place of a URL: s3://bucket/prefix, file:///folder, or a folder's path."""
    if (folder := local_folder(url)) is not None:
        return LocalPlace(folder)
    if url.startswith("s3://"):
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
            raise DataError(f"{name} differs when read back: a bad disk?")


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
