"""Whether two answers say the same, number by number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

TOLERANCE = 1e-9  # relative difference of two numbers that count as the same


def differences(
    before: Any, after: Any, renamed: Mapping[str, str], path: str = ""
) -> Iterator[str]:
    """Where `after` differs from `before`.

    Args:
      before, after: of JSON.
      renamed: fields that have another name now, from the old name to the new one.
      path: at which both stand.
    """
    if isinstance(before, dict) and isinstance(after, dict):
        was = {renamed.get(name, name): value for name, value in before.items()}
        for name in sorted(was.keys() | after.keys()):
            here = f"{path}/{name}"
            if name not in after or name not in was:
                yield f"{here}: only {'after' if name in after else 'before'}"
            else:
                yield from differences(was[name], after[name], renamed, here)
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{path}: {len(before)} before, {len(after)} after"
        for index, (old, new) in enumerate(zip(before, after, strict=False)):
            yield from differences(old, new, renamed, f"{path}/{index}")
    elif not _same(before, after, renamed):
        yield f"{path}: {before!r} before, {after!r} after"


def _same(before: Any, after: Any, renamed: Mapping[str, str]) -> bool:
    if isinstance(before, float) and isinstance(after, float | int):
        if math.isnan(before):
            return math.isnan(after)
        return math.isclose(before, after, rel_tol=TOLERANCE, abs_tol=1e-300)
    if isinstance(before, str):
        return bool(renamed.get(before, before) == after)
    return bool(before == after)
