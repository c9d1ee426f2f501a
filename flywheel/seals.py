"""Sealed files, which contain their kind, name, owner and dependencies.

A sealed file is a JSON object whose last key is its seal:

    {..., "seal": {"format": 2, "kind": "snapshot", "name": "i0001-mppi", "owner": "1f6c...",
                   "rests_on": {"i0000-mppi": "8d1f..."}, "sha256": "..."}}

Its sha256 covers every byte before it. A changed byte is detected, and so is a file under another's
name, or a copy from elsewhere.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path
from typing import Any, Literal, cast

from flywheel.errors import DataError
from flywheel.files import opened, parsed_json, shown

FORMAT = 2
SEAL = "seal"
_END = b'"\n }\n}\n'  # what follows the sha256
Kind = Literal["missing", "altered", "foreign"]


class Unsound(DataError):
    """A stored item that is not as it was stored.

    Attributes:
      kind: of the fault. An item is also altered if it cannot be read, and foreign if it is that of
        another name.
    """

    def __init__(self, message: str, kind: Kind = "altered") -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True)
class Seal:
    """Identity of a sealed file.

    Attributes:
      kind: of the content: "snapshot", "iteration".
      name: its own.
      owner: id of its store, or key of its run.
      rests_on: name -> digest of each dependency.
    """

    kind: str
    name: str
    owner: str
    rests_on: Mapping[str, str] = field(default_factory=dict)


def sealed(values: Mapping[str, Any], seal: Seal, allow_nan: bool = False) -> bytes:
    """The text of values under a seal.

    Args:
      values: JSON data.
      seal: of them.
      allow_nan: allow non-finite numbers.
    """
    head = {"format": FORMAT, **vars(seal), "rests_on": dict(seal.rests_on), "sha256": ""}
    text = json.dumps({**values, SEAL: head}, indent=1, allow_nan=allow_nan).encode()
    body = text[: -len('"\n }\n}')]
    return body + hashlib.sha256(body).hexdigest().encode() + _END


def unsealed(text: bytes, what: str) -> tuple[dict[str, Any], Seal]:
    """Values and seal of a text.

    Args:
      text: of the file.
      what: its name, at the beginning of a sentence: "The receipt of segment e".

    Raises:
      Unsound: it was altered, or is not such a text.
      DataError: a later version wrote it.
    """
    try:
        values = parsed_json(text, "it", DataError)
    except DataError as error:
        raise Unsound(f"{what} was altered: {error}") from None
    if not isinstance(values, dict):
        raise Unsound(f"{what} was altered: it contains {shown(values)}, not named values.")
    if SEAL not in values:
        raise Unsound(f"{what} was altered: it has no seal.")
    head = values.pop(SEAL)
    if isinstance(head, dict) and isinstance(head.get("format"), int) and head["format"] > FORMAT:
        raise DataError(
            f"{what} has format {head['format']}, of a later version; this one reads up to {FORMAT}."
        )
    body, stated = text[: -len(_END) - 64], text[-len(_END) - 64 : -len(_END)]
    digest = hashlib.sha256(body).hexdigest()
    if not text.endswith(_END) or stated != digest.encode():
        words = stated[:12].decode(errors="replace")
        raise Unsound(f"{what} was altered: its sha256 is {digest[:12]}, not {words}.")
    return values, _seal_of(head, what)


def _seal_of(head: Any, what: str) -> Seal:
    try:
        seal = Seal(head["kind"], head["name"], head["owner"], dict(head["rests_on"]))
    except (KeyError, TypeError, ValueError):
        raise Unsound(f"{what} was altered: its seal is {shown(head)}.") from None
    words = (seal.kind, seal.name, seal.owner, *seal.rests_on, *seal.rests_on.values())
    if not all(isinstance(word, str) for word in words):
        raise Unsound(f"{what} was altered: its seal is {shown(head)}.")
    return seal


def check_seal(seal: Seal, kind: str, name: str, what: str) -> None:
    """Check the identity in a seal.

    Args:
      seal: from the file.
      kind, name: expected.
      what: its name, at the beginning of a sentence.

    Raises:
      Unsound: its seal identifies another item.
    """
    if seal.kind != kind:
        raise Unsound(f"{what} is that of {seal.kind} {seal.name}.")
    if seal.name != name:
        raise Unsound(f"{what} is that of {seal.name}.", "foreign")


def digest_of(values: Any) -> str:
    """sha256 of values, independent of their layout as JSON."""
    canonical = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


def file_sha256(path: Path, what: str) -> str:
    """sha256 of a regular file, of any size.

    Raises:
      Unsound: it is missing, or cannot be read.
    """
    try:
        with opened(path, what, DataError, limit=None) as file:
            return hashlib.file_digest(cast("BufferedReader", file), "sha256").hexdigest()
    except (DataError, OSError) as error:
        there = path.is_symlink() or path.exists()
        raise Unsound(str(error), "altered" if there else "missing") from None
