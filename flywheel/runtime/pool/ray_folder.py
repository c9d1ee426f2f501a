"""The temporary folder of a Ray that a command starts: its own, short enough, and gone afterwards."""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flywheel.errors import ConfigError, FlywheelError, RunError
from flywheel.outputs import check_folder
from flywheel.runtime.pool.caretaker import MARK, Caretaker, remove
from flywheel.runtime.pool.lock import hold

PREFIX = "flywheel-ray-"
LOCK_FILE = "driver.lock"
# Of a Unix socket's path, 107 bytes, Ray takes "/session_<date>_<time>_<pid>/sockets/plasma_store".
LONGEST = 42  # bytes of the folder's path
YOUNG = 60.0  # a folder of another driver that is only just being made [s]


@contextmanager
def ray_folder() -> Iterator[Path]:
    """A folder for as long as the block lasts; a `Caretaker` removes it even if this process is killed.

    Processes that are started while the block begins belong to it. Folders that killed drivers left are
    removed before.

    Raises:
      RunError: no temporary folder has a short enough path, or none can be written.
    """
    place = _place()
    sweep(place)
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=place))
    with Caretaker(folder), hold(folder / LOCK_FILE, f"The folder {folder}"):
        yield folder


@contextmanager
def marking(folder: Path) -> Iterator[None]:
    """Processes that are started in the block belong to the folder."""
    os.environ[MARK] = str(folder)
    try:
        yield
    finally:
        del os.environ[MARK]


def sweep(place: Path) -> None:
    """Remove the folders of drivers that are gone, with processes that are still there."""
    for folder in place.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError, ConfigError):  # of another user; gone meanwhile; in use
            about = folder.lstat()
            young = time.time() - about.st_mtime < YOUNG
            if about.st_uid != os.getuid() or young or not (folder / LOCK_FILE).is_file():
                continue
            with hold(folder / LOCK_FILE, f"The folder {folder}"):
                remove(folder, grace=0.0)


def _place() -> Path:
    """Where temporary folders go: as Ray and Python are told, or as all systems have it."""
    named = [os.environ.get("RAY_TMPDIR"), tempfile.gettempdir(), Path(os.sep, "tmp")]
    refused = []
    for place in dict.fromkeys(Path(name).absolute() for name in named if name):
        try:
            if len(os.fsencode(place / f"{PREFIX}12345678")) > LONGEST:
                raise ConfigError(f"The path {place} is too long for Ray's sockets.")
            check_folder(place, "temporary folder of Ray")
            return place
        except FlywheelError as error:
            refused.append(str(error))
    raise RunError(f"Ray finds no temporary folder; set RAY_TMPDIR to one. {' '.join(refused)}")
