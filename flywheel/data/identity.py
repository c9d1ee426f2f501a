"""Which store segments and snapshots belong to: every store has an id of its own, kept in `store.json`.

What is sealed in a store names that id. So what was copied in from elsewhere is known as foreign, and
a lost `store.json` is read off what is there. Stores of before have none; what lies in them is nameless.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from flywheel.data.places import Place
from flywheel.errors import DataError
from flywheel.seals import Seal, Unsound, check_seal, sealed, unsealed

STORE_FILE = "store.json"
_WHAT = "The file store.json"


@dataclass(frozen=True)
class StoreIdentity:
    """Identity of a store.

    Attributes:
      id: unique.
      older: it was begun before there were seals, so that what has none may be its own.
    """

    id: str
    older: bool


class Ownership:
    """Tells what is a store's own.

    Args:
      place: of the store.
      url: of it, for messages.
      owners: ids in all receipts and manifests that can be read; "" of those without a seal.
    """

    def __init__(self, place: Place, url: str, owners: Callable[[], Iterable[str]]) -> None:
        self._place, self._url, self._owners = place, url, owners
        self._known: StoreIdentity | None = None
        self._seen: set[str] | None = None

    def id(self) -> str:
        """Id of the store; an empty store is given one, durably.

        Raises:
          Unsound: it cannot be told.
        """
        if (there := self.noted()) is not None:
            return there.id
        found = self.inferred() or StoreIdentity(uuid.uuid4().hex, older=bool(self._seen))
        text = sealed({"older": found.older}, Seal("store", "store", found.id))
        if not self._place.put_new(STORE_FILE, text):  # another writer has made it in the meantime
            return self.id()
        return found.id

    def noted(self) -> StoreIdentity | None:
        """What `store.json` says; None if there is none.

        Raises:
          Unsound: it was altered.
        """
        if self._known is None:
            try:
                self._known = _read(self._place.read(STORE_FILE))
            except FileNotFoundError:
                return None
            except Unsound:
                raise
            except DataError as error:
                raise Unsound(f"{_WHAT} cannot be read: {error}", "unreadable") from None
        return self._known

    def check(self, owner: str, what: str) -> None:
        """Refuse what is another store's.

        Args:
          owner: that its seal names; "" where it has none.
          what: it is, at the beginning of a sentence.

        Raises:
          Unsound: it is foreign, or that cannot be told.
        """
        try:
            mine = self.noted()
        except Unsound:  # `verify` tells
            mine = None
        if mine is None and owner:
            mine = self.inferred()
        if mine is None or owner == mine.id or (not owner and mine.older):
            return
        if owner:
            words = f"is of another store ({owner[:12]}, this one is {mine.id[:12]})"
        else:
            words = "has no seal: it is of a store of before, and this one is none"
        raise Unsound(f"{what} {words}.", "foreign")

    def inferred(self) -> StoreIdentity | None:
        """Identity of the store inferred from its seals; None if nothing has a seal.

        Raises:
          Unsound: it is of several stores.
        """
        if self._seen is None:
            self._seen = set(self._owners())
        sealing = sorted(self._seen - {""})
        if len(sealing) > 1:
            words = " and ".join(owner[:12] for owner in sealing)
            raise Unsound(
                f"{STORE_FILE} of {self._url} is missing or damaged, and what lies there is of the "
                f"stores {words}: put back its copy, or set aside what is foreign.",
                "missing",
            )
        return StoreIdentity(sealing[0], "" in self._seen) if sealing else None


def _read(text: bytes) -> StoreIdentity:
    values, seal = unsealed(text, _WHAT)
    if seal is None or not isinstance(values.get("older"), bool):
        raise Unsound(f"{_WHAT} was altered: it does not say whose the store is.")
    check_seal(seal, "store", "store", _WHAT)
    return StoreIdentity(seal.owner, values["older"])
