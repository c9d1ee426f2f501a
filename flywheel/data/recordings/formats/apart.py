"""Reading in a process of its own, for libraries that end their process on damaged files."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.stream import Contents, Stream
from flywheel.errors import DataError, FlywheelError

LONGEST = 600.0  # [s] of one file
MEMORY = 4 << 30  # [bytes] beside a multiple of the file's size
TIMES_SIZE = 20
REFUSED = 3  # exit code; the message is in standard error


def read_apart(module: str, path: Path) -> Contents:
    """Contents of a file, by a reader of this package.

    Raises:
      DataError: the reader says so, crashes or does not end.
    """
    with tempfile.TemporaryDirectory(prefix="flywheel-") as folder:
        result = Path(folder) / "result.npz"
        # Not `-m`, which warns in standard error of a module that its package imports.
        code = f"import sys; from {__name__} import main; sys.exit(main(*sys.argv[1:]))"
        command = [sys.executable, "-c", code, module, str(path.resolve()), str(result)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
        except subprocess.TimeoutExpired:
            raise DataError(
                f"it is damaged: its reader did not end within {LONGEST:g} s."
            ) from None
        if done.returncode == REFUSED:
            raise DataError(done.stderr.strip())
        if done.returncode or not result.exists():
            raise DataError("it is damaged: its reader ended without a result.")
        return _loaded(result)


def _saved(contents: Contents, result: Path) -> None:
    arrays: dict[str, Any] = {}
    about = []
    for i, stream in enumerate(contents.streams):
        arrays[f"values{i}"] = np.stack(list(stream.columns.values()), axis=1)
        if stream.time is not None:
            arrays[f"time{i}"] = stream.time
        plain = {"length": stream.length, "asks_unit": stream.asks_unit, "angle": stream.angle}
        about.append({"names": list(stream.columns), **plain})
    meta = json.dumps({"streams": about, "notes": contents.notes})
    np.savez(result, meta=np.array(meta), **arrays)


def _loaded(result: Path) -> Contents:
    with np.load(result, allow_pickle=False) as file:
        meta = json.loads(str(file["meta"]))
        streams = []
        for i, about in enumerate(meta["streams"]):
            names, values = about.pop("names"), file[f"values{i}"]
            columns = {name: values[:, k].copy() for k, name in enumerate(names)}
            streams.append(Stream(columns, file.get(f"time{i}", None), **about))
    return Contents(tuple(streams), tuple(meta["notes"]))


def main(module: str, path: str, result: str) -> int:
    """Read a file of a format (its module here) into another file; the exit code."""
    limit = MEMORY + TIMES_SIZE * Path(path).stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    try:
        reader = import_module(f"{__package__}.{module}")
        _saved(reader.read(Path(path), ()), Path(result))
    except (FlywheelError, MemoryError) as error:
        sys.stderr.write(str(error) or "it needs too much memory.")
        return REFUSED
    return 0
