"""Split of an episode: fixed when it is recorded, never by position."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from flywheel.errors import DataError
from flywheel.records import Split


def assign_split(key: str | int, fractions: Mapping[Split, float]) -> Split:
    """A split for an episode, by the hash of its origin (its seed, its id).

    Args:
      key: equal for everything that must stay together.
      fractions: of the splits; they sum to one.

    Raises:
      DataError: the fractions are negative or do not sum to one.
    """
    if min(fractions.values(), default=-1.0) < 0 or abs(sum(fractions.values()) - 1) > 1e-9:
        raise DataError(f"Fractions of splits are >= 0 and sum to 1, got {dict(fractions)}.")
    place = int.from_bytes(hashlib.sha256(str(key).encode()).digest()[:8], "big") / 2**64
    for split, fraction in fractions.items():
        place -= fraction
        if place < 0:
            return split
    return next(reversed([s for s, f in fractions.items() if f > 0]))
