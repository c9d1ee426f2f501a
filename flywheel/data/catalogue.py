"""What the store writes beside the arrays: receipts of segments and manifests of snapshots.

Both are JSON with a sha256 over their own canonical text, so that a flipped byte in them is found.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from flywheel.errors import DataError
from flywheel.records import Episode, Source, Split


@dataclass(frozen=True)
class EpisodeSummary:
    """What a manifest says of an episode.

    Attributes:
      id, split: as in the episode.
      segment: that holds it.
      steps, dt, seconds: its control steps, the length of one [s], and of all [s].
      robot, source, dataset, controller, task, iteration, model: of its provenance.
      success: of its task; None without one.
    """

    id: str
    split: Split
    segment: str
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
    """

    segment: str
    sha256: str
    files: dict[str, str]
    summaries: tuple[EpisodeSummary, ...]

    @property
    def episodes(self) -> tuple[str, ...]:
        """Ids of its episodes."""
        return tuple(s.id for s in self.summaries)

    def to_json(self) -> bytes:
        """Canonical text with its digest."""
        return seal_text(asdict(self))[0]

    @classmethod
    def from_json(cls, text: bytes, name: str) -> Receipt:
        """Read what `to_json` wrote; DataError if it was altered, or is of another segment."""
        content, _ = unseal_text(text, f"The receipt of segment {name}")
        try:
            summaries = tuple(EpisodeSummary(**s) for s in content.pop("summaries"))
            receipt = cls(summaries=summaries, **content)
        except (KeyError, TypeError) as error:
            raise DataError(f"Segment {name} was written by another version: {error}.") from error
        if receipt.segment != name:
            raise DataError(f"The receipt of segment {name} is that of {receipt.segment}.")
        return receipt


@dataclass(frozen=True)
class SummaryRow:
    """How much of one kind a snapshot holds.

    Attributes:
      dataset, controller, split, iteration: what kind.
      episodes, steps, seconds: how much.
    """

    dataset: str
    controller: str
    split: Split
    iteration: int
    episodes: int
    steps: int
    seconds: float


@dataclass(frozen=True)
class Snapshot:
    """A frozen list of episodes under a digest.

    Attributes:
      name: for people; not part of the digest.
      digest: sha256 of the manifest.
      parent: digest of the snapshot it grew from, or "".
      robot: digest of the robot of all episodes.
      datasets: names in the order of the network's one-hot.
      segments: names, in order.
      episodes: of all segments.
      sha256: of each segment, in the same order.
    """

    name: str
    digest: str
    parent: str
    robot: str
    datasets: tuple[str, ...]
    segments: tuple[str, ...]
    episodes: tuple[EpisodeSummary, ...]
    sha256: tuple[str, ...]

    def summary(self) -> tuple[SummaryRow, ...]:
        """How much there is by data set, controller, split and iteration, sorted."""
        kinds: dict[tuple[str, str, Split, int], list[EpisodeSummary]] = {}
        for e in self.episodes:
            kinds.setdefault((e.dataset, e.controller, e.split, e.iteration), []).append(e)
        return tuple(
            SummaryRow(
                *kind,
                episodes=len(found),
                steps=sum(e.steps for e in found),
                seconds=round(sum(e.seconds for e in found), 9),
            )
            for kind, found in sorted(kinds.items())
        )

    def ids(self, segment: str) -> tuple[str, ...]:
        """Ids of the episodes of one of its segments."""
        return tuple(e.id for e in self.episodes if e.segment == segment)


@dataclass(frozen=True)
class Damage:
    """Something in the store that is not as it was committed.

    Attributes:
      segment: that it is in, or the snapshot's name.
      episodes: ids that it concerns.
      what: is wrong.
    """

    segment: str
    episodes: tuple[str, ...]
    what: str

    def __str__(self) -> str:
        episodes = ", ".join(self.episodes) or "unknown"
        return f"{self.segment}: {self.what.rstrip('.')}. Episodes: {episodes}."


