"""A segment as files: its arrays, its receipt, and the telemetry, which no digest covers.

receipt.json          what it holds, with the sha256 of every file of the arrays
<sha256>.zarr/...     the arrays
telemetry.json        what planning took and foresaw
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flywheel.data.catalogue import LARGEST_LISTING, Damage, EpisodeSummary, Receipt, replaced
from flywheel.data.packing import Arrays, pack, unpack
from flywheel.errors import DataError
from flywheel.records import Episode
from flywheel.seals import Kind, Seal, Unsound, check_seal, sealed, unsealed

if TYPE_CHECKING:
    from flywheel.data.zarr_files import Files

RECEIPT = "receipt.json"
ABANDONED_SECONDS = 86400.0  # after which no writer on another machine is still at work
TELEMETRY = "telemetry.json"
_ID = re.compile(rb'"id"\s*:\s*"([a-z0-9._-]+)"')


@dataclass(frozen=True)
class Segment:
    """A segment ready to be published.

    Attributes:
      receipt: of the segment.
      files: contents by path within the segment's folder; the receipt is the last.
    """

    receipt: Receipt
    files: Files


@dataclass(frozen=True)
class Found:
    """Files at the place of a segment.

    Attributes:
      segment: its name.
      sizes: bytes of each file by path within the segment's folder.
      files: contents of the texts, and of the files in its receipt with the right size.
    """

    segment: str
    sizes: Mapping[str, int]
    files: Files

    @cached_property
    def receipt(self) -> Receipt:
        """Receipt of the segment.

        Raises:
          Unsound: it is missing, or damaged.
        """
        if RECEIPT not in self.files:
            what = f"{RECEIPT} is missing" if self.sizes else "the segment is missing"
            raise Unsound(what, "missing")
        return Receipt.from_json(self.files[RECEIPT], self.segment)


def written(name: str, episodes: Sequence[Episode], owner: Callable[[], str]) -> Segment:
    """Episodes as a segment, decoded once as a test.

    Args:
      name: of the segment.
      episodes: in their order.
      owner: returns the id of the store, called once the episodes are known to be right.

    Raises:
      DataError: an episode cannot be stored.
    """
    # Start-up time: zarr takes longer to import than everything else here.
    from flywheel.data.zarr_files import encode

    arrays, attributes = pack(episodes)
    group = encode(arrays, attributes)
    _check_reads_back(name, group, arrays)
    hashes = {path: hashlib.sha256(content).hexdigest() for path, content in group.items()}
    digest = hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()
    summaries = tuple(EpisodeSummary.of(e, name) for e in episodes)
    sizes = {path: len(content) for path, content in group.items()}
    receipt = Receipt(name, digest, hashes, summaries, sizes, owner())
    telemetry = {
        e.id: {k: np.asarray(v).tolist() for k, v in e.telemetry.items()} for e in episodes
    }
    files = {f"{_arrays_folder(receipt)}/{path}": content for path, content in group.items()}
    seal = Seal("telemetry", name, receipt.owner)
    files[TELEMETRY] = sealed({"episodes": telemetry}, seal, allow_nan=True)
    files[RECEIPT] = receipt.to_json()
    return Segment(receipt, files)


def worth_reading(text: bytes, segment: str, sizes: Mapping[str, int]) -> dict[str, int]:
    """Paths and sizes of the files of a segment that agree with its receipt.

    Args:
      text: of the receipt.
      segment: its name.
      sizes: of all existing files.
    """
    size = sizes.get(TELEMETRY)
    texts = {} if size is None or size > LARGEST_LISTING else {TELEMETRY: size}
    try:
        receipt = Receipt.from_json(text, segment)
    except DataError:
        return texts
    prefix = f"{_arrays_folder(receipt)}/"
    return texts | {
        f"{prefix}{path}": size
        for path in receipt.files
        if (size := sizes.get(f"{prefix}{path}")) is not None and size == receipt.sizes.get(path)
    }


def read_back(found: Found) -> list[Episode]:
    """The episodes of a segment without damage.

    Raises:
      DataError: another program wrote it.
    """
    from flywheel.data.zarr_files import decode  # as above

    prefix = f"{_arrays_folder(found.receipt)}/"
    group = {p.removeprefix(prefix): c for p, c in found.files.items() if p.startswith(prefix)}
    try:
        episodes = unpack(*decode(group))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise DataError(f"Segment {found.segment} holds no episodes of ours: {error!r}.") from error
    try:  # `verify` tells; the data do not suffer from it
        telemetry = _telemetry(found)
        return [_with_telemetry(e, telemetry.get(e.id, {})) for e in episodes]
    except (DataError, TypeError, ValueError, AttributeError):
        return episodes


def damages_of(found: Found, sha256: str | None = None) -> list[Damage]:
    """Faults of a segment with an undamaged receipt, except telemetry.

    Args:
      found: content of its folder.
      sha256: from a snapshot, if one lists it.
    """
    receipt = found.receipt
    if sha256 not in (None, receipt.sha256):
        return [replaced(receipt, str(sha256))]
    return [
        Damage(receipt.segment, receipt.episodes, what, kind)
        for what, kind in _differences(receipt, found)
    ]


def telemetry_damages(found: Found) -> list[Damage]:
    """Fault of the telemetry of an otherwise undamaged segment."""
    try:
        _telemetry(found)
    except DataError as error:
        return [Damage.of(error, found.segment, found.receipt.episodes)]
    return []


def _differences(receipt: Receipt, found: Found) -> Iterator[tuple[str, Kind]]:
    prefix = f"{_arrays_folder(receipt)}/"
    there = {
        p.removeprefix(prefix): size for p, size in found.sizes.items() if p.startswith(prefix)
    }
    for path, sha256 in receipt.files.items():
        content = found.files.get(f"{prefix}{path}")
        if path not in there:
            yield f"{path} is missing", "missing"
        elif content is None or hashlib.sha256(content).hexdigest() != sha256:
            yield f"{path} was altered", "altered"
    for path in sorted(there.keys() - receipt.files.keys()):
        yield f"{path} does not belong there", "foreign"
    # Arrays of other content were left by a writer on S3 that came second; nobody reads them.
    for path in found.sizes:
        if path not in (RECEIPT, TELEMETRY) and ".zarr/" not in path:
            yield f"{path} does not belong there", "foreign"


def ids_in(text: bytes) -> tuple[str, ...]:
    """Ids of episodes in a JSON text, even if it can no longer be parsed."""
    return tuple(dict.fromkeys(found.decode() for found in _ID.findall(text)))


def _arrays_folder(receipt: Receipt) -> str:
    return f"{receipt.sha256[:16]}.zarr"


def _check_reads_back(name: str, group: Files, arrays: Arrays) -> None:
    from flywheel.data.zarr_files import decode  # as above

    for array, values in arrays.items():  # one at a time: each is as large as the episodes
        own = f"{array}/", "zarr.json"
        back, _ = decode({path: content for path, content in group.items() if path.startswith(own)})
        if not _same_bits(back[array], values):
            raise DataError(f"Segment {name}: array {array} differs when read back.")


def _same_bits(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """True if arrays of eight-byte numbers are equal bit by bit, NaN included."""
    return one.dtype == other.dtype and np.array_equal(one.view("u8"), other.view("u8"))


def _telemetry(found: Found) -> dict[str, Any]:
    if TELEMETRY not in found.sizes:
        raise Unsound(f"{TELEMETRY} is missing", "missing")
    if TELEMETRY not in found.files:
        raise Unsound(f"{TELEMETRY} was altered: it has {found.sizes[TELEMETRY]} bytes")
    content, seal = unsealed(found.files[TELEMETRY], TELEMETRY)
    check_seal(seal, "telemetry", found.segment, TELEMETRY)
    if seal.owner != found.receipt.owner:
        raise Unsound(f"{TELEMETRY} is that of another store ({seal.owner[:12]})", "foreign")
    if not isinstance(episodes := content.get("episodes"), dict):
        raise Unsound(f"{TELEMETRY} was altered: it has no episodes")
    return episodes


def _with_telemetry(episode: Episode, telemetry: dict[str, Any]) -> Episode:
    values = {name: np.asarray(numbers, float) for name, numbers in telemetry.items()}
    return dataclasses.replace(episode, telemetry=values)
