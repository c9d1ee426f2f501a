"""The trajectory store: immutable segments of episodes, frozen into snapshots.

    <store>/store.json                  who the store is
    <store>/segments/<name>/...         see `flywheel.data.segments`
    <store>/snapshots/<name>.json       frozen lists of segments, under a digest
    <store>/quarantine, <store>/tmp     what was set aside; what is unfinished

A segment appears completely or not at all, whenever its writer dies. Acknowledged data are on the
disk. Stored data are never changed or deleted.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from flywheel.data.catalogue import (
    Damage,
    EpisodeSummary,
    Receipt,
    Snapshot,
    check_name,
    is_name,
    manifest,
    replaced,
    snapshot_of,
)
from flywheel.data.identity import Ownership
from flywheel.data.places import full_disk_told, place_at
from flywheel.data.segments import (
    RECEIPT,
    Found,
    damages_of,
    ids_in,
    read_back,
    telemetry_damages,
    worth_reading,
    written,
)
from flywheel.data.verification import damages_in
from flywheel.errors import DataError
from flywheel.records import Episode
from flywheel.seals import Unsound


class TrajectoryStore:
    """Episodes on disk. Many processes may write at once.

    Args:
      url: a local folder, or s3://bucket/prefix.
      options: of the S3 client, e.g. {"endpoint_url": "http://127.0.0.1:9000"}; others come from
        the usual AWS_* variables.
    """

    def __init__(self, url: str | Path, options: Mapping[str, object] | None = None) -> None:
        self.url = str(url)
        self._place = place_at(self.url, dict(options or {}))
        self._ownership = Ownership(self._place, self.url, self._owners)
        self._receipts: dict[str, Receipt] = {}  # for finding episodes; reading reads them again

    def commit(self, segment: str, episodes: Sequence[Episode]) -> Receipt:
        """Store episodes as one new segment, durably.

        Committing the same content under the same name again changes nothing.

        Raises:
          DataError: an episode cannot be stored, or the segment exists with other content.
          RunError: the disk is full. Committed data are unchanged.
        """
        check_name(segment, "segment")
        for episode in episodes:
            check_name(episode.id, "episode")
        with full_disk_told(f"segment {segment} was not stored", self.url):
            new = written(segment, episodes, self._ownership.id)
            if not self._place.publish(new.files, f"segments/{segment}"):
                self._check_same(new.receipt)
        self._receipts[segment] = new.receipt
        return new.receipt

    def committed(self) -> dict[str, Receipt]:
        """All committed segments by name. Unreadable receipts are left to `verify`."""
        there = self._place.segments()
        for name in there:
            if name not in self._receipts:
                try:
                    self._receipts[name] = self._receipt(name)
                except DataError:
                    continue
        self._receipts = {name: self._receipts[name] for name in there if name in self._receipts}
        return dict(self._receipts)

    def unreadable(self) -> list[str]:
        """Segments whose receipt cannot be read."""
        return sorted(set(self._place.segments()) - self.committed().keys())

    def episodes(self, segment: str) -> tuple[EpisodeSummary, ...]:
        """Content of a segment."""
        return self._receipt(segment).summaries

    def read(self, episode: str) -> Episode:
        """Read an episode by its id.

        Raises:
          DataError: it is missing or damaged; the message names it.
        """
        found = self.read_segment(self._holder(episode).segment)
        return next(one for one in found if one.id == episode)

    def read_segment(self, segment: str, sha256: str | None = None) -> list[Episode]:
        """Read all episodes of a segment, checked against its receipt.

        Args:
          segment: its name.
          sha256: from a snapshot; by default that of its receipt.

        Raises:
          DataError: it was changed; the message names its episodes.
        """
        found = self._found(segment)
        if not found.sizes:
            raise self._no_segment(segment)
        if damages := self._damages(found, sha256):
            raise DataError(" ".join(map(str, damages)))
        return read_back(found)

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
          parent: name of the snapshot that it extends; its data sets keep their one-hot places.
          datasets: names whose one-hot places follow the parent's, in this order.

        Raises:
          DataError: a segment is missing or damaged, the episodes do not fit together, or the name
            is taken by other content.
          RunError: the disk is full.
        """
        check_name(name, "snapshot")
        before = self.snapshot(parent) if parent else None
        receipts = [self._receipt(segment) for segment in segments]
        if damages := [d for r in receipts for d in self._damages_since(r, before)]:
            raise DataError(
                "A snapshot consists of undamaged segments only. " + " ".join(map(str, damages))
            )
        with full_disk_told(f"snapshot {name} was not sealed", self.url):
            text, digest = manifest(name, self._ownership.id(), receipts, before, datasets)
            new = self._place.put_new(f"snapshots/{name}.json", text)
        sealed = self.snapshot(name)
        if not new and sealed.digest != digest:
            raise DataError(
                f"Snapshot {name} is sealed with digest {sealed.digest[:12]}; it cannot be sealed "
                f"again with {digest[:12]}."
            )
        return sealed

    def snapshot(self, name: str) -> Snapshot:
        """Read a snapshot.

        Raises:
          DataError: there is none, or its manifest was altered, or is another's.
        """
        try:
            text = self._place.read(f"snapshots/{check_name(name, 'snapshot')}.json")
        except FileNotFoundError:
            known = ", ".join(self.snapshots()) or "none"
            raise DataError(
                f"There is no snapshot {name!r} in {self.url}. Sealed: {known}."
            ) from None
        found = snapshot_of(name, text)
        self._ownership.check(found.owner, f"The manifest of snapshot {name}")
        return found

    def snapshots(self) -> list[str]:
        """Names of the sealed snapshots."""
        found = self._place.names("snapshots")
        return [name.removesuffix(".json") for name in found if name.endswith(".json")]

    def verify(self, snapshot: Snapshot | None = None, arrays: bool = True) -> tuple[Damage, ...]:
        """List all faults: altered, missing and foreign files.

        Args:
          snapshot: only it and its segments; all of the store by default.
          arrays: hash every file again; else only check names, seals and references.
        """
        if not arrays:
            with suppress(DataError):  # which is told
                self.committed()
        return tuple(damages_in(self, self._place, self._ownership, snapshot, arrays))

    def damages(
        self,
        segment: str,
        sha256: str | None = None,
        ids: tuple[str, ...] = (),
        arrays: bool = True,
    ) -> list[Damage]:
        """Faults of a segment.

        Args:
          segment: its name.
          sha256: from a snapshot, if one lists it.
          ids: of its episodes in that snapshot.
          arrays: check the arrays in addition to the receipt.
        """
        if not is_name(segment):
            return [Damage(segment, ids, "it is no segment, none has such a name", "foreign")]
        try:
            if not arrays:
                receipt = self._receipts.get(segment) or self._receipt(segment)
                return [] if sha256 in (None, receipt.sha256) else [replaced(receipt, str(sha256))]
            found = self._found(segment)
            if not found.sizes and sha256 is None:  # nobody misses it
                return [Damage(segment, (), "it is no segment, it holds nothing", "foreign")]
            return self._damages(found, sha256, ids) or telemetry_damages(found)
        except DataError as error:
            return [Damage.of(error, segment, ids)]

    def _damages(
        self, found: Found, sha256: str | None = None, ids: tuple[str, ...] = ()
    ) -> list[Damage]:
        try:
            self._ownership.check(found.receipt.owner, f"Segment {found.segment}")
            return damages_of(found, sha256)
        except Unsound as error:
            named = ids or tuple(i for text in found.files.values() for i in ids_in(text))
            return [Damage.of(error, found.segment, tuple(dict.fromkeys(named)))]

    def quarantine(self, segment: str) -> None:
        """Set a damaged segment aside, so that it can be collected again. Nothing is deleted.

        Raises:
          DataError: there is no such segment.
        """
        self._set_aside(f"segments/{segment}", segment, self._no_segment(segment))
        self._receipts.pop(segment, None)

    def quarantine_snapshot(self, name: str) -> None:
        """Set a snapshot aside, so that its name is free. Nothing is deleted.

        Raises:
          DataError: there is no such snapshot.
        """
        missing = DataError(f"There is no snapshot {name!r} in {self.url}.")
        self._set_aside(f"snapshots/{name}.json", f"snapshot-{name}.json", missing)

    def _set_aside(self, path: str, name: str, missing: DataError) -> None:
        try:
            self._place.move(path, f"quarantine/{name}.{uuid.uuid4().hex[:8]}")
        except FileNotFoundError:
            raise missing from None

    def quarantined(self) -> list[str]:
        """Names of the segments that were set aside."""
        return self._place.names("quarantine")

    def sweep(self) -> int:
        """Remove unfinished segments of dead writers; returns their number."""
        return self._place.sweep()

    def _check_same(self, receipt: Receipt) -> None:
        """The existing segment, if it is undamaged and has the content to be stored."""
        segment = receipt.segment
        if damages := self.damages(segment):
            raise DataError(
                "It is committed already, but was changed; set it aside first. "
                + " ".join(map(str, damages))
            )
        there = self._receipt(segment)
        if there.sha256 != receipt.sha256:
            raise DataError(
                f"Segment {segment} is committed with sha256 {there.sha256[:12]}; other content, "
                f"{receipt.sha256[:12]}, cannot take its name."
            )

    def _damages_since(self, receipt: Receipt, parent: Snapshot | None) -> list[Damage]:
        """Damages of a segment. One of the parent's was read then, and will be when it is used."""
        if parent is None or receipt.segment not in parent.segments:
            return self.damages(receipt.segment)
        before = parent.sha256[parent.segments.index(receipt.segment)]
        return [] if before == receipt.sha256 else [replaced(receipt, before)]

    def _found(self, segment: str) -> Found:
        folder = f"segments/{check_name(segment, 'segment')}"
        sizes = self._place.sizes(folder)
        text = self._place.read(f"{folder}/{RECEIPT}") if RECEIPT in sizes else b""
        files = self._place.read_all(folder, worth_reading(text, segment, sizes))
        return Found(segment, sizes, files | ({RECEIPT: text} if RECEIPT in sizes else {}))

    def _owners(self) -> Iterator[str]:
        """Store ids in all readable receipts and manifests."""
        for segment in self._place.segments():
            with suppress(DataError, FileNotFoundError):
                yield Receipt.from_json(
                    self._place.read(f"segments/{segment}/{RECEIPT}"), segment
                ).owner
        for name in self.snapshots():
            with suppress(DataError, FileNotFoundError):
                yield snapshot_of(name, self._place.read(f"snapshots/{name}.json")).owner

    def _holder(self, episode: str) -> Receipt:
        """Receipt of the segment of an episode."""
        # An episode alone in its segment is named like it: no need to look through all.
        likely = self._find_receipt(episode)
        if likely and episode in likely.episodes:
            return likely
        for receipt in self.committed().values():
            if episode in receipt.episodes:
                return receipt
        raise DataError(f"There is no episode {episode!r} in {self.url}.")

    def _receipt(self, segment: str) -> Receipt:
        if (found := self._find_receipt(segment)) is None:
            raise self._no_segment(segment)
        return found

    def _find_receipt(self, segment: str) -> Receipt | None:
        try:
            text = self._place.read(f"segments/{check_name(segment, 'segment')}/{RECEIPT}")
        except FileNotFoundError:
            return None
        receipt = Receipt.from_json(text, segment)
        self._ownership.check(receipt.owner, f"Segment {segment}")
        return receipt

    def _no_segment(self, segment: str) -> Unsound:
        return Unsound(f"There is no segment {segment!r} in {self.url}.", "missing")
