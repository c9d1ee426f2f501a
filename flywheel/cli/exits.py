"""End of a command: one clear message, and an exit code for scripts.

`Commands` is the only place that turns an error into both. Errors of this package and of the
operating system become sentences; anything else is a bug of ours, whose traceback goes to a file in
the system's temporary folder.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import platform
import select
import shlex
import signal
import stat
import sys
import tempfile
import threading
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

FAILED = 1  # a check did not pass, or a run could not go on
USAGE = 2  # bad usage or bad input
BUG = 70  # EX_SOFTWARE of sysexits.h: an error that nobody foresaw
INTERRUPTED = 130  # stopped by Ctrl-C, SIGTERM or the end of its terminal; finished work is kept
NOBODY_READS = 141  # as of a program that SIGPIPE ended: `flywheel list runs | head -1`

CODES = """\
[bold]Exit codes:[/bold] 0 all is well, 1 a check failed or a run could not go on, \
2 bad usage or input, 70 a bug of flywheel (the message says where its traceback is), \
130 interrupted (finished work is kept)."""
TORCH_HAS_NO_MEMORY = ("can't allocate memory", "CUDA out of memory")  # in a RuntimeError


@dataclass(frozen=True)
class Ending:
    """End of a failed command.

    Attributes:
      code: of the exit.
      message: for people.
    """

    code: int
    message: str


class Commands(TyperGroup):
    """Turns every error of a command into a message and an exit code."""

    def invoke(self, ctx: Any) -> Any:
        """Run the given command."""
        with clear_endings(bool(ctx.params.get("debug"))):
            return super().invoke(ctx)


class Command(TyperCommand):
    """A command that refuses empty arguments, and values that a later one would replace."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line."""
        if any("\0" in argument for argument in args):
            raise typer.BadParameter("An argument contains a zero character (NUL).")
        if "" in args:
            raise typer.BadParameter("An argument is empty: is a variable of the shell not set?")
        order: list[Any] = self.make_parser(ctx).parse_args(list(args))[2]
        for option, times in Counter(order).items():
            if times == 1 or option.multiple:
                continue
            if not option.is_flag or option.secondary_opts:  # another flag may say so twice
                raise typer.BadParameter(
                    f"It is given {times} times; it takes one value.", ctx, option
                )
        return super().parse_args(ctx, args)


class OneCommand(Command):
    """A separate command whose errors become a message and an exit code."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with clear_endings():
            return super().invoke(ctx)


@contextlib.contextmanager
def clear_endings(debug: bool = False) -> Iterator[None]:
    """Turn every error of the block into a message and an exit code.

    Args:
      debug: also show where an error was raised.
    """
    from flywheel.errors import FlywheelError
    from flywheel.runtime.pool.interrupts import caught

    asked = False

    def interrupt() -> None:
        nonlocal asked
        asked = True
        raise KeyboardInterrupt

    try:
        with _quiet(debug), caught(interrupt):
            yield
    except (typer.Exit, typer.Abort, TyperException):
        raise
    except SystemExit as error:
        if error.code != signal.SIGTERM:  # Ray makes this of SIGTERM while it starts
            raise
        _say("interrupted")
        raise typer.Exit(INTERRUPTED) from None
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, BrokenPipeError) and _nobody_reads():
            raise typer.Exit(NOBODY_READS) from None
        if debug:
            typer.echo(_trace(error), err=True)
        if asked and not isinstance(error, (FlywheelError, OSError)):
            error = (
                KeyboardInterrupt()
            )  # a module that is being imported makes an ImportError of it
        ending = ending_of(error)
        _say(ending.message)
        raise typer.Exit(ending.code) from None


def ending_of(error: BaseException) -> Ending:
    """The message about an error, and the exit code for its kind."""
    from flywheel.errors import FlywheelError
    from flywheel.faults import fault_of, told
    from flywheel.runtime.pool.jobs import JobFailed

    if isinstance(error, KeyboardInterrupt):
        return Ending(INTERRUPTED, str(error) or "interrupted")
    cause = error.__cause__ or error if isinstance(error, JobFailed) else error
    if isinstance(cause, FlywheelError) and not isinstance(cause, JobFailed):
        return Ending(exit_code(cause), str(cause))
    if isinstance(cause, OSError) and (fault := fault_of(cause)):
        return Ending(USAGE if fault.by_input else FAILED, told(cause))
    if isinstance(cause, MemoryError) or any(said in str(cause) for said in TORCH_HAS_NO_MEMORY):
        return Ending(
            FAILED,
            "This needs more memory than is available. Stored data are complete. Request less at "
            "once (shorter logs, fewer workers or samples), or use a larger machine.",
        )
    if isinstance(cause, RecursionError):
        return Ending(USAGE, "Something in the input is nested too deeply, or contains itself.")
    return Ending(BUG, _bug(error, cause))


def exit_code(error: Exception) -> int:
    """The exit code for an error of this package."""
    from flywheel.errors import ModelError, RunError, WeightsError
    from flywheel.runtime.pool.interrupts import Interrupted
    from flywheel.runtime.pool.jobs import WorkerDied

    if isinstance(error, Interrupted):
        return INTERRUPTED
    failed = isinstance(error, (RunError, ModelError, WorkerDied))
    return FAILED if failed and not isinstance(error, WeightsError) else USAGE


def _bug(error: BaseException, cause: BaseException) -> str:
    from flywheel.runtime.pool.jobs import JobFailed

    what = str(cause) if isinstance(cause, JobFailed) else f"{type(cause).__name__}: {cause}"
    words = f"This is a bug of flywheel: {what}"
    report = _report(error)
    if (file := _kept(report)) is None:
        return f"{words}\n{report}"
    return (
        f"{words}\nThe traceback is in {file}; please report it with that file. --debug shows "
        "it here."
    )


def _report(error: BaseException) -> str:
    """Information for finding a bug."""
    from flywheel import __version__

    about = f"flywheel {__version__}, Python {platform.python_version()}, {platform.platform()}"
    return f"{about}\n{shlex.join(sys.argv)}\n\n{_trace(error)}"


def _trace(error: BaseException) -> str:
    """The place at which an error was raised, in a worker too."""
    here = "".join(traceback.format_exception(error))
    return f"{here}\n{getattr(error, 'trace', '')}".rstrip() + "\n"


def _kept(report: str) -> Path | None:
    """The file in the system's temporary folder with a report; None if there is no room."""
    try:
        folder = Path(tempfile.gettempdir())
        if folder == Path.cwd() and not folder.stat().st_mode & stat.S_ISVTX:
            return (
                None  # what Python takes where no temporary folder can be written: the user's own
            )
        handle, name = tempfile.mkstemp(prefix="flywheel-crash-", suffix=".txt", dir=folder)
    except OSError:
        return None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(report)
    except OSError:
        with contextlib.suppress(OSError):
            Path(name).unlink()
        return None
    return Path(name)


