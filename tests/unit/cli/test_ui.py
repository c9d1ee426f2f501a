"""`flywheel ui`: the server ends with it, and what cannot be served is said at once."""

import errno
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.cli.runs.ui import check_port
from flywheel.errors import ConfigError
from flywheel.runtime.tracking.dashboard import DATABASE, damage

ROOT = Path(__file__).parents[3]
SERVER = "import subprocess, sys; subprocess.run([sys.executable, '-S', sys.argv[1]])"
CHILD = "import os, time; print(os.getpid(), os.getppid(), flush=True); time.sleep(600)"
UI = """
import sys
from flywheel.cli.runs import ui
from flywheel.cli.main import app
ui.ui_command = lambda run, port: ([sys.executable, "-S", "-c", sys.argv[1], sys.argv[2]], {}, "url")
app(["ui", sys.argv[3]])
"""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder with a sound database."""
    with closing(sqlite3.connect(tmp_path / DATABASE)) as database:
        database.execute("CREATE TABLE a (b)")
        database.executemany("INSERT INTO a VALUES (?)", [("x" * 500,)] * 100)
        database.commit()
    return tmp_path


def alive(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


@contextmanager
def started(command: Sequence[object]) -> Iterator[subprocess.Popen[str]]:
    """A command, which ends with the block; its caretaker then ends the server."""
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(command, cwd=ROOT, **quiet) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "code"), [("SIGTERM", 130), ("SIGHUP", 130), ("SIGINT", 130), ("SIGKILL", -9)]
)
def test_the_server_and_its_children_end_with_the_command(run, end, code):
    child = run / "child.py"
    child.write_text(CHILD)
    with started([sys.executable, "-c", UI, SERVER, child, run]) as served:
        assert served.stdout is not None
        assert served.stdout.readline().startswith("Open url")
        pids = [int(pid) for pid in served.stdout.readline().split()]
        assert all(map(alive, pids))
        served.send_signal(signal.Signals[end])
        assert served.wait(20) == code
        limit = time.monotonic() + 10
        while any(map(alive, pids)) and time.monotonic() < limit:
            time.sleep(0.05)
        assert not any(map(alive, pids))


@pytest.mark.nightly
@pytest.mark.slow
def test_the_server_of_mlflow_ends_with_the_command(run):
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    command = [sys.executable, "-m", "flywheel.cli", "ui", str(run), "--port", str(port)]
    with started(command) as served:
        limit = time.monotonic() + 120
        while not listens(port):
            assert served.poll() is None and time.monotonic() < limit
            time.sleep(0.2)
        processes = [int(entry.name) for entry in Path("/proc").glob("[0-9]*")]
        pids = [pid for pid in processes if serves(pid, run)]
        assert len(pids) >= 2, "MLflow's server has a child"
        served.send_signal(signal.SIGTERM)
        assert served.wait(30) == 130
        limit = time.monotonic() + 10
        while any(map(alive, pids)) and time.monotonic() < limit:
            time.sleep(0.05)
        assert not any(map(alive, pids))
        assert not listens(port)


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def serves(pid: int, run: Path) -> bool:
    """Whether a process, other than the command, has the run's database on its command line or inherited."""
    try:
        return str(run / DATABASE).encode() in (
            Path(f"/proc/{pid}/cmdline").read_bytes() + Path(f"/proc/{pid}/environ").read_bytes()
        )
    except OSError:
        return False


def test_a_server_ends_where_its_caretaker_is_interrupted(run, monkeypatch):
    started = []

    def interrupted(group: int) -> None:
        started.append(group)
        raise KeyboardInterrupt

    command = ([sys.executable, "-S", "-c", "import time; time.sleep(600)"], {}, "url")
    monkeypatch.setattr("flywheel.cli.runs.ui.ui_command", lambda *_: command)
    monkeypatch.setattr("flywheel.cli.runs.ui.Caretaker", interrupted)
    assert CliRunner().invoke(app, ["ui", str(run)]).exit_code == 130
    assert not alive(started[0])


def test_a_server_that_ends_by_itself_is_told(run, monkeypatch):
    command = ([sys.executable, "-c", "raise SystemExit(3)"], {}, "url")
    monkeypatch.setattr("flywheel.cli.runs.ui.ui_command", lambda *_: command)
    done = CliRunner().invoke(app, ["ui", str(run)])
    assert done.exit_code == 1
    assert "ended by itself, with the exit code 3" in done.stderr


def test_a_port_that_is_in_use_is_bad_usage(run):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        done = CliRunner().invoke(app, ["ui", str(run), "--port", str(port)])
    assert done.exit_code == 2
    assert f"port {port}: Another program uses this port. Name another port." in done.stderr


@pytest.mark.parametrize("port", ["0", "70000", "-1", "x"])
def test_what_is_no_port_is_bad_usage(port, run):
    assert CliRunner().invoke(app, ["ui", str(run), "--port", port]).exit_code == 2


def test_a_port_for_root_alone_is_told(monkeypatch):
    def forbidden(*_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(socket.socket, "bind", forbidden)
    with pytest.raises(ConfigError, match="port 80: only root may use ports below 1024"):
        check_port(80)


@pytest.mark.parametrize("name", ["a?b", "a%20b"])
def test_a_folder_that_mlflow_would_take_for_another_is_refused(tmp_path, name):
    for command in (f"run {ROOT}/configs/smoke.yaml --folder", "ui"):
        folder = tmp_path / name
        if command == "ui":
            folder.mkdir()
            (folder / DATABASE).touch()
        done = CliRunner().invoke(app, [*command.split(), str(folder)])
        assert done.exit_code == 2
        assert f"its path contains a '{name[1]}'" in done.stderr
        assert [p.name for p in tmp_path.iterdir()] == ([name] if command == "ui" else [])


def test_a_database_that_is_damaged_is_not_served_and_what_to_do_is_said(run):
    path = run / DATABASE
    assert damage(path) == ""
    assert damage(run / "none.db") == ""
    whole = path.read_bytes()
    for content in (whole[:3000], whole[:5000] + bytes(len(whole) - 5000), bytes(4096), b"no"):
        path.write_bytes(content)
        done = CliRunner().invoke(app, ["ui", str(run)])
        assert done.exit_code == 2
        assert "is damaged: " in done.stderr
        assert "--resume makes a new one" in done.stderr
        assert done.stderr.count("\n") == 1
    path.unlink()
    path.mkdir()
    assert "it is no file" in CliRunner().invoke(app, ["ui", str(run)]).stderr
