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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flywheel.data.catalogue import (
    Damage,
    EpisodeSummary,
    Receipt,
    replaced,
    seal_text,
    unseal_text,
)
from flywheel.data.packing import Arrays, pack, unpack
from flywheel.data.zarr_files import Files, decode, encode
from flywheel.errors import DataError
from flywheel.records import Episode

RECEIPT = "receipt.json"
TELEMETRY = "telemetry.json"
FORMERLY = "timing.json"  # in stores of before
_ID = re.compile(rb'"id"\s*:\s*"([a-z0-9._-]+)"')


@dataclass(frozen=True)
class Segment:
    """A segment ready to be published.

    Attributes:
      receipt: of it.
      files: contents by path within the segment's folder; the receipt is the last.
    """

    receipt: Receipt
    files: Files


def written(name: str, episodes: Sequence[Episode]) -> Segment:
    """Episodes as a segment, decoded once to see that it reads back.

    Raises:
      DataError: an episode must not be stored.
    """
    arrays, attributes = pack(episodes)
    group = encode(arrays, attributes)
    _check_reads_back(name, group, arrays)
    hashes = {path: hashlib.sha256(content).hexdigest() for path, content in group.items()}
    digest = hashlib.sha256(json.dumps(hashes, sort_keys=True).encode()).hexdigest()
    summaries = tuple(EpisodeSummary.of(e, name) for e in episodes)
    receipt = Receipt(name, digest, hashes, summaries)
    telemetry = {
        e.id: {k: np.asarray(v).tolist() for k, v in e.telemetry.items()} for e in episodes
    }
    files = {f"{_arrays_folder(receipt)}/{path}": content for path, content in group.items()}
    files[TELEMETRY] = seal_text(telemetry, allow_nan=True)[0]
    files[RECEIPT] = receipt.to_json()
    return Segment(receipt, files)


def read_back(segment: str, files: Files) -> list[Episode]:
    """The episodes of a segment without damage."""
    receipt = Receipt.from_json(files[RECEIPT], segment)
    prefix = f"{_arrays_folder(receipt)}/"
    group = {p.removeprefix(prefix): c for p, c in files.items() if p.startswith(prefix)}
    episodes = unpack(*decode(group))
    try:
        telemetry = _telemetry(files)
    except DataError:  # `verify` tells; the data do not suffer from it
        telemetry = {}
    return [_with_telemetry(e, telemetry.get(e.id, {})) for e in episodes]


def damages_of(
    segment: str, files: Files, sha256: str | None = None, ids: tuple[str, ...] = ()
) -> list[Damage]:
    """What of a segment is not as it was committed; telemetry aside.

    Args:
      segment: its name.
      files: all that its folder holds.
      sha256: that a snapshot gives for it, if one lists it.
      ids: of its episodes as that snapshot knows them.
    """
    try:
        if RECEIPT not in files:
            raise DataError(f"{RECEIPT} is missing" if files else "the segment is missing")
        receipt = Receipt.from_json(files[RECEIPT], segment)
    except DataError as error:
        named = ids or tuple(i for text in files.values() for i in ids_in(text))
        return [Damage(segment, tuple(dict.fromkeys(named)), str(error))]
    if sha256 not in (None, receipt.sha256):
        return [replaced(receipt, str(sha256))]
    return [Damage(segment, receipt.episodes, what) for what in _differences(receipt, files)]


def telemetry_damages(segment: str, files: Files) -> list[Damage]:
    """What is wrong with the telemetry of a segment that is sound otherwise."""
    try:
        _telemetry(files)
    except DataError as error:
        ids = Receipt.from_json(files[RECEIPT], segment).episodes
        return [Damage(segment, ids, str(error))]
    return []


def _differences(receipt: Receipt, files: Files) -> list[str]:
    prefix = f"{_arrays_folder(receipt)}/"
    found = {
        path.removeprefix(prefix): hashlib.sha256(content).hexdigest()
        for path, content in files.items()
        if path.startswith(prefix)
    }
    wrong = [f"{path} is missing" for path in receipt.files if path not in found]
    wrong += [
        f"{path} was altered" for path, sha in receipt.files.items() if found.get(path, sha) != sha
    ]
    wrong += [f"{path} does not belong there" for path in found if path not in receipt.files]
    # Arrays of other content were left by a writer on S3 that came second; nobody reads them.
    return wrong + [
        f"{path} does not belong there"
        for path in files
        if path not in (RECEIPT, TELEMETRY, FORMERLY) and ".zarr/" not in path
    ]


def ids_in(text: bytes) -> tuple[str, ...]:
    """Ids of episodes that JSON text names, even where it can no longer be parsed."""
    return tuple(dict.fromkeys(found.decode() for found in _ID.findall(text)))


def _arrays_folder(receipt: Receipt) -> str:
    return f"{receipt.sha256[:16]}.zarr"


def _check_reads_back(name: str, group: Files, arrays: Arrays) -> None:
    for array, values in arrays.items():  # one after the other: each is as large as the episodes
        own = f"{array}/", "zarr.json"
        back, _ = decode({path: content for path, content in group.items() if path.startswith(own)})
        if not _same_bits(back[array], values):
            raise DataError(f"Segment {name}: array {array} reads back as other numbers.")


def _same_bits(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """Of arrays whose numbers have eight bytes, NaN included."""
    return one.dtype == other.dtype and np.array_equal(one.view("u8"), other.view("u8"))


def _telemetry(files: Mapping[str, bytes]) -> dict[str, Any]:
    name = FORMERLY if FORMERLY in files else TELEMETRY
    if name not in files:
        raise DataError(f"{name} is missing")
    return unseal_text(files[name], name, allow_nan=True)[0]


def _with_telemetry(episode: Episode, telemetry: dict[str, Any]) -> Episode:
    values = {name: np.asarray(numbers, float) for name, numbers in telemetry.items()}
    return dataclasses.replace(episode, telemetry=values)
