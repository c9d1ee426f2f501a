"""Lookup of a name in a registry."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import TypeVar

from flywheel.errors import UnknownNameError

T = TypeVar("T")


def lookup(table: Mapping[str, T], name: str, kind: str) -> T:
    """Return `table[name]`.

    Args:
      table: a registry, e.g. `flywheel.robots.ROBOTS`.
      name: of the entry.
      kind: of the entries, in the singular, for the message ("robot").

    Raises:
      UnknownNameError: no such entry; the message lists the names and the nearest one.
    """
    if name in table:
        return table[name]
    nearest = get_close_matches(name, table, n=1)
    hint = f" Did you mean {nearest[0]!r}?" if nearest else ""
    raise UnknownNameError(f"There is no {kind} {name!r}. Known: {', '.join(sorted(table))}.{hint}")
