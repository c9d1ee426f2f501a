"""The trajectory store: immutable segments of episodes, frozen into snapshots.

    <store>/segments/<name>/...         see `flywheel.data.segments`
    <store>/snapshots/<name>.json       frozen lists of segments, under a digest
    <store>/quarantine, <store>/tmp     damaged segments; unfinished ones

A segment appears as a whole or not at all, whenever its writer dies. What was acknowledged is on
the disk. Nothing stored is ever changed or deleted.
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path

from flywheel.data.catalogue import (
    Damage,
    EpisodeSummary,
    Receipt,
    Snapshot,
    manifest,
    replaced,
    seal_text,
    snapshot_of,
    unseal_text,
)
from flywheel.data.places import full_disk_told, place_at
from flywheel.data.segments import (
    RECEIPT,
    damages_of,
    ids_in,
    read_back,
    telemetry_damages,
    written,
)
from flywheel.errors import DataError
from flywheel.records import Episode

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")


class TrajectoryStore:
    """Episodes on disk. Many processes may write at once.

    Args:
      url: a local folder, or s3://bucket/prefix.
      options: of the S3 client, e.g. {"endpoint_url": "http://127.0.0.1:9000"}; what is not given
        comes from the usual AWS_* variables.
    """

    def __init__(self, url: str | Path, options: Mapping[str, object] | None = None) -> None:
        self.url = str(url)
        self._place = place_at(self.url, dict(options or {}))
        self._receipts: dict[str, Receipt] = {}  # for finding episodes; reading reads them again

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
        new = written(segment, episodes)
        with full_disk_told(f"segment {segment} was not stored", self.url):
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
        """Segments that are there, but whose receipt cannot be read."""
        return sorted(set(self._place.segments()) - self.committed().keys())

    def episodes(self, segment: str) -> tuple[EpisodeSummary, ...]:
        """What a segment holds."""
        return self._receipt(segment).summaries

    def read(self, episode: str) -> Episode:
        """Read an episode by its id.

        Raises:
          DataError: there is none, or it is not as it was committed; it is named.
        """
        found = self.read_segment(self._holder(episode).segment)
        return next(one for one in found if one.id == episode)

    def read_segment(self, segment: str, sha256: str | None = None) -> list[Episode]:
        """Read all episodes of a segment, checked against its receipt.

        Args:
          segment: its name.
          sha256: that a snapshot gives for it; by default, what its receipt says.

        Raises:
          DataError: it is not as it was committed; its episodes are named.
        """
        files = self._place.read_all(f"segments/{segment}")
        if not files:
            raise self._no_segment(segment)
        if damages := damages_of(segment, files, sha256):
            raise DataError(" ".join(map(str, damages)))
        return read_back(segment, files)

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
          RunError: the disk is full.
        """
        _check_name(name, "snapshot")
        before = self.snapshot(parent) if parent else None
        receipts = [self._receipt(segment) for segment in segments]
        if damages := [d for r in receipts for d in self._damages_since(r, before)]:
            raise DataError(
                "A snapshot is made of sound segments only. " + " ".join(map(str, damages))
            )
        text, digest = seal_text(manifest(receipts, before, datasets))
        with full_disk_told(f"snapshot {name} was not sealed", self.url):
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
        found = self._place.names("snapshots")
        return [name.removesuffix(".json") for name in found if name.endswith(".json")]

    def verify(self, snapshot: Snapshot | None = None) -> tuple[Damage, ...]:
        """Hash every file again and name what is not as it was committed.

        Args:
          snapshot: only it and its segments; all of the store by default.
        """
        found: list[Damage] = []
        sealed: list[Snapshot] = []
        for name in self.snapshots() if snapshot is None else [snapshot.name]:
            try:
                sealed.append(self.snapshot(name))
            except DataError as error:
                found.append(Damage(f"snapshot {name}", self._ids_of_manifest(name), str(error)))
        if snapshot is not None:
            if sealed and sealed[0].digest != snapshot.digest:
                what = f"its digest is {sealed[0].digest[:12]}, not {snapshot.digest[:12]}"
                found.append(Damage(f"snapshot {snapshot.name}", (), what))
            sealed = [snapshot]
        listed = {
            (segment, sha256): one.ids(segment)
            for one in sealed
            for segment, sha256 in zip(one.segments, one.sha256, strict=True)
        }
        for (segment, sha256), ids in listed.items():
            found += self._damages(segment, sha256, ids)
        if snapshot is None:
            for segment in sorted(set(self._place.segments()) - {name for name, _ in listed}):
                found += self._damages(segment)
        return tuple(found)

    def quarantine(self, segment: str) -> None:
        """Set a damaged segment aside, so that it can be collected again. Nothing is deleted.

        Raises:
          DataError: there is no such segment.
        """
        aside = f"quarantine/{segment}.{uuid.uuid4().hex[:8]}"
        try:
            self._place.move(f"segments/{segment}", aside)
        except FileNotFoundError:
            raise self._no_segment(segment) from None
        self._receipts.pop(segment, None)

    def quarantined(self) -> list[str]:
        """Names under which segments were set aside."""
        return self._place.names("quarantine")

    def sweep(self) -> int:
        """Remove what dead writers left unfinished; how many segments that was."""
        return self._place.sweep()

    def _check_same(self, receipt: Receipt) -> None:
        """The segment that is there already has the content that was to be stored, and is sound."""
        segment = receipt.segment
        if damages := self._damages(segment):
            raise DataError(
                "It is committed already, but not as it was; set it aside first. "
                + " ".join(map(str, damages))
            )
        there = self._receipt(segment)
        if there.sha256 != receipt.sha256:
            raise DataError(
                f"Segment {segment} is committed with sha256 {there.sha256[:12]}; other content, "
                f"{receipt.sha256[:12]}, cannot take its name."
            )

    def _damages(
        self, segment: str, sha256: str | None = None, ids: tuple[str, ...] = ()
    ) -> list[Damage]:
        try:
            files = self._place.read_all(f"segments/{segment}")
        except DataError as error:
            return [Damage(segment, ids, str(error))]
        found = damages_of(segment, files, sha256, ids)
        return found or telemetry_damages(segment, files)

    def _damages_since(self, receipt: Receipt, parent: Snapshot | None) -> list[Damage]:
        """Damages of a segment. One of the parent's was read then, and will be when it is used."""
        if parent is None or receipt.segment not in parent.segments:
            return self._damages(receipt.segment)
        before = parent.sha256[parent.segments.index(receipt.segment)]
        return [] if before == receipt.sha256 else [replaced(receipt, before)]

    def _ids_of_manifest(self, name: str) -> tuple[str, ...]:
        try:
            return ids_in(self._place.read(f"snapshots/{name}.json"))
        except FileNotFoundError:
            return ()

    def _holder(self, episode: str) -> Receipt:
        """Receipt of the segment that holds an episode."""
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
            text = self._place.read(f"segments/{segment}/{RECEIPT}")
        except (FileNotFoundError, NotADirectoryError):
            return None
        return Receipt.from_json(text, segment)

    def _no_segment(self, segment: str) -> DataError:
        return DataError(f"There is no segment {segment!r} in {self.url}.")


def _check_name(name: str, kind: str) -> None:
    if not _NAME.fullmatch(name):
        raise DataError(
            f"A {kind}'s name is made of a-z, 0-9, '.', '_' and '-' and starts with a letter or "
            f"digit; got {name!r}."
        )
