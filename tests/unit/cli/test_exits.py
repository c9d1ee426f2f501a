"""Every end of a command: one message, the right exit code, and no traceback on the terminal."""

import errno
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from flywheel.cli.exits import BUG, FAILED, USAGE, Commands
from flywheel.cli.main import app
from flywheel.errors import DataError
from flywheel.runtime.pool.jobs import JobFailed

ROOT = Path(__file__).parents[3]


def doing(work) -> typer.Typer:
    """A command of its own, `work`."""
    small = typer.Typer(cls=Commands, pretty_exceptions_enable=False)

    @small.callback()
    def top(debug: bool = False) -> None:
        """The top."""

    @small.command(name="work")
    def command() -> None:
        work()

    return small


def ended_by(error: BaseException, *arguments: str):
    """How a command ends that raises the error."""

    def work() -> None:
        raise error

    return CliRunner().invoke(doing(work), [*arguments, "work"])


def in_worker(cause: Exception) -> JobFailed:
    """What the pool raises for a job that did."""
    failed = JobFailed(f"{type(cause).__name__}: {cause}", trace="in worker 3, line 7")
    failed.__cause__ = cause
    return failed


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The system's temporary folder, not the one that the test stands in."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.mark.parametrize("wrapped", [lambda error: error, in_worker], ids=["here", "in a worker"])
@pytest.mark.parametrize(
    ("number", "code", "words"),
    [
        ("ENOSPC", FAILED, "the disk is full"),
        ("EDQUOT", FAILED, "quota"),
        ("EIO", FAILED, "input/output error"),
        ("EMFILE", FAILED, "too many files are open"),
        ("EROFS", USAGE, "read-only"),
        ("EACCES", USAGE, "no permission"),
        ("EPERM", USAGE, "no permission"),
        ("ENOTDIR", USAGE, "a file stands where a folder is needed"),
        ("EISDIR", USAGE, "a file is needed"),
        ("EEXIST", USAGE, "something of this name exists already"),
        ("ENOENT", USAGE, "no such file"),
        ("ENAMETOOLONG", USAGE, "too long"),
        ("ELOOP", USAGE, "circle"),
        ("ECONNREFUSED", FAILED, "nobody listens"),
    ],
)
def test_what_the_system_refuses_is_a_sentence_with_the_path(
    temporary, number, code, words, wrapped
):
    done = ended_by(wrapped(OSError(getattr(errno, number), "", "runs/a/result.json")))
    assert done.exit_code == code
    assert done.stderr.startswith("flywheel: runs/a/result.json: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MemoryError(), FAILED, "more memory than is available"),
        (RuntimeError("CUDA out of memory. Tried to allocate 2 GiB."), FAILED, "more memory than"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory"), FAILED, "more memory"),
        (RecursionError(), USAGE, "nested too deeply"),
        (SystemExit(signal.SIGTERM), 130, "interrupted"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_what_the_machine_cannot_do_is_a_message(error, code, words):
    done = ended_by(error)
    assert (done.exit_code, done.stderr.count("\n")) == (code, 1)
    assert words in done.stderr


@pytest.mark.parametrize(
    "error",
    [KeyError("x"), EOFError(), OSError(errno.EBADF, "Bad file descriptor"), OSError("odd")],
    ids=repr,
)
def test_what_nobody_foresaw_is_a_bug_with_its_traceback_in_a_file(temporary, error):
    done = ended_by(error)
    assert done.exit_code == BUG
    assert "Traceback" not in done.stderr
    assert f"This is a bug of flywheel: {type(error).__name__}" in done.stderr
    (file,) = temporary.iterdir()
    assert file.name.startswith("flywheel-crash-")
    assert str(file) in done.stderr
    assert "in work\n    raise error" in file.read_text()
    assert shlex.join(sys.argv) in file.read_text()


def test_a_bug_in_a_worker_is_one_too_and_its_traceback_there_is_kept(temporary):
    done = ended_by(in_worker(ZeroDivisionError("division by zero")))
    assert done.exit_code == BUG
    assert "bug of flywheel: ZeroDivisionError: division by zero\n" in done.stderr
    (file,) = temporary.iterdir()
    assert "in worker 3, line 7" in file.read_text()


def test_a_clean_error_in_a_worker_is_told_as_one():
    done = ended_by(in_worker(DataError("ep.csv has no rows.")))
    assert (done.exit_code, done.stderr) == (USAGE, "flywheel: ep.csv has no rows.\n")


def test_where_the_temporary_folder_cannot_be_written_the_traceback_is_shown(tmp_path, monkeypatch):
    def full(**_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def none() -> str:
        raise FileNotFoundError("No usable temporary directory found")

    for name, change in (("mkstemp", full), ("gettempdir", none), ("gettempdir", os.getcwd)):
        with monkeypatch.context() as patch:
            patch.setattr(tempfile, name, change)
            done = ended_by(KeyError("x"))
        assert done.exit_code == BUG
        assert "in work\n    raise error" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["temporary"]


def test_a_disk_that_is_full_in_the_middle_of_the_report_leaves_no_half_of_it(
    temporary, monkeypatch
):
    fdopen = os.fdopen

    def full(handle: int, *arguments: object, **options: object) -> object:
        fdopen(handle).close()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fdopen", full)
    done = ended_by(KeyError("x"))
    assert done.exit_code == BUG
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("error", [KeyError("x"), OSError(errno.EROFS, "", "a"), DataError("no")])
def test_debug_shows_the_traceback_before_the_message(error):
    done = ended_by(error, "--debug")
    assert "in work\n    raise error" in done.stderr
    assert done.stderr.index("Traceback") < done.stderr.index("flywheel: ")


def test_a_thread_that_fails_says_so_in_a_line_and_warnings_are_not_shown(temporary):
    def work() -> None:
        warnings.warn("for programmers", RuntimeWarning, stacklevel=1)
        thread = threading.Thread(target=lambda: {}["x"])
        thread.start()
        thread.join()

    with warnings.catch_warnings():
        warnings.resetwarnings()
        done = CliRunner().invoke(doing(work), ["work"])
    assert done.exit_code == 0
    assert "bug of flywheel: KeyError" in done.stderr
    assert "Traceback" not in done.stderr
    assert "for programmers" not in done.stderr
    assert len(list(temporary.iterdir())) == 1


def test_a_name_in_a_message_neither_steers_the_terminal_nor_is_markup():
    done = ended_by(DataError("There is no log [red]\x1b[2J\udcff.csv."))
    assert done.stderr == "flywheel: There is no log [red]\\x1b[2J\\udcff.csv.\n"


def test_an_argument_with_a_character_of_zero_is_bad_usage():
    done = CliRunner().invoke(app, ["report", "runs/a\0b"])
    assert done.exit_code == 2
    assert "NUL" in re.sub(r"\s+", " ", done.stderr)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("adopt a.json --robot x --robot y", "'--robot': It is given 2 times; it takes one value"),
        (
            "compare a.csv --robot x --fit-starts --no-fit-starts",
            "'--fit-starts': It is given 2 times",
        ),
        ("recordings import a.csv --store s --dt 1 --dt=2", "'--dt': It is given 2 times"),
        ("robot adapt a.xml -o b.xml --output c.xml", "'--output' / '-o': It is given 2 times"),
        ("report ''", "An argument is empty"),
        ("recordings import a.csv --store ''", "An argument is empty"),
    ],
)
def test_what_is_said_twice_or_not_at_all_is_bad_usage(words, said):
    done = CliRunner().invoke(app, shlex.split(words))
    assert done.exit_code == 2
    assert said in re.sub(r"[\s│]+", " ", done.stderr)


def test_a_flag_may_be_said_twice_and_an_option_of_several_values_too(tmp_path):
    missing = str(tmp_path / "a.csv")
    words = ["diagnose", missing, "--robot", "prism3", "--held-out", "b.csv", "--held-out", "c.csv"]
    assert "There is no" in CliRunner().invoke(app, words).stderr
    words = ["robot", "adapt", missing, "--dry-run", "--dry-run"]
    assert "There is no" in CliRunner().invoke(app, words).stderr


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_command_that_is_asked_to_end_tidies_up_and_says_so(tmp_path, ending):
    def work() -> None:
        with tempfile.TemporaryDirectory(dir=tmp_path, prefix="work"):
            signal.raise_signal(ending)

    before = {s: signal.getsignal(s) for s in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)}
    done = CliRunner().invoke(doing(work), ["work"])
    assert (done.exit_code, done.stderr) == (130, "flywheel: interrupted\n")
    assert not list(tmp_path.glob("work*"))
    assert {s: signal.getsignal(s) for s in before} == before


def test_a_signal_that_comes_twice_in_a_moment_does_not_disturb_the_tidying_up():
    tidied = []

    def work() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            signal.raise_signal(signal.SIGTERM)  # as `timeout` sends it
            tidied.append(True)

    done = CliRunner().invoke(doing(work), ["work"])
    assert (done.exit_code, done.stderr, tidied) == (130, "flywheel: interrupted\n", [True])


def test_what_an_interrupted_import_makes_of_the_signal_is_no_bug(temporary):
    def work() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None  # as compiled modules do

    done = CliRunner().invoke(doing(work), ["work"])
    assert (done.exit_code, done.stderr) == (130, "flywheel: interrupted\n")
    assert not list(temporary.iterdir())


HUNG_UP = """
import fcntl, signal, sys, termios, time
from pathlib import Path
import typer
from flywheel.cli.exits import OneCommand
from flywheel.runtime.pool.progress import console_progress

app = typer.Typer(pretty_exceptions_enable=False)

@app.command(cls=OneCommand)
def work(kept: Path, ended: Path) -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    try:
        with console_progress().stage("work", 1.0) as stage:
            while not ended.exists():
                time.sleep(0.05)
    except KeyboardInterrupt:
        kept.write_text("as far as it is")
        raise
    print("done", flush=True)
    kept.write_text("whole")

if len(sys.argv) > 3:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
app(sys.argv[1:3])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ignored", "code", "left"), [([], 130, "as far as it is"), (["SIGHUP"], 0, "whole")]
)
def test_a_command_whose_terminal_closes_ends_in_order_or_goes_on(tmp_path, ignored, code, left):
    kept, ended = tmp_path / "kept", tmp_path / "ended"
    terminal, end = os.openpty()
    streams = dict.fromkeys(("stdin", "stdout", "stderr"), end)
    script = [sys.executable, "-c", HUNG_UP, str(kept), str(ended), *ignored]
    with subprocess.Popen(script, cwd=ROOT, start_new_session=True, **streams) as work:  # type: ignore[call-overload]
        try:
            os.close(end)
            assert os.read(terminal, 100), "the bar is shown"
            os.close(terminal)
            if ignored:
                ended.touch()
            assert work.wait(30) == code
        finally:
            work.kill()
    assert kept.read_text() == left


IMPORTS = """
import os, signal, sys
from flywheel.cli.__main__ import main

class Pressed:
    def find_spec(self, name, *_):
        if name == "flywheel.cli.main":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Pressed())
main()
"""


def test_ctrl_c_while_a_command_is_still_imported_ends_it_without_a_traceback():
    done = subprocess.run([sys.executable, "-c", IMPORTS], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


def test_a_command_started_with_nohup_lives_on():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        done = CliRunner().invoke(doing(lambda: signal.raise_signal(signal.SIGHUP)), ["work"])
    finally:
        signal.signal(signal.SIGHUP, before)
    assert done.exit_code == 0


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "flywheel.cli", *arguments]


@pytest.mark.slow
def test_a_reader_that_has_seen_enough_ends_a_command_without_a_word():
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            command("list", "tasks"), cwd=ROOT, stdout=writer, stderr=subprocess.PIPE, text=True
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.slow
def test_output_that_finds_no_room_is_a_message():
    with Path(os.devnull).with_name("full").open("w") as full:
        done = subprocess.run(
            command("list", "tasks"), cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == FAILED
    assert done.stderr.startswith("flywheel: The disk is full. ")
    assert done.stderr.count("\n") == 1
