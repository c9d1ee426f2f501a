"""The identity of a run: the file run.json, whose key is in the seal of every other file of the run."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from flywheel.errors import DataError
from flywheel.files import read_bytes, shown
from flywheel.seals import Seal, Unsound, check_seal, file_sha256, sealed, unsealed
from flywheel.validation import Frozen

RUN_FILE = "run.json"
RUN = "run"
HOW = "Restore a copy of it, or start a new run in another folder."


class Identity(Frozen):
    """The identity of a run.

    Attributes:
      key: unique; identifies the run at MLflow.
      config_digest: of the configuration's part that determines the results.
      begun: local time.
    """

    key: str
    config_digest: str
    begun: str


@dataclass(frozen=True)
class Begun:
    """The contents of run.json.

    Attributes:
      identity: of the run.
      files: name -> sha256 of the files that it was begun with.
    """

    identity: Identity
    files: dict[str, str]

    def check(self, folder: Path, name: str) -> None:
        """Check a file against its digest at the start of the run.

        Raises:
          Unsound: it was altered, or is missing.
        """
        path = folder / name
        try:
            same = name not in self.files or file_sha256(path, "file") == self.files[name]
        except Unsound as error:
            raise Unsound(f"{error} {HOW}", error.kind) from None
        if not same:
            raise Unsound(f"The file {path} was altered since the start of the run. {HOW}")


def write_identity(folder: Path, identity: Identity, files: dict[str, str]) -> None:
    """Write run.json."""
    text = sealed(identity.model_dump(mode="json"), Seal(RUN, RUN, identity.key, files))
    (folder / RUN_FILE).write_bytes(text)


def read_begun(folder: Path) -> Begun:
    """Read run.json.

    Raises:
      Unsound: it is missing, or was altered.
    """
    try:
        return _read(folder / RUN_FILE)
    except Unsound as error:
        raise Unsound(f"{error} {HOW}", error.kind) from None


def _read(path: Path) -> Begun:
    try:
        text = read_bytes(path, "file", DataError)
    except DataError as error:
        raise Unsound(str(error), "altered" if os.path.lexists(path) else "missing") from None
    values, seal = unsealed(text, f"The file {path}")
    try:
        identity = Identity.model_validate(values)
    except ValidationError:
        raise Unsound(
            f"The file {path} does not identify the run: it contains {shown(values)}."
        ) from None
    check_seal(seal, RUN, RUN, f"The file {path}")
    return Begun(identity, dict(seal.rests_on))
