"""Errors of the operating system, in words."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from dataclasses import dataclass

LONGEST_PATH = 200  # characters of a path in a message; its middle is left out


@dataclass(frozen=True)
class Fault:
    """Meaning of a system error number for the user.

    Attributes:
      words: the fault, as a sentence without its first capital and its full stop.
      advice: remedy, as a sentence.
      by_input: True if the input is the cause, rather than the machine.
    """

    words: str
    advice: str
    by_input: bool = True


_FREE = "Stored data are complete. Free some space, and repeat the command (a run with --resume)."
_FULL = Fault("the disk is full", _FREE, by_input=False)
_READ_ONLY = Fault("the file system is read-only", "Name a place that can be written.")
_FORBIDDEN = Fault(
    "this user has no permission for it", "Name another place, or change its permissions."
)
_IN_THE_WAY = Fault("a file stands where a folder is needed", "Name another place.")
_HANDLES = Fault(
    "too many files are open at once", "Raise the limit (`ulimit -n`).", by_input=False
)
_AGAIN = "Stored data are complete; repeat the command (a run with --resume)."
FAULTS: Mapping[int, Fault] = {
    errno.ENOSPC: _FULL,
    errno.EDQUOT: Fault("the disk quota is used up", _FREE, by_input=False),
    errno.EFBIG: Fault("the file would be larger than is allowed here", _FREE, by_input=False),
    errno.EROFS: _READ_ONLY,
    errno.EACCES: _FORBIDDEN,
    errno.EPERM: _FORBIDDEN,
    errno.ENOTDIR: _IN_THE_WAY,
    errno.EEXIST: Fault("something of this name exists already", "Name another place."),
    errno.ENOTEMPTY: Fault("this folder is not empty", "Name another place."),
    errno.EISDIR: Fault("this is a folder; a file is needed", "Name a file."),
    errno.ENOENT: Fault("there is no such file or folder", "Was it moved or removed?"),
    errno.ENXIO: Fault("nothing can be stored there", "Name another place."),
    errno.ENODEV: Fault("nothing can be stored there", "Name another place."),
    errno.ENAMETOOLONG: Fault("this name is too long", "Name a shorter path."),
    errno.ELOOP: Fault("its symbolic links go round in a circle", "Name another place."),
    errno.ETXTBSY: Fault("a program there is running", "Name another place."),
    errno.EMFILE: _HANDLES,
    errno.ENFILE: _HANDLES,
    errno.EIO: Fault(
        "the disk cannot be read or written there (an input/output error)",
        "See the system's log: the disk may be failing. `flywheel data verify` lists the "
        "undamaged episodes.",
        by_input=False,
    ),
    errno.ESTALE: Fault("the network's file system lost it", _AGAIN, by_input=False),
    errno.ENOTCONN: Fault("the file system there is not connected", _AGAIN, by_input=False),
    errno.ENOMEM: Fault("the machine has no memory left", _AGAIN, by_input=False),
    errno.EAGAIN: Fault("the machine allows no more processes or threads", _AGAIN, by_input=False),
    errno.EADDRINUSE: Fault("another program uses this port", "Name another port."),
    errno.EADDRNOTAVAIL: Fault("this machine has no such address", "Name another one."),
    errno.ECONNREFUSED: Fault("nobody listens there", "Is the server running?", by_input=False),
    errno.ECONNRESET: Fault("the other side broke the connection", _AGAIN, by_input=False),
    errno.EHOSTUNREACH: Fault("that machine cannot be reached", "Is it running?", by_input=False),
    errno.ENETUNREACH: Fault("there is no network", "Is this machine connected?", by_input=False),
    errno.ETIMEDOUT: Fault("there was no answer in time", "Is the server running?", by_input=False),
    errno.EPIPE: Fault("the program at the other end is gone", _AGAIN, by_input=False),
}


def fault_of(error: BaseException) -> Fault | None:
    """Meaning of a system error; None if a command should never meet it."""
    if not isinstance(error, OSError) or error.errno is None:
        return None
    return FAULTS.get(error.errno)


def told(error: OSError) -> str:
    """A system error as one or two sentences, with its path."""
    fault = fault_of(error)
    words = str(error.strerror or error) if fault is None else fault.words
    advice = "" if fault is None else f" {fault.advice}"
    if error.filename is None or isinstance(error.filename, int):
        return f"{words[:1].upper()}{words[1:]}.{advice}"
    return f"{short(error.filename)}: {words}.{advice}"


def short(path: object) -> str:
    """A path for a message."""
    text = os.fsdecode(path) if isinstance(path, bytes | os.PathLike) else str(path)
    if len(text) <= LONGEST_PATH:
        return text
    half = LONGEST_PATH // 2
    return f"{text[:half]}...{text[-half:]} ({len(text)} characters)"
