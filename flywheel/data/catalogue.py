"""JSON files of the store: receipts of segments and manifests of snapshots.

Both are JSON under a seal, so that a flipped byte in them is found, as is a file under another's
name or from another store. The digest of a snapshot covers its content alone: snapshots of the same
episodes have the same one, under any name and at any place.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from typing import Annotated, Any, TypeVar, cast

from pydantic import AfterValidator, ConfigDict, TypeAdapter, ValidationError

from flywheel.errors import DataError
from flywheel.files import MB, shown
from flywheel.records import Episode, Source, Split
from flywheel.seals import Kind, Seal, Unsound, check_seal, digest_of, sealed, unsealed
from flywheel.validation import first_problem

LARGEST_LISTING = 200 * MB  # largest receipt or manifest, with some 400 000 episodes [bytes]
STRICT = ConfigDict(extra="forbid")
R = TypeVar("R")
_NAME = re.compile(r"[a-z0-9][a-z0-9._-]*")


def is_name(name: str) -> bool:
    """True if a segment, an episode or a snapshot can have this name."""
    return _NAME.fullmatch(name) is not None


def _named(name: str) -> str:
    if not is_name(name):
        raise ValueError("not a name of a segment or an episode")
    return name


Name = Annotated[str, AfterValidator(_named)]


@dataclass(frozen=True)
class EpisodeSummary:
    """Summary of an episode in a manifest.

    Attributes:
      id, split: as in the episode.
      segment: of the episode.
      steps, dt, seconds: its control steps, the length of one [s], and of all [s].
      robot, source, dataset, controller, task, iteration, model: of its provenance.
      success: of its task; None without one.
    """

    __pydantic_config__ = STRICT

    id: Name
    split: Split
    segment: Name
    steps: int
    dt: float
    seconds: float
    robot: str
    source: Source
    dataset: str
    controller: str
    task: str
    iteration: int
    model: str
    success: bool | None

    @classmethod
    def of(cls, episode: Episode, segment: str) -> EpisodeSummary:
        """Summarise an episode."""
        origin, track = episode.provenance, episode.trajectory
        return cls(
            id=episode.id,
            split=episode.split,
            segment=segment,
            steps=track.steps,
            dt=track.dt,
            seconds=round(track.steps * track.dt, 9),
            robot=origin.robot,
            source=origin.source,
            dataset=origin.dataset,
            controller=origin.controller,
            task=origin.task,
            iteration=origin.iteration,
            model=origin.model,
            success=episode.outcome.success if episode.outcome else None,
        )


@dataclass(frozen=True)
class Receipt:
    """Proof that a segment is committed.

    Attributes:
      segment: its name.
      sha256: over the names and contents of its files.
      files: relative path -> sha256 of each.
      summaries: of its episodes, in their order.
      sizes: relative path -> bytes of each.
      owner: id of its store.
    """

    __pydantic_config__ = STRICT

    segment: Name
    sha256: str
    files: dict[str, str]
    summaries: tuple[EpisodeSummary, ...]
    sizes: dict[str, int] = field(compare=False)
    owner: str = field(compare=False)

    @property
    def episodes(self) -> tuple[str, ...]:
        """Ids of its episodes."""
        return tuple(s.id for s in self.summaries)

    def to_json(self) -> bytes:
        """Its text, under a seal."""
        content = asdict(self)
        return sealed(content, Seal("segment", self.segment, content.pop("owner")))

    @classmethod
    def from_json(cls, text: bytes, name: str) -> Receipt:
        """Read the text of `to_json`.

        Raises:
          Unsound: it was altered, or is of another segment.
        """
        what = f"The receipt of segment {name}"
        content, seal = unsealed(text, what)
        check_seal(seal, "segment", name, what)
        receipt = _read(cls, {**content, "owner": seal.owner}, what)
        if receipt.segment != name:
            raise Unsound(f"{what} is that of {receipt.segment}.", "foreign")
        return receipt


@dataclass(frozen=True)
class Snapshot:
    """A frozen list of episodes under a digest.

    Attributes:
      name: for people; not part of the digest.
      digest: sha256 of the manifest's content.
      parent: digest of the snapshot that it extends, or "".
      robot: digest of the robot of all episodes.
      datasets: names in the order of the network's one-hot.
      segments: names, in order.
      episodes: of all segments.
      sha256: of each segment, in the same order.
      parent_name: of the snapshot that it extends; "" without one.
      owner: id of its store.
    """

    name: str
    digest: str
    parent: str
    robot: str
    datasets: tuple[str, ...]
    segments: tuple[str, ...]
    episodes: tuple[EpisodeSummary, ...]
    sha256: tuple[str, ...]
    parent_name: str = field(default="", compare=False)
    owner: str = field(default="", compare=False)

    def ids(self, segment: str) -> tuple[str, ...]:
        """Ids of the episodes of one of its segments."""
        return tuple(e.id for e in self.episodes if e.segment == segment)


@dataclass(frozen=True)
class _Listed:
    __pydantic_config__ = STRICT

    segment: Name
    sha256: str
    episodes: tuple[EpisodeSummary, ...]


@dataclass(frozen=True)
class _Manifest:
    __pydantic_config__ = STRICT

    parent: str
    robot: str
    datasets: tuple[str, ...]
    segments: tuple[_Listed, ...]


@dataclass(frozen=True)
class Damage:
    """A changed item in the store.

    Attributes:
      segment: of the item, or "snapshot", "file" or "folder" and a name.
      episodes: affected ids.
      what: the fault.
      kind: of the fault.
    """

    segment: str
    episodes: tuple[str, ...]
    what: str
    kind: Kind = "altered"

    @property
    def path(self) -> str:
        """Path of the damaged file or folder in the store."""
        kind, _, name = self.segment.rpartition(" ")
        form = {"": "segments/{}", "snapshot": "snapshots/{}.json"}.get(kind, "{}")
        return form.format(name)

    @classmethod
    def of(cls, error: DataError, segment: str, episodes: tuple[str, ...] = ()) -> Damage:
        """Message of an error raised on reading."""
        kind = error.kind if isinstance(error, Unsound) else "altered"
        return cls(segment, episodes, str(error), kind)

    def __str__(self) -> str:
        episodes = ", ".join(self.episodes) or "unknown"
        return f"{self.segment}: {self.what.rstrip('.')}. Episodes: {episodes}."


def replaced(receipt: Receipt, sha256: str) -> Damage:
    """A snapshot lists a segment with another digest than it has."""
    what = f"a snapshot lists it with sha256 {sha256[:12]}, but it now has {receipt.sha256[:12]}"
    return Damage(receipt.segment, receipt.episodes, what)


def manifest(
    name: str,
    owner: str,
    receipts: Sequence[Receipt],
    parent: Snapshot | None,
    datasets: Sequence[str],
) -> tuple[bytes, str]:
    """A new snapshot's manifest, and the snapshot's digest.

    Args:
      name: of the snapshot.
      owner: id of the store.
      receipts: of its segments.
      parent: its data-set order is kept.
      datasets: names that come next in the order, with or without episodes.

    Raises:
      DataError: the episodes do not fit together, or do not fit this parent.
    """
    summaries = [s for receipt in receipts for s in receipt.summaries]
    if not summaries:
        raise DataError("A snapshot needs at least one episode, got none.")
    _check_together(summaries, parent)
    order = dict.fromkeys(parent.datasets if parent else ())
    order |= dict.fromkeys(datasets)
    order |= dict.fromkeys(s.dataset for s in summaries)
    content = {
        "parent": parent.digest if parent else "",
        "robot": summaries[0].robot,
        "datasets": list(order),
        "segments": [
            {"segment": r.segment, "sha256": r.sha256, "episodes": [asdict(s) for s in r.summaries]}
            for r in receipts
        ],
    }
    rests_on = {parent.name: parent.digest} if parent else {}
    return sealed(content, Seal("snapshot", name, owner, rests_on)), digest_of(content)


def _check_together(summaries: Sequence[EpisodeSummary], parent: Snapshot | None) -> None:
    before = {s.id: s for s in parent.episodes} if parent else {}
    for new in summaries:
        old = before.setdefault(new.id, new)
        if old.split != new.split:
            raise DataError(
                f"An episode stays in one split; {new.id} is in {old.split} (segment "
                f"{old.segment}) and in {new.split} (segment {new.segment})."
            )
    twice = [name for name, n in Counter(s.id for s in summaries).items() if n > 1]
    if twice:
        raise DataError(f"A snapshot contains each episode once; got twice: {', '.join(twice)}.")
    for what, of in (("one robot", lambda s: s.robot[:12]), ("one dt", lambda s: f"{s.dt} s")):
        kinds = {of(s): s.id for s in before.values()}
        if len(kinds) > 1:
            listed = ", ".join(f"{kind} ({episode})" for kind, episode in sorted(kinds.items()))
            raise DataError(f"A snapshot and its parent are of {what}; got {listed}.")


def snapshot_of(name: str, text: bytes) -> Snapshot:
    """The snapshot that a manifest describes.

    Args:
      name: expected one.
      text: of the manifest.

    Raises:
      Unsound: it was altered, or is another snapshot's.
    """
    what = f"The manifest of snapshot {name}"
    content, seal = unsealed(text, what)
    check_seal(seal, "snapshot", name, what)
    listed = _read(_Manifest, content, what)
    return Snapshot(
        name=name,
        digest=digest_of(content),
        parent=listed.parent,
        robot=listed.robot,
        datasets=listed.datasets,
        segments=tuple(s.segment for s in listed.segments),
        episodes=tuple(e for s in listed.segments for e in s.episodes),
        sha256=tuple(s.sha256 for s in listed.segments),
        parent_name=next(iter(seal.rests_on), ""),
        owner=seal.owner,
    )


def check_name(name: object, kind: str) -> str:
    """A name that may be used in a path.

    Raises:
      DataError: it may not.
    """
    if not isinstance(name, str) or not is_name(name):
        raise DataError(
            f"A {kind}'s name consists of a-z, 0-9, '.', '_' and '-' and starts with a letter or "
            f"digit; got {shown(name)}."
        )
    return name


def _read(kind: type[R], values: dict[str, Any], what: str) -> R:
    """Values of a sound file as a record.

    Raises:
      Unsound: they are invalid; another version wrote the file, or another program.
    """
    try:
        record: R = _adapter(cast("Any", kind)).validate_python(values)
        return record
    except ValidationError as error:
        problem = first_problem(error)
        raise Unsound(f"{what} was written by another version: {problem}.") from None


@cache  # making one takes longer than reading a hundred receipts
def _adapter(kind: type) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
