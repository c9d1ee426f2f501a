"""The trajectory store: immutable segments of episodes, frozen into snapshots.

    <store>/segments/<name>/receipt.json          what it holds, with the sha256 of every file
    <store>/segments/<name>/<sha256>.zarr/...     the arrays
    <store>/segments/<name>/timing.json           wall-clock numbers, under no digest
    <store>/snapshots/<name>.json                 frozen lists of segments, under a digest
    <store>/quarantine, <store>/tmp               damaged segments; unfinished ones

A segment appears as a whole or not at all, whenever its writer dies. What was acknowledged is on
the disk. Nothing stored is ever changed or deleted.
"""

from __future__ import annotations

import errno
import hashlib
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from flywheel.data.catalogue import (
    Damage,
    EpisodeSummary,
    Receipt,
    Snapshot,
    manifest,
    seal_text,
    snapshot_of,
    unseal_text,
)
from flywheel.data.packing import pack, unpack
from flywheel.data.places import RECEIPT, LocalPlace, ObjectPlace
from flywheel.data.zarr_files import read_group, write_group
from flywheel.errors import DataError, RunError
from flywheel.records import Episode

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")
_TIMING = "timing.json"


class TrajectoryStore:
    """Episodes on disk. Many processes may write at once.

    Args:
      url: a local folder, or s3://bucket/prefix.
    """

    def __init__(self, url: str | Path) -> None:
        self.url = str(url)
        if self.url.startswith("s3://"):
            tag = hashlib.sha256(self.url.encode()).hexdigest()[:12]
            mirror = Path(gettempdir()) / f"flywheel-{tag}"
            self._place: LocalPlace | ObjectPlace = ObjectPlace(self.url, mirror)
        else:
            self._place = LocalPlace(Path(self.url.removeprefix("file://")))
        self._receipts: dict[str, Receipt] = {}

    def commit(self, segment: str, episodes: Sequence[Episode]) -> Receipt:
        """Store episodes as one new segment, durably.

        Committing the same content under the same name again changes nothing.

        Raises:
          DataError: an episode must not be stored, or the segment exists with other content.
          RunError: the disk is full. Nothing committed is touched.
        """
        _check_name(segment, "segment")
        for episode in episodes:
            _check_name(episode.id, "episode")
        arrays, attributes = pack(episodes)
        try:
            receipt = self._commit(segment, episodes, arrays, attributes)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            raise RunError(
                f"The disk under {self.url} is full: segment {segment} was not stored. What was "
                "committed before is safe; free some space and resume."
            ) from error
        self._receipts[segment] = receipt
        return receipt

    def committed(self) -> dict[str, Receipt]:
        """All committed segments by name. Unreadable receipts are left to `verify`."""
        for name in self._place.names("segments"):
            if name not in self._receipts:
                try:
                    self._receipts[name] = self._receipt(name)
                except DataError:
                    continue
        return dict(self._receipts)

    def episodes(self, segment: str) -> tuple[EpisodeSummary, ...]:
        """What a segment holds."""
        return self._known(segment).summaries

    def read(self, episode: str) -> Episode:
        """Read an episode by its id.

        Raises:
          DataError: there is none, or it is not as it was committed; it is named.
        """
        guess = self._receipts.get(episode)  # an episode alone in its segment is named like it
        holders = (guess,) if guess else self.committed().values()
        for receipt in holders:
            for found in self.read_segment(receipt.segment) if episode in receipt.episodes else ():
                if found.id == episode:
                    return found
        raise DataError(f"There is no episode {episode!r} in {self.url}.")

    def read_segment(self, segment: str) -> list[Episode]:
        """Read all episodes of a segment, checked against its receipt.

        Raises:
          DataError: it is not as it was committed; its episodes are named.
        """
        receipt = self._known(segment)
        folder = self._place.local(f"segments/{segment}")
        if wrong := _differences(receipt, folder):
            raise DataError(str(Damage(segment, receipt.episodes, "; ".join(wrong))))
        arrays, attributes = read_group(folder / _arrays_name(receipt.sha256))
        timing = _timing(folder / _TIMING)
        return [_with_timing(e, timing.get(e.id, {})) for e in unpack(arrays, attributes)]

    def seal(
        self,
        name: str,
        segments: Sequence[str],
        parent: str | None = None,
        datasets: Sequence[str] = (),
    ) -> Snapshot:
        """Freeze a list of segments under a digest.

        Args:
          name: of the new snapshot.
          segments: their names, in order.
          parent: name of the snapshot it grows from; its data sets keep their one-hot places.
          datasets: names whose one-hot places follow the parent's, in this order.

        Raises:
          DataError: a segment is missing or damaged, the episodes do not belong together, or the
            name is taken by other content.
        """
        _check_name(name, "snapshot")
        receipts = [self._known(segment) for segment in segments]
        if damages := [d for r in receipts for d in self._damages(r.segment)]:
            raise DataError(
                "A snapshot is made of sound segments only. " + " ".join(map(str, damages))
            )
        before = self.snapshot(parent) if parent else None
        text, digest = seal_text(manifest(receipts, before, datasets))
        if not self._place.put_new(f"snapshots/{name}.json", text):
            there = self.snapshot(name)
            if there.digest != digest:
                raise DataError(
                    f"Snapshot {name} is sealed with digest {there.digest[:12]}; it cannot be "
                    f"sealed again with {digest[:12]}."
                )
        return self.snapshot(name)

    def snapshot(self, name: str) -> Snapshot:
        """Read a snapshot.

        Raises:
          DataError: there is none, or its manifest was altered.
        """
        try:
            text = self._place.read(f"snapshots/{name}.json")
        except FileNotFoundError:
            known = ", ".join(self.snapshots()) or "none"
            raise DataError(
                f"There is no snapshot {name!r} in {self.url}. Sealed: {known}."
            ) from None
        return snapshot_of(name, *unseal_text(text, f"The manifest of snapshot {name}"))

    def snapshots(self) -> list[str]:
        """Names of the sealed snapshots."""
        return [
            n.removesuffix(".json")
            for n in self._place.names("snapshots")
            if n.endswith(".json") and not n.startswith(".")
        ]

    def verify(self, snapshot: Snapshot | None = None) -> tuple[Damage, ...]:
        """Hash every file again and name what is not as it was committed.

        Args:
          snapshot: only its segments; all of the store by default.
        """
        found: list[Damage] = []
        segments = self._place.names("segments") if snapshot is None else snapshot.segments
        named = (
            {s: tuple(e.id for e in snapshot.episodes if e.segment == s) for s in segments}
            if (snapshot)
            else {}
        )
        for segment in segments:
            found += self._damages(segment, named.get(segment, ()))
        for name in self.snapshots() if snapshot is None else ():
            try:
                self.snapshot(name)
            except DataError as error:
                found.append(Damage(f"snapshot {name}", (), str(error)))
        return tuple(found)

    def quarantine(self, segment: str) -> None:
        """Set a damaged segment aside, so that it can be collected again. Nothing is deleted."""
        self._place.move(f"segments/{segment}", f"quarantine/{segment}.{len(self.quarantined())}")
        self._receipts.pop(segment, None)

    def quarantined(self) -> list[str]:
        """Names under which segments were set aside."""
        return self._place.names("quarantine")

    def sweep(self) -> int:
        """Remove what dead writers left unfinished; how many segments that was."""
        return self._place.sweep()

    def _commit(
        self,
        segment: str,
        episodes: Sequence[Episode],
        arrays: dict[str, Any],
        attributes: dict[str, Any],
    ) -> Receipt:
        work = self._place.workspace()
        try:
            write_group(work / "new.zarr", arrays, attributes)
            _check_written(work / "new.zarr", arrays)
            files = _hashes(work / "new.zarr")
            digest = _digest(files)
            (work / "new.zarr").rename(work / _arrays_name(digest))
            receipt = Receipt(
                segment, digest, files, tuple(EpisodeSummary.of(e, segment) for e in episodes)
            )
            (work / RECEIPT).write_bytes(receipt.to_json())
            timing = {
                e.id: {k: np.asarray(v).tolist() for k, v in e.timing.items()} for e in episodes
            }
            (work / _TIMING).write_text(json.dumps(timing))
            if not self._place.publish(work, f"segments/{segment}"):
                there = self._receipt(segment)
                if there.sha256 != receipt.sha256:
                    raise DataError(
                        f"Segment {segment} is committed with sha256 {there.sha256[:12]}; other "
                        f"content, {digest[:12]}, cannot take its name."
                    )
        finally:
            shutil.rmtree(work, ignore_errors=True)
        return receipt

    def _receipt(self, segment: str) -> Receipt:
        try:
            text = self._place.read(f"segments/{segment}/{RECEIPT}")
        except (FileNotFoundError, NotADirectoryError):
            raise DataError(f"There is no segment {segment!r} in {self.url}.") from None
        return Receipt.from_json(text, segment)

    def _known(self, segment: str) -> Receipt:
        if segment not in self._receipts:
            self._receipts[segment] = self._receipt(segment)
        return self._receipts[segment]

    def _damages(self, segment: str, episodes: tuple[str, ...] = ()) -> list[Damage]:
        try:
            receipt = self._receipt(segment)
        except DataError as error:
            remembered = self._receipts.get(segment)
            names = episodes or (remembered.episodes if remembered else ())
            return [Damage(segment, names, str(error))]
        wrong = _differences(receipt, self._place.local(f"segments/{segment}"))
        return [Damage(segment, receipt.episodes, what) for what in wrong]


