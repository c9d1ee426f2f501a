"""Check everything in a store for altered, missing or foreign files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Protocol

from flywheel.data.catalogue import Damage, Snapshot
from flywheel.data.identity import STORE_FILE, Ownership
from flywheel.data.places import Place
from flywheel.data.segments import ids_in
from flywheel.errors import DataError
from flywheel.seals import Kind, Unsound

_MANIFEST = ".json"


class Store(Protocol):
    """Interface of a store for the verification."""

    def snapshot(self, name: str) -> Snapshot:
        """Read a snapshot."""
        ...

    def damages(
        self,
        segment: str,
        sha256: str | None = None,
        ids: tuple[str, ...] = (),
        arrays: bool = True,
    ) -> list[Damage]:
        """Faults of a segment."""
        ...


def damages_in(
    store: Store, place: Place, ownership: Ownership, snapshot: Snapshot | None, arrays: bool
) -> Iterator[Damage]:
    """All damages of a store; `TrajectoryStore.verify` documents them.

    Args:
      store: to check.
      place: of its files.
      ownership: recognises its own files.
      snapshot: only it and its segments; all of the store if None.
      arrays: hash all files.
    """
    if snapshot is not None:
        yield from _changed(store, place, snapshot)
        yield from _listed(store, [snapshot], arrays)
        return
    yield from _identity(ownership)
    manifests = _names("snapshots", lambda: place.names("snapshots"))
    segments = _names("segments", place.segments)
    yield from (each for each in (manifests, segments) if isinstance(each, Damage))
    sealed: list[Snapshot] = []
    if not isinstance(manifests, Damage):
        yield from _snapshots(store, place, manifests, sealed)
        yield from _parents(sealed, [name.removesuffix(_MANIFEST) for name in manifests])
    there = [] if isinstance(segments, Damage) else segments
    known = {name for one in sealed for name in one.segments}
    yield from _listed(store, sealed, arrays)
    for name in there:
        if name not in known:
            yield from store.damages(name, arrays=arrays)


def _identity(ownership: Ownership) -> Iterator[Damage]:
    try:
        if ownership.noted() is None and ownership.inferred() is not None:
            what = "it is missing; it is written again with the next stored episode"
            yield Damage(f"file {STORE_FILE}", (), what, "missing")
    except Unsound as error:
        yield replace(
            Damage.of(error, f"file {STORE_FILE}"),
            what=f"{error} If you move it away, it is reconstructed",
        )


def _names(folder: str, names: Callable[[], list[str]]) -> list[str] | Damage:
    try:
        return names()
    except DataError as error:
        return Damage.of(error, f"folder {folder}")


def _snapshots(
    store: Store, place: Place, files: Sequence[str], sealed: list[Snapshot]
) -> Iterator[Damage]:
    """Faults of manifests; undamaged ones are added to `sealed`."""
    names = [file.removesuffix(_MANIFEST) for file in files if file.endswith(_MANIFEST)]
    for name in names:
        try:
            sealed.append(store.snapshot(name))
        except DataError as error:
            yield Damage.of(error, f"snapshot {name}", _ids_of_manifest(place, name))
    for file in files:
        if not file.endswith(_MANIFEST):
            yield Damage(f"file snapshots/{file}", (), "it is no snapshot", "foreign")


def _changed(store: Store, place: Place, snapshot: Snapshot) -> Iterator[Damage]:
    """Faults of the manifest of a snapshot that was read before."""
    what = f"snapshot {snapshot.name}"
    try:
        there = store.snapshot(snapshot.name)
    except DataError as error:
        yield Damage.of(error, what, _ids_of_manifest(place, snapshot.name))
        return
    if there.digest != snapshot.digest:
        words = f"its digest is {there.digest[:12]}, not {snapshot.digest[:12]}"
        yield Damage(what, (), words)


def _parents(sealed: Sequence[Snapshot], names: Iterable[str]) -> Iterator[Damage]:
    """Snapshots whose parent is missing, or has changed."""
    digests = {one.name: one.digest for one in sealed}
    damaged = set(names) - digests.keys()
    for one in sealed:
        if one.parent and one.parent not in digests.values() and one.parent_name not in damaged:
            name = one.parent_name
            now = f"has {digests[name][:12]}" if name in digests else "is missing"
            what = f"snapshot {one.name} grew from it with digest {one.parent[:12]}; it {now}"
            kind: Kind = "altered" if name in digests else "missing"
            yield Damage(f"snapshot {name}", (), what, kind)


def _listed(store: Store, sealed: Iterable[Snapshot], arrays: bool) -> Iterator[Damage]:
    """Faults of the segments of snapshots."""
    listed = {
        (segment, sha256): one.ids(segment)
        for one in sealed
        for segment, sha256 in zip(one.segments, one.sha256, strict=True)
    }
    for (segment, sha256), ids in listed.items():
        yield from store.damages(segment, sha256, ids, arrays)


def _ids_of_manifest(place: Place, name: str) -> tuple[str, ...]:
    try:
        return ids_in(place.read(f"snapshots/{name}.json"))
    except (DataError, FileNotFoundError):
        return ()
