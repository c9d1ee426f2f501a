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

RECORDINGS = "recording"


@dataclass(frozen=True)
class EpisodeSummary:
    """What a manifest says of an episode.

    Attributes:
      id, split: as in the episode.
      segment: that holds it.
      steps, seconds: its duration in control steps, and in [s].
      robot, source, dataset, controller, task, iteration, model: of its provenance.
      success: of its task; None without one.
    """

    id: str
    split: Split
    segment: str
    steps: int
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
        """Read what `to_json` wrote; DataError if it was altered."""
        content, _ = unseal_text(text, f"The receipt of segment {name}")
        summaries = tuple(EpisodeSummary(**s) for s in content.pop("summaries"))
        return cls(summaries=summaries, **content)


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
    """

    name: str
    digest: str
    parent: str
    robot: str
    datasets: tuple[str, ...]
    segments: tuple[str, ...]
    episodes: tuple[EpisodeSummary, ...]

    def summary(self) -> list[tuple[str, str, str, int, int, float]]:
        """Rows (data set, controller, split, iteration, episodes, seconds), sorted."""
        counts: Counter[tuple[str, str, str, int]] = Counter()
        seconds: Counter[tuple[str, str, str, int]] = Counter()
        for e in self.episodes:
            key = (e.dataset, e.controller, e.split, e.iteration)
            counts[key] += 1
            seconds[key] += e.seconds  # type: ignore[assignment]
        return [(*key, counts[key], float(seconds[key])) for key in sorted(counts)]


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
        return f"{self.segment}: {self.what}. Episodes: {', '.join(self.episodes) or 'unknown'}."


def manifest(
    receipts: Sequence[Receipt], parent: Snapshot | None, datasets: Sequence[str]
) -> dict[str, Any]:
    """Content of a new snapshot's manifest.

    Args:
      receipts: of its segments.
      parent: whose data-set order is kept.
      datasets: names that come next in the order, whether or not an episode is of them.

    Raises:
      DataError: no episode, one id twice, episodes of several robots, or not the parent's.
    """
    summaries = [s for receipt in receipts for s in receipt.summaries]
    if not summaries:
        raise DataError("A snapshot needs at least one episode, got none.")
    twice = [name for name, n in Counter(s.id for s in summaries).items() if n > 1]
    if twice:
        raise DataError(f"A snapshot holds each episode once; got twice: {', '.join(twice)}.")
    robots = {s.robot for s in summaries} | ({parent.robot} if parent else set())
    if len(robots) > 1:
        strangers = {s.robot[:12]: s.id for s in summaries}
        raise DataError(
            "All episodes of a snapshot are of one robot, got "
            + ", ".join(f"{robot} ({episode})" for robot, episode in sorted(strangers.items()))
            + (f" under a parent of {parent.robot[:12]}." if parent else ".")
        )
    order = dict.fromkeys(parent.datasets if parent else ())
    order |= dict.fromkeys(datasets)
    order |= dict.fromkeys(s.dataset for s in summaries)
    return {
        "parent": parent.digest if parent else "",
        "robot": robots.pop(),
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
    )


def seal_text(content: dict[str, Any]) -> tuple[bytes, str]:
    """JSON text of content with its sha256 beside it, and that digest."""
    digest = hashlib.sha256(_canonical(content)).hexdigest()
    text = json.dumps({"sha256": digest, "content": content}, sort_keys=True, indent=1)
    return text.encode(), digest


def unseal_text(text: bytes, what: str) -> tuple[dict[str, Any], str]:
    """Content and digest of what `seal_text` wrote.

    Raises:
      DataError: it is not as it was written.
    """
    try:
        outer = json.loads(text)
        content, digest = outer["content"], outer["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{what} cannot be read: {error}") from error
    if hashlib.sha256(_canonical(content)).hexdigest() != digest:
        raise DataError(f"{what} was altered: its sha256 is no longer {digest[:12]}.")
    return content, digest


def _canonical(content: dict[str, Any]) -> bytes:
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