def end_if_stopped(stop: Callable[[], bool], result: str) -> None:
    """End a command whose result is the best one so far, if it was stopped.

    Args:
      stop: the wish to stop.
      result: in words.

    Raises:
      typer.Exit: it was stopped; with `INTERRUPTED`.
    """
    if stop():
        _say(f"interrupted: {result}")
        raise typer.Exit(INTERRUPTED)


def _say(message: str) -> None:
    from flywheel.outputs import printable

    with contextlib.suppress(OSError):  # nobody is left to read it
        typer.secho(f"flywheel: {printable(message)}", err=True, fg=typer.colors.RED)


@contextlib.contextmanager
def _quiet(debug: bool) -> Iterator[None]:
    """Hide warnings for programmers and tracebacks of threads."""
    sys.stdout, sys.stderr = _patient(sys.stdout), _patient(sys.stderr)
    before = threading.excepthook
    if not debug:
        threading.excepthook = _thread_ended
        if not sys.warnoptions:
            warnings.filterwarnings("ignore", append=True)
    try:
        yield
    finally:
        threading.excepthook = before


class _Terminal(io.FileIO):
    """A terminal that may close: the rest of the output then goes nowhere, and the command goes on."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
            return len(data)


def _patient(stream: Any) -> Any:
    """The stream, for names that the terminal's encoding lacks, and for a terminal that closes."""
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.reconfigure(errors="backslashreplace")
    if not stream.isatty():
        return stream
    raw = io.BufferedWriter(_Terminal(stream.fileno(), "w", closefd=False))
    return io.TextIOWrapper(raw, stream.encoding, stream.errors, line_buffering=True)


def _thread_ended(failed: threading.ExceptHookArgs) -> None:
    """An error in a thread does not end the command; it is reported."""
    if isinstance(failed.exc_value, Exception):
        _say(ending_of(failed.exc_value).message)


def _nobody_reads() -> bool:
    """True if the reader of the output is gone; further output is then discarded."""
    gone = [stream for stream in (sys.stdout, sys.stderr) if _broken(stream)]
    for stream in gone:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
    return bool(gone)


def _broken(stream: Any) -> bool:
    try:
        asked = select.poll()
        asked.register(stream.fileno(), select.POLLERR)
        return any(event & select.POLLERR for _, event in asked.poll(0))
    except (AttributeError, OSError, ValueError):  # closed, or no file
        return False