def replaced(receipt: Receipt, sha256: str) -> Damage:
    """A snapshot lists a segment with another digest than it has."""
    what = f"a snapshot lists it with sha256 {sha256[:12]}, but it now has {receipt.sha256[:12]}"
    return Damage(receipt.segment, receipt.episodes, what)


def manifest(
    receipts: Sequence[Receipt], parent: Snapshot | None, datasets: Sequence[str]
) -> dict[str, Any]:
    """Content of a new snapshot's manifest.

    Args:
      receipts: of its segments.
      parent: whose data-set order is kept.
      datasets: names that come next in the order, whether or not an episode is of them.

    Raises:
      DataError: the episodes do not belong together, or not under this parent.
    """
    summaries = [s for receipt in receipts for s in receipt.summaries]
    if not summaries:
        raise DataError("A snapshot needs at least one episode, got none.")
    _check_together(summaries, parent)
    order = dict.fromkeys(parent.datasets if parent else ())
    order |= dict.fromkeys(datasets)
    order |= dict.fromkeys(s.dataset for s in summaries)
    return {
        "parent": parent.digest if parent else "",
        "robot": summaries[0].robot,
        "datasets": list(order),
        "segments": [
            {
                "segment": r.segment,
                "sha256": r.sha256,
                "episodes": [asdict(s) for s in r.summaries],
            }
            for r in receipts
        ],
    }


def _check_together(summaries: Sequence[EpisodeSummary], parent: Snapshot | None) -> None:
    before = {s.id: s for s in parent.episodes} if parent else {}
    for new in summaries:
        old = before.setdefault(new.id, new)
        if old.split != new.split:
            raise DataError(
                f"An episode is in one split for ever; {new.id} is in {old.split} (segment "
                f"{old.segment}) and in {new.split} (segment {new.segment})."
            )
    twice = [name for name, n in Counter(s.id for s in summaries).items() if n > 1]
    if twice:
        raise DataError(f"A snapshot holds each episode once; got twice: {', '.join(twice)}.")
    for what, of in (("one robot", lambda s: s.robot[:12]), ("one dt", lambda s: f"{s.dt} s")):
        kinds = {of(s): s.id for s in before.values()}
        if len(kinds) > 1:
            listed = ", ".join(f"{kind} ({episode})" for kind, episode in sorted(kinds.items()))
            raise DataError(f"A snapshot and its parent are of {what}; got {listed}.")


def snapshot_of(name: str, content: dict[str, Any], digest: str) -> Snapshot:
    """The snapshot that a manifest describes."""
    return Snapshot(
        name=name,
        digest=digest,
        parent=content["parent"],
        robot=content["robot"],
        datasets=tuple(content["datasets"]),
        segments=tuple(s["segment"] for s in content["segments"]),
        episodes=tuple(EpisodeSummary(**e) for s in content["segments"] for e in s["episodes"]),
        sha256=tuple(s["sha256"] for s in content["segments"]),
    )


def seal_text(content: dict[str, Any], allow_nan: bool = False) -> tuple[bytes, str]:
    """JSON text of content with its sha256 beside it, and that digest."""
    canonical = json.dumps(
        content, sort_keys=True, separators=(",", ":"), allow_nan=allow_nan
    ).encode()
    digest = hashlib.sha256(canonical).hexdigest()
    text = json.dumps({"sha256": digest, "content": content}, sort_keys=True, indent=1)
    return text.encode(), digest


def unseal_text(text: bytes, what: str, allow_nan: bool = False) -> tuple[dict[str, Any], str]:
    """Content and digest of what `seal_text` wrote.

    Raises:
      DataError: it is not, to the byte, as it was written.
    """
    try:
        outer = json.loads(text)
        content, digest = outer["content"], outer["sha256"]
        again = seal_text(content, allow_nan)
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{what} was altered: it cannot be read ({error}).") from error
    if again != (text, digest):
        raise DataError(f"{what} was altered: its sha256 is {again[1][:12]}, not {digest[:12]}.")
    return content, digest
