"""Processes that compute parts of a training step's batch, each on a core of its own.

Threads of one process would hinder each other: half of a step is spent in the interpreter.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, Self

import torch
from torch import Tensor

from flywheel.dynamics.gnn import ChunkNetwork
from flywheel.errors import RunError

Work = Callable[..., Any]
# Reads what it is given before it imports anything large, so that the giver need not wait for that.
_BEGINNING = """
import pickle
from multiprocessing.connection import Connection
pipe = Connection({end})
serve, *given = pickle.loads(pipe.recv_bytes())
serve(pipe, *given)
"""
_READY = b"ready"


class Helper:
    """A process that works for this one. It ends with the `with` block, or with this process.

    Until it has started, and until it is replaced if it was killed, this process does its work, with
    the same result.

    Args:
      work: called with a network and further arguments; they, it and its result can be pickled.
      network: of the work.
      rehearsal: further arguments of a first, small work, for which all that is needed is loaded.
    """

    def __init__(self, work: Work, network: ChunkNetwork, *rehearsal: Any) -> None:
        self._work, self._given = work, _packed((_serve, work, network, *rehearsal))

    def __enter__(self) -> Self:
        self._ready = False
        self._pipe, end = Pipe()
        with end, contextlib.suppress(OSError):  # it has ended: noticed when it is needed
            self._process = subprocess.Popen(
                [sys.executable, "-c", _BEGINNING.format(end=end.fileno())],
                pass_fds=[end.fileno()],
                env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)},
                process_group=0,  # Ctrl-C is for this process
            )
            self._pipe.send_bytes(self._given)
        return self

    def __exit__(self, *error: object) -> None:
        self._pipe.close()
        self._process.kill()
        self._process.wait()

    def begin(self, network: ChunkNetwork, *arguments: Any) -> Callable[[], Any]:
        """Begin work; the returned function waits for its result.

        Raises:
          RunError: the process cannot start.
        """
        try:
            if not self._ready and self._pipe.poll():
                self._ready = self._pipe.recv_bytes() == _READY
            if self._ready:
                self._pipe.send_bytes(_packed((network.state_dict(), *arguments)))
                return partial(self._result, network, *arguments)
        except (EOFError, OSError):
            self._replace()
        return partial(self._work, network, *arguments)

    def _result(self, *arguments: Any) -> Any:
        try:
            return _received(self._pipe)
        except (EOFError, OSError):
            self._replace()
            return self._work(*arguments)

    def _replace(self) -> None:
        self.__exit__()
        if not self._ready:
            raise RunError(
                "The process that computes a part of each batch ended while it started, with status "
                f"{self._process.returncode}; training.processes=1 does without it."
            )
        self.__enter__()


class _Packer(pickle.Pickler):
    """Packs tensors as arrays, ten times faster than torch and without what they are views of."""

    def reducer_override(self, thing: Any) -> Any:
        if type(thing) is Tensor:
            return torch.from_numpy, (thing.detach().numpy(),)
        return NotImplemented


def _packed(thing: Any) -> memoryview:
    file = io.BytesIO()
    _Packer(file, pickle.HIGHEST_PROTOCOL).dump(thing)
    return file.getbuffer()


def _received(pipe: Connection) -> Any:
    return pickle.loads(pipe.recv_bytes())  # noqa: S301 from our own process alone


def _serve(pipe: Connection, work: Work, network: ChunkNetwork, *rehearsal: Any) -> None:
    """Work for the process at the other end of the pipe until that is gone."""
    torch.set_num_threads(1)
    work(network, *rehearsal)
    with contextlib.suppress(EOFError, OSError):
        pipe.send_bytes(_READY)
        while True:
            state, *arguments = _received(pipe)
            network.load_state_dict(state)
            pipe.send_bytes(_packed(work(network, *arguments)))
