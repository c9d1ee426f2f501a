"""Comparison of two answers, number by number."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

TOLERANCE = 1e-9  # relative difference of two numbers that count as the same


@dataclass(frozen=True)
class Fields:
    """Intentional changes of fields.

    Attributes:
      renamed: old name -> new name.
      added: names of new fields.
    """

    renamed: dict[str, str] = field(default_factory=dict)
    added: tuple[str, ...] = ()


def differences(
    before: Any, after: Any, fields: Fields = Fields(), path: str = ""
) -> Iterator[str]:
    """Differences of `after` from `before`.

    Args:
      before, after: values from JSON.
      fields: renamed or added.
      path: of both.
    """
    if isinstance(before, dict) and isinstance(after, dict):
        was: dict[str, Any] = {fields.renamed.get(str(k), str(k)): v for k, v in before.items()}
        added = set(fields.added) - set(was)
        for name in sorted((set(was) | set(after)) - added):
            here = f"{path}/{name}"
            if name not in after or name not in was:
                yield f"{here}: only {'after' if name in after else 'before'}"
            else:
                yield from differences(was[name], after[name], fields, here)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{path}: {len(before)} before, {len(after)} after"
        for index, (old, new) in enumerate(zip(before, after, strict=False)):
            yield from differences(old, new, fields, f"{path}/{index}")
    elif not _same(before, after):
        yield f"{path}: {before!r} before, {after!r} after"


def _same(before: Any, after: Any) -> bool:
    if isinstance(before, float) and isinstance(after, float | int):
        if math.isnan(before):
            return math.isnan(after)
        return math.isclose(before, after, rel_tol=TOLERANCE, abs_tol=1e-300)
    return bool(before == after)
