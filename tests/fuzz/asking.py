"""An input, how it is asked about, and what was said."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from flywheel.cli.main import app
from flywheel.errors import FlywheelError

CODES = (1, 2)  # with which a command ends that says what is wrong


@dataclass(frozen=True)
class Spoilt:
    """An input with something wrong in it.

    Attributes:
      content: bytes of the file.
      file: which of the kind's files it takes the place of.
    """

    content: bytes
    file: str = ""


@dataclass(frozen=True)
class Kind:
    """A kind of input.

    Attributes:
      name: of it.
      good: inputs with nothing wrong in them.
      draw: a spoilt one.
      ask: what became of it, in an empty folder: None if it was taken, else the message.
    """

    name: str
    good: tuple[Spoilt, ...]
    draw: Callable[[random.Random], Spoilt]
    ask: Callable[[Spoilt, Path], str | None]


def command(*words: str) -> str | None:
    """Run a command of `flywheel`; its message where it refuses."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    if done.exit_code == 0:
        return None
    if done.exit_code not in CODES or "Traceback" in done.output:
        raise AssertionError(f"exit code {done.exit_code}\n{done.output}")
    return done.stderr or done.output


def refusal(do: Callable[[], object]) -> str | None:
    """What is said on purpose against something; None if nothing is."""
    try:
        do()
    except FlywheelError as error:
        return str(error)
    return None
