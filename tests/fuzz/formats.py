"""Logs in all formats that are read, with spoilt bytes or lines, given to import and to guess."""

import os
import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any
from unittest.mock import patch

import numpy as np

from flywheel.data.recordings.formats import apart
from tests.fuzz import mutators
from tests.fuzz.asking import Kind, Spoilt, command
from tests.unit.data.recordings.formats import writers
from tests.unit.data.recordings.formats.truth import AXES, made

TIME = np.arange(101) / writers.RATE
SEVERAL = f"files: [{{path: log.bin}}, {writers.MOTORS}]\n{writers.COMMANDS}"
VICON = (
    "markers: {front: 'robot:front', left: 'robot:left', right: 'robot:right'}\n"
    "commands: {winch_fl: 'Motor - Rate.winch_fl', winch_fr: 'Motor - Rate.winch_fr',\n"
    "  rear: {from: 'Motor - Rate.rear', unit: m}}\n"
)
MAPS = writers.MAPS | {
    "motive": SEVERAL + AXES + "poses: {platform: Platform}\n",
    "vicon": VICON,
    "qualisys": SEVERAL,
    "trc": SEVERAL,
}
READERS = ("scipy.io", "h5py", "ezc3d")  # slow to import in each process that reads apart
LONGEST = 60  # [s] that a hanging reader stays
GUESSED = 4  # one of so many is given to guess


def log_formats(work: Path) -> Kind:
    """Logs of the formats whose packages are installed; one file of each is spoilt, or its map."""
    kinds = [kind for kind in MAPS if find_spec(writers.NEEDS.get(kind, "numpy"))]
    for reader in filter(find_spec, READERS):
        import_module(reader)
    folders = {kind: _written(work / "formats" / kind, kind) for kind in kinds}
    files = {
        kind: sorted(p for p in folder.rglob("*") if p.is_file())
        for kind, folder in folders.items()
    }

    def draw(rng: random.Random) -> Spoilt:
        kind = rng.choice(kinds)
        file = rng.choice([f for f in files[kind] if f.name != "motors.txt"])
        name = f"{kind}/{file.relative_to(folders[kind])}"
        return Spoilt(mutators.of_bytes(file.read_bytes(), rng), name)

    def ask(spoilt: Spoilt, inside: Path) -> str | None:
        kind, _, file = spoilt.file.partition("/")
        shutil.copytree(folders[kind], inside, dirs_exist_ok=True)
        (inside / file).write_bytes(spoilt.content)
        with patch.object(apart.subprocess, "run", _forked):
            return _asked(kind, spoilt)

    good = [
        Spoilt((folder / "map.yaml").read_bytes(), f"{kind}/map.yaml")
        for kind, folder in folders.items()
    ]
    return Kind("formats", tuple(good), draw, ask)


def _asked(kind: str, spoilt: Spoilt) -> str | None:
    log = writers.log_name(kind)
    if len(spoilt.content) % GUESSED == 0:
        return command("recordings", "guess", log, "--robot", "platform4")
    asked = ("--robot", "platform4", "--store", "st", "--dry-run", "--map", "map.yaml")
    files = "files:" in MAPS[kind]
    return command("recordings", "import", *([] if files else [log]), *asked)


def _forked(command: Sequence[str], **_: Any) -> subprocess.CompletedProcess[str]:
    """Done as by a new process, which would import everything again for each input."""
    with TemporaryFile("w+") as said:
        if not (child := os.fork()):
            signal.alarm(LONGEST)
            sys.stderr, code = said, 1
            try:
                code = apart.main(*command[3:])
            finally:
                said.flush()
                os._exit(code)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        said.seek(0)
        return subprocess.CompletedProcess(command, code, "", said.read())


def _written(folder: Path, kind: str) -> Path:
    """The folder with the log of a format, its map, and the motors beside it."""
    if not folder.exists():
        folder.mkdir(parents=True)
        truth = made(2.0)
        getattr(writers, kind)(truth, folder / writers.log_name(kind), TIME)
        writers.motors(truth, folder / "motors.txt", TIME)
        (folder / "map.yaml").write_text(MAPS[kind])
    return folder
