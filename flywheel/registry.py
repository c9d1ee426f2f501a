"""Lookup of a name in a registry, or among others."""

from collections.abc import Iterable, Mapping
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
    known = ", ".join(sorted(table))
    raise UnknownNameError(f"There is no {kind} {name!r}. Known: {known}.{nearest(name, table)}")


def nearest(name: str, known: Iterable[str]) -> str:
    """A sentence with the known name that is most like another one, in whatever case; "" without any."""
    cases = {each.lower(): each for each in known}
    found = get_close_matches(name.lower(), cases, n=1)
    return f" Did you mean {cases[found[0]]!r}?" if found else ""
