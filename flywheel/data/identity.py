"""Owner of segments and snapshots: every store has its own id, kept in `store.json`.

Seals in a store contain that id. Copies from elsewhere are therefore recognised as foreign, and a
lost `store.json` is reconstructed.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterable

from flywheel.data.places import Place
from flywheel.errors import DataError
from flywheel.seals import Seal, Unsound, check_seal, sealed, unsealed

STORE_FILE = "store.json"
_WHAT = "The file store.json"


class Ownership:
    """Recognises a store's own files.

    Args:
      place: of the store.
      url: of it, for messages.
      owners: ids in all receipts and manifests that can be read.
    """

    def __init__(self, place: Place, url: str, owners: Callable[[], Iterable[str]]) -> None:
        self._place, self._url, self._owners = place, url, owners
        self._known: str | None = None
        self._seen: set[str] | None = None

    def id(self) -> str:
        """Id of the store; an empty store gets one, durably.

        Raises:
          Unsound: it is unknown.
        """
        if (there := self.noted()) is not None:
            return there
        found = self.inferred() or uuid.uuid4().hex
        text = sealed({}, Seal("store", "store", found))
        if not self._place.put_new(STORE_FILE, text):  # another writer has made it in the meantime
            return self.id()
        return found

    def noted(self) -> str | None:
        """The id in `store.json`; None if there is none.

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
                raise Unsound(f"{_WHAT} cannot be read: {error}") from None
        return self._known

    def check(self, owner: str, what: str) -> None:
        """Reject another store's file.

        Args:
          owner: from its seal.
          what: its name, at the beginning of a sentence.

        Raises:
          Unsound: it is foreign, or its owner is unknown.
        """
        try:
            mine = self.noted()
        except Unsound:  # `verify` tells
            mine = None
        mine = mine or self.inferred()
        if mine not in (None, owner):
            words = f"is of another store ({owner[:12]}, this one is {str(mine)[:12]})"
            raise Unsound(f"{what} {words}.", "foreign")

    def inferred(self) -> str | None:
        """The id of the store inferred from its seals; None if it is empty.

        Raises:
          Unsound: it is of several stores.
        """
        if self._seen is None:
            self._seen = set(self._owners())
        sealing = sorted(self._seen)
        if len(sealing) > 1:
            words = " and ".join(owner[:12] for owner in sealing)
            raise Unsound(
                f"{STORE_FILE} of {self._url} is missing or damaged, and the files there belong "
                f"to the stores {words}: restore its copy, or set foreign files aside.",
                "missing",
            )
        return sealing[0] if sealing else None


def _read(text: bytes) -> str:
    _, seal = unsealed(text, _WHAT)
    check_seal(seal, "store", "store", _WHAT)
    return seal.owner
