"""A store's files under a prefix of an S3-compatible service.

There are no renames there, and a listing may show unfinished files: a segment exists when its
receipt does. The receipt is written last, with `If-None-Match: *`, so that one of two writers wins.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from flywheel.data.segments import ABANDONED_SECONDS, RECEIPT
from flywheel.errors import DataError

if TYPE_CHECKING:
    from flywheel.data.zarr_files import Files


class S3Place:
    """A prefix on an S3-compatible service.

    Args:
      url: s3://bucket/prefix. Address and keys come from the usual AWS_* variables
        (AWS_ENDPOINT_URL for another service).
      options: for `s3fs.S3FileSystem` instead, e.g. {"endpoint_url": "http://127.0.0.1:9000"}.

    Raises:
      DataError: the bucket cannot be reached.
    """

    def __init__(self, url: str, options: dict[str, Any]) -> None:
        try:
            import s3fs  # an optional dependency
        except ImportError as error:
            raise DataError(
                f"A store at {url} needs the extra 's3': pip install 'flywheel[s3]'."
            ) from error
        self._files: Any = s3fs.S3FileSystem(use_listings_cache=False, **options)
        self._root = url.removeprefix("s3://").rstrip("/")
        bucket = self._root.partition("/")[0]
        try:
            self._files.call_s3("head_bucket", Bucket=bucket)
        except Exception as error:  # the client raises many kinds
            raise DataError(
                f"Bucket {bucket!r} of store {url} cannot be reached: {error}. It must exist; the "
                "service's address is AWS_ENDPOINT_URL (none: Amazon's), its keys are "
                "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY."
            ) from error

    def read(self, name: str) -> bytes:
        return bytes(self._files.cat_file(f"{self._root}/{name}"))

    def sizes(self, folder: str) -> dict[str, int]:
        prefix = f"{self._root}/{folder}/"
        found: dict[str, dict[str, Any]] = self._files.find(prefix, detail=True)
        return {name.removeprefix(prefix): about["size"] for name, about in sorted(found.items())}

    def read_all(self, folder: str, sizes: Mapping[str, int]) -> Files:
        prefix = f"{self._root}/{folder}/"
        names = [prefix + path for path in sizes]
        found: dict[str, bytes] = self._files.cat(names, on_error="omit") if names else {}
        return {name.removeprefix(prefix): found[name] for name in sorted(found)}

    def names(self, folder: str) -> list[str]:
        try:
            found: list[str] = self._files.ls(f"{self._root}/{folder}", detail=False)
        except FileNotFoundError:
            return []
        return sorted(name.rstrip("/").rpartition("/")[2] for name in found)

    def segments(self) -> list[str]:
        end = f"/{RECEIPT}"
        found = self._files.find(f"{self._root}/segments/")
        return sorted(n.removesuffix(end).rpartition("/")[2] for n in found if n.endswith(end))

    def put_new(self, name: str, text: bytes) -> bool:
        bucket, _, key = f"{self._root}/{name}".partition("/")
        try:
            self._files.call_s3("put_object", Bucket=bucket, Key=key, Body=text, IfNoneMatch="*")
        except OSError as error:
            if _exists_already(error):
                return False
            raise
        return True

    def publish(self, files: Files, folder: str) -> bool:
        arrays = {f"{self._root}/{folder}/{n}": c for n, c in files.items() if n != RECEIPT}
        self._files.pipe(arrays)
        return self.put_new(f"{folder}/{RECEIPT}", files[RECEIPT])

    def move(self, name: str, to: str) -> None:
        source = f"{self._root}/{name}"
        found = self._files.find(source)
        names = [each for each in found if each == source or each.startswith(f"{source}/")]
        if not names:
            raise FileNotFoundError(source)
        for each in names:
            self._files.cp_file(each, f"{self._root}/{to}{each.removeprefix(source)}")
        receipts = [each for each in names if each == f"{source}/{RECEIPT}"]
        for each in receipts + [
            n for n in names if n not in receipts
        ]:  # without its receipt the segment is gone
            self._files.rm_file(each)

    def sweep(self) -> int:
        found: dict[str, dict[str, Any]] = self._files.find(f"{self._root}/segments/", detail=True)
        there = set(self.segments())
        folders: dict[str, list[str]] = {}
        for name in found:
            segment = name.removeprefix(f"{self._root}/segments/").partition("/")[0]
            if segment not in there:
                folders.setdefault(segment, []).append(name)
        before = time.time() - ABANDONED_SECONDS
        gone = [
            names
            for names in folders.values()
            if max(found[name]["LastModified"].timestamp() for name in names) < before
        ]
        for names in gone:
            self._files.rm(names)
        return len(gone)


def _exists_already(error: OSError) -> bool:
    """True if a service refused because the key exists (412), or is being written (409)."""
    response = getattr(error.__cause__, "response", {})
    code = response.get("Error", {}).get("Code", "")
    return isinstance(error, FileExistsError) or code in ("PreconditionFailed", "412")
