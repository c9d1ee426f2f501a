"""`flywheel ui`: the MLflow dashboard of a run."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import socket
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated

import typer

from flywheel.cli.console import console
from flywheel.cli.options import RunArgument
from flywheel.errors import ConfigError, DataError, RunError
from flywheel.faults import told
from flywheel.runtime.pool.caretaker import GRACE, Caretaker
from flywheel.runtime.tracking.dashboard import DATABASE, HOST, damage, ui_command


def ui(
    run: RunArgument,
    *,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the server.")] = 5000,
) -> None:
    """Serve the MLflow dashboard of a run on this machine, until Ctrl-C or SIGTERM.

    [bold]Example[/bold]

    flywheel ui runs/prism3 --port 5001
    """
    database = run / DATABASE
    if not database.exists():
        raise DataError(
            f"There is no {DATABASE} in {run}. Is it a run's folder? A run with tracking.uri is "
            "tracked on that server instead."
        )
    if problem := damage(database):
        raise DataError(problem)
    check_port(port)
    command, settings, url = ui_command(run, port)
    console().say(f"Open {url}   (Ctrl-C ends it)")
    with _served(command, settings) as server:
        code = server.wait()
    raise RunError(f"MLflow's server ended by itself, with the exit code {code}.")


def check_port(port: int) -> None:
    """Check that a server can listen at a port of this machine.

    Raises:
      ConfigError: it is in use, or reserved for root.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            why = (
                "only root may use ports below 1024"
                if error.errno == errno.EACCES
                else told(error).rstrip(".")
            )
            raise ConfigError(f"Nothing can be served at port {port}: {why}.") from None


@contextmanager
def _served(
    command: Sequence[str], settings: Mapping[str, str]
) -> Iterator[subprocess.Popen[bytes]]:
    """A server with its own process group, which ends as a whole with the block.

    MLflow's server has children and does not end them. A caretaker ends the group if this process
    is killed. An interrupt during the caretaker's start ends the server, too.
    """
    server = subprocess.Popen(command, env={**os.environ, **settings}, start_new_session=True)
    caretaker = None
    try:
        caretaker = Caretaker(group=server.pid)
        yield server
    finally:
        _end(server)
        if caretaker is not None:
            caretaker.close()


def _end(server: subprocess.Popen[bytes]) -> None:
    """End the group of a server: with SIGTERM, and later with SIGKILL."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            server.wait(GRACE)
            return
