"""However a process ends, what it started ends too, and its temporary folder goes."""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flywheel.errors import RunError
from flywheel.runtime.pool import ray_backend as module
from flywheel.runtime.pool.caretaker import MARK, Caretaker, marked, remove
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.pool.ray_backend import FOLDER_LOCK, FOLDER_PREFIX, ray_folder, sweep

DRIVER = """
import subprocess, sys, time
from flywheel.runtime.pool.ray_backend import marking, ray_folder
with ray_folder() as folder:
    with marking(folder):
        helper = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(600)"])
    print(folder, helper.pid, flush=True)
    sys.stdin.read()
"""


def within(seconds: float, true: Callable[[], bool]) -> bool:
    limit = time.monotonic() + seconds
    while not true() and time.monotonic() < limit:
        time.sleep(0.05)
    return true()


def gone(pid: int) -> bool:
    """It is not there, or only waits for its parent to notice."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def sleeper(folder: Path | None = None, **options: object) -> subprocess.Popen[bytes]:
    """A process that sleeps, marked with a folder."""
    mark = {} if folder is None else {MARK: str(folder)}
    command = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
    return subprocess.Popen(command, env={**os.environ, **mark}, **options)


@pytest.fixture
def temporary(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A temporary folder of the system with a short path, for tests alone."""
    with tempfile.TemporaryDirectory(prefix="t") as folder:
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.setenv("TMPDIR", folder)
        yield Path(folder)


@pytest.fixture
def driver(temporary: Path) -> Iterator[subprocess.Popen[str]]:
    """A process with such a folder and a helper that would sleep on."""
    command = [sys.executable, "-c", DRIVER]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes, start_new_session=True) as running:  # type: ignore[call-overload]
        yield running
        with contextlib.suppress(ProcessLookupError):
            os.killpg(running.pid, signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, None], ids=str)
def test_nothing_is_left_of_a_driver_however_it_ends(driver, end):
    folder, helper = driver.stdout.readline().split()
    assert Path(folder).is_dir()
    # /proc shows no environment until a program that was just started is loaded
    assert within(10, lambda: list(marked(Path(folder))) == [int(helper)])
    if end is None:
        driver.stdin.close()
    else:
        os.kill(driver.pid, end)
    driver.wait(20)
    assert within(10, lambda: gone(int(helper)) and not Path(folder).exists())


def test_the_folder_is_gone_when_the_block_has_ended(temporary):
    with ray_folder() as folder:
        assert folder.parent == temporary
        (folder / "session").mkdir()
    assert list(temporary.iterdir()) == []
    with pytest.raises(ZeroDivisionError), ray_folder():
        raise ZeroDivisionError
    assert list(temporary.iterdir()) == []


def left(place: Path, name: str, age: float = 3600.0) -> Path:
    """A folder as a killed driver, and its killed caretaker, left it."""
    folder = place / f"{FOLDER_PREFIX}{name}"
    folder.mkdir()
    (folder / FOLDER_LOCK).touch()
    os.utime(folder, (time.time() - age,) * 2)
    return folder


def test_what_killed_drivers_left_is_removed_at_the_next_start_and_nothing_else(temporary):
    dead, used, young = left(temporary, "dead"), left(temporary, "used"), left(temporary, "new", 1)
    own = temporary / f"{FOLDER_PREFIX}of-somebody"  # no lock: not one of ours
    own.mkdir()
    os.utime(own, (0, 0))
    other = temporary / "flywheel-runs"
    other.mkdir()
    helper, stranger = sleeper(dead), sleeper(used)
    try:
        with hold(used / FOLDER_LOCK, "it"):
            os.utime(used, (0, 0))
            sweep(temporary)
        assert within(5, lambda: helper.poll() is not None)
        assert stranger.poll() is None
        assert {p.name for p in temporary.iterdir()} == {p.name for p in (used, young, own, other)}
    finally:
        for process in (helper, stranger):
            process.kill()
            process.wait()


def test_processes_get_some_time_to_end_by_themselves(tmp_path):
    folder = tmp_path / "f"
    folder.mkdir()
    polite = subprocess.Popen(
        [sys.executable, "-S", "-c", "import time; time.sleep(0.3)"],
        env={**os.environ, MARK: str(folder)},
    )
    remove(folder, grace=10.0)
    assert polite.wait() == 0
    assert not folder.exists()


def test_a_folder_with_too_long_a_path_for_sockets_is_not_taken(temporary, monkeypatch):
    long = temporary / ("long" * 10)
    long.mkdir()
    monkeypatch.setenv("RAY_TMPDIR", str(long))
    with ray_folder() as folder:
        assert folder.parent == temporary
    monkeypatch.setattr(module, "LONGEST_FOLDER", 5)
    with pytest.raises(RunError, match=r"too long.*RAY_TMPDIR|RAY_TMPDIR.*too long"):
        module.ray_folder().__enter__()
    assert [p.name for p in temporary.iterdir()] == [long.name]


@pytest.mark.parametrize("deaf", [False, True])
@pytest.mark.slow
def test_a_group_is_ended_with_the_children_that_outlive_its_leader(deaf):
    child = "import signal, time\n"
    child += "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n" if deaf else ""
    child += "print(1, flush=True); time.sleep(600)"
    leader = f"import subprocess, sys; subprocess.run([sys.executable, '-S', '-c', {child!r}])"
    group = subprocess.Popen(
        [sys.executable, "-S", "-c", leader], stdout=subprocess.PIPE, start_new_session=True
    )
    assert group.stdout is not None
    group.stdout.readline()
    with Caretaker(group=group.pid):
        group.terminate()
        group.wait()
    assert group.stdout.read() == b"", "nobody holds the pipe any more"
    group.stdout.close()