def _differences(receipt: Receipt, folder: Path) -> list[str]:
    """What of a segment's files is not as the receipt says."""
    found = _hashes(folder / _arrays_name(receipt.sha256))
    wrong = [f"{name} is missing" for name in receipt.files if name not in found]
    wrong += [
        f"{name} was altered" for name, sha in receipt.files.items() if found.get(name, sha) != sha
    ]
    return wrong + [f"{name} does not belong there" for name in found if name not in receipt.files]


def _hashes(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _digest(files: dict[str, str]) -> str:
    return hashlib.sha256(json.dumps(files, sort_keys=True).encode()).hexdigest()


def _arrays_name(digest: str) -> str:
    return f"{digest[:16]}.zarr"


def _check_written(folder: Path, arrays: dict[str, Any]) -> None:
    """Read back what was written; a bad disk or codec is found before anything is acknowledged."""
    back, _ = read_group(folder)
    for name, values in arrays.items():
        if not np.array_equal(back[name], values, equal_nan=values.dtype.kind == "f"):
            raise DataError(f"Array {name} reads back differently from what was written.")


def _timing(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text()) if path.exists() else {}


def _with_timing(episode: Episode, timing: dict[str, Any]) -> Episode:
    for name, values in timing.items():
        episode.timing[name] = np.asarray(values, float)
    return episode


def _check_name(name: str, kind: str) -> None:
    if not _NAME.fullmatch(name):
        raise DataError(
            f"A {kind}'s name is made of a-z, 0-9, '.', '_' and '-' and starts with a letter or "
            f"digit; got {name!r}."
        )
