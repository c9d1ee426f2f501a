"""Tests of changed sources: in a copy of the tree, in a process of their own, for a limited time.

What takes long to import is imported once; each trial is forked from there and imports only the tree.
"""

import compileall
import contextlib
import importlib
import math
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
COPIED = (
    "flywheel", "benchmarks", "configs", "pipelines", "tests", "docs", "README.md", "pyproject.toml",
)  # fmt: skip
HEAVY = (
    "numpy", "scipy.spatial.transform", "scipy.optimize", "torch", "torch_geometric", "mujoco", "zarr",
    "numba", "pydantic", "hypothesis", "pytest", "xdist", "typer", "rich", "matplotlib", "plotly",
)  # fmt: skip
PATIENCE = 10.0  # times as long as tests may compute, they may take with waiting
MEMORY = 16 * 2**30  # of address space [bytes]: a mutant may ask for any amount
# How tests end: as pytest says, as `timeout` says, or not having tested the copy at all.
PASSED, FAILED, TIMED_OUT, ELSEWHERE = 0, 1, 124, 70


class Outcome(NamedTuple):
    """How tests ended.

    Attributes:
      code: pytest's exit code, or `TIMED_OUT`.
      seconds: of computing, which does not depend on who else is at work [s].
      printed: by pytest.
    """

    code: int
    seconds: float
    printed: str


class Bench:
    """A copy of a tree to change and to test; gone at the end of the `with` block."""

    def __init__(self, root: Path = ROOT) -> None:
        self._root = root

    def __enter__(self) -> "Bench":
        self._folder = Path(tempfile.mkdtemp(prefix="mutants-"))
        self.tree = self._folder / "tree"
        self.tree.mkdir()
        for whole in (self._root / name for name in COPIED):
            if whole.is_dir():
                skipped = shutil.ignore_patterns("__pycache__")
                shutil.copytree(whole, self.tree / whole.name, ignore=skipped)
            elif whole.exists():
                shutil.copy2(whole, self.tree)
        compileall.compile_dir(self.tree, quiet=1)
        return self

    def __exit__(self, *error: object) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def tested(self, tests: Sequence[str], limit: float, path: str, source: str) -> Outcome:
        """Run tests, with a content of one file that is given.

        Args:
          tests: files, folders or single tests, in their order; up to the first that fails.
          limit: of computing, at which they are ended [s].
          path, source: of the file, and its content.
        """
        file = self.tree / path
        sound = file.read_text()
        for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            compiled.unlink()
        file.write_text(source)
        try:
            return self._run(tests, limit)
        finally:
            file.write_text(sound)

    def _run(self, tests: Sequence[str], limit: float) -> Outcome:
        printed = self._folder / "printed"
        child = os.fork()
        if child == 0:
            _test_here(self.tree, tests, limit, printed, self._folder / "scratch")
        code, seconds = _waited(child, time.monotonic() + PATIENCE * limit)
        return Outcome(code, seconds, printed.read_text() if printed.exists() else "")


def prepare(modules: Sequence[str] = HEAVY) -> None:
    """Import what all trials need."""
    os.environ["OMP_NUM_THREADS"] = "1"  # threads do not survive a fork
    for name in modules:
        importlib.import_module(name)


def _test_here(
    tree: Path, tests: Sequence[str], limit: float, printed: Path, scratch: Path
) -> None:
    """Never returns: ends the process with pytest's exit code."""
    code = FAILED
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 1))
        out = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(out, 1)
        os.dup2(out, 2)
        os.chdir(tree)
        _look_for_modules_in(tree)
        import pytest

        options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", f"--basetemp={scratch}"]
        # its plugins are imported already
        options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        code = int(pytest.main([*options, *tests]))
        package = sys.modules.get("flywheel")
        if package is not None and not str(package.__file__).startswith(str(tree)):
            code = ELSEWHERE
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _look_for_modules_in(tree: Path) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] in COPIED]:
        del sys.modules[name]
    sys.path[:] = [str(tree), *(entry for entry in sys.path if entry not in ("", str(ROOT)))]
    sys.dont_write_bytecode = True  # sources change too quickly for it
    os.environ |= {"PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}


def _waited(child: int, until: float) -> tuple[int, float]:
    """Exit code of a child, and how long it computed [s].

    It is ended when its time is over or ours is, with all that it has started.
    """
    try:
        while time.monotonic() < until:
            done, status, used = os.wait4(child, os.WNOHANG)
            if done:
                code = os.waitstatus_to_exitcode(status)
                seconds = used.ru_utime + used.ru_stime
                return (TIMED_OUT if code == -signal.SIGXCPU else code), seconds
            time.sleep(0.02)
        return TIMED_OUT, math.nan
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(child, 0)
