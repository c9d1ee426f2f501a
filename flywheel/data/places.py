"""Where a store's files live: a local folder, or a prefix on an S3-compatible service.

A place holds files under relative names. Segments are written as a whole folder and appear at once:
by a rename locally, by their receipt, written last and only if absent, on S3.
"""

from __future__ import annotations

import errno
import os
import shutil
import uuid
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

from flywheel.errors import DataError

RECEIPT = "receipt.json"


class Place(Protocol):
    """Where files are kept."""

    def read(self, name: str) -> bytes:
        """Contents of a file; FileNotFoundError if there is none."""
        ...

    def put_new(self, name: str, text: bytes) -> bool:
        """Write a file durably unless it exists; whether it was written."""
        ...

    def put(self, name: str, text: bytes) -> None:
        """Write a file durably, replacing what was there."""
        ...

    def names(self, folder: str) -> list[str]:
        """Sorted names of the entries of a folder."""
        ...

    def workspace(self) -> Path:
        """A new empty local folder to prepare a segment in."""
        ...

    def publish(self, prepared: Path, folder: str) -> bool:
        """Make a prepared local folder appear as `folder`; False if it was there already."""
        ...

    def local(self, folder: str) -> Path:
        """The folder's files on a local disk, as they are stored now."""
        ...

    def move(self, folder: str, to: str) -> None:
        """Move a folder within the place."""
        ...


class LocalPlace:
    """A folder on a POSIX file system."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def read(self, name: str) -> bytes:
        return (self._root / name).read_bytes()

    def put_new(self, name: str, text: bytes) -> bool:
        temporary = self._staged(name, text)
        try:
            os.link(temporary, self._root / name)  # unlike a rename, fails where a file exists
        except FileExistsError:
            return False
        finally:
            temporary.unlink()
        sync(self._root / Path(name).parent)
        return True

    def put(self, name: str, text: bytes) -> None:
        self._staged(name, text).replace(self._root / name)
        sync(self._root / Path(name).parent)

    def names(self, folder: str) -> list[str]:
        path = self._root / folder
        return sorted(p.name for p in path.iterdir()) if path.is_dir() else []

    def workspace(self) -> Path:
        path = self._root / "tmp" / f"{os.getpid()}.{uuid.uuid4().hex}"
        path.mkdir(parents=True)
        return path

    def publish(self, prepared: Path, folder: str) -> bool:
        for path in sorted(prepared.rglob("*"), reverse=True):
            sync(path)
        sync(prepared)
        target = self._root / folder
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            prepared.rename(target)
        except OSError as error:
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
            return False
        sync(target.parent)
        return True

    def local(self, folder: str) -> Path:
        return self._root / folder

    def move(self, folder: str, to: str) -> None:
        target = self._root / to
        target.parent.mkdir(parents=True, exist_ok=True)
        (self._root / folder).rename(target)

    def sweep(self) -> int:
        """Remove what writers that are gone have left unfinished; how many folders."""
        gone = [p for p in (self._root / "tmp").glob("*.*") if not _alive(p.name.split(".")[0])]
        for path in gone:
            shutil.rmtree(path, ignore_errors=True)
        return len(gone)

    def _staged(self, name: str, text: bytes) -> Path:
        target = self._root / name
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = target.with_name(f".{target.name}.{uuid.uuid4().hex}")
        temporary.write_bytes(text)
        sync(temporary)
        return temporary


class ObjectPlace:
    """A prefix on an S3-compatible service, with a local mirror to read arrays from.

    Args:
      url: s3://bucket/prefix. The service's address and keys come from the usual AWS_* variables
        (AWS_ENDPOINT_URL for one of your own).
      mirror: local folder for copies of segments.
    """

    def __init__(self, url: str, mirror: Path) -> None:
        try:
            import s3fs
        except ImportError as error:
            raise DataError(
                f"A store at {url} needs the extra 's3': pip install flywheel[s3]."
            ) from error
        self._files: Any = s3fs.S3FileSystem(use_listings_cache=False)
        self._root = url.removeprefix("s3://").rstrip("/")
        self._mirror = mirror

    def read(self, name: str) -> bytes:
        return bytes(self._files.cat_file(f"{self._root}/{name}"))

    def put_new(self, name: str, text: bytes) -> bool:
        bucket, key = f"{self._root}/{name}".split("/", 1)
        try:
            self._files.call_s3("put_object", Bucket=bucket, Key=key, Body=text, IfNoneMatch="*")
        except (FileExistsError, OSError) as error:
            if (
                isinstance(error, FileExistsError)
                or "PreconditionFailed" in str(error)
                or ("pre-condition" in str(error).lower())
            ):
                return False
            raise
        return True

    def put(self, name: str, text: bytes) -> None:
        self._files.pipe_file(f"{self._root}/{name}", text)

    def names(self, folder: str) -> list[str]:
        try:
            found: Iterable[str] = self._files.ls(f"{self._root}/{folder}", detail=False)
        except FileNotFoundError:
            return []
        return sorted(Path(p).name for p in found)

    def workspace(self) -> Path:
        path = self._mirror / "tmp" / f"{os.getpid()}.{uuid.uuid4().hex}"
        path.mkdir(parents=True)
        return path

    def publish(self, prepared: Path, folder: str) -> bool:
        for path in sorted(p for p in prepared.rglob("*") if p.is_file() and p.name != RECEIPT):
            self.put(f"{folder}/{path.relative_to(prepared).as_posix()}", path.read_bytes())
        return self.put_new(f"{folder}/{RECEIPT}", (prepared / RECEIPT).read_bytes())

    def local(self, folder: str) -> Path:
        target = self._mirror / folder
        shutil.rmtree(target, ignore_errors=True)
        prefix = f"{self._root}/{folder}/"
        for name in self._files.find(prefix.rstrip("/")):
            path = target / name.removeprefix(prefix)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(self._files.cat_file(name))
        return target

    def move(self, folder: str, to: str) -> None:
        for name in self._files.find(f"{self._root}/{folder}"):
            self._files.cp_file(name, name.replace(folder, to, 1))
            self._files.rm_file(name)

    def sweep(self) -> int:
        """Remove what is left unfinished in the mirror; how many folders."""
        return LocalPlace(self._mirror).sweep()


def sync(path: Path) -> None:
    """Flush a file or folder to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _alive(pid: str) -> bool:
    try:
        os.kill(int(pid), 0)
    except (ProcessLookupError, ValueError):
        return False
    except PermissionError:
        return True
    return True
