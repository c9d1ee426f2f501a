"""What becomes of an input: judged in a process of its own, which may hang, crash or eat all memory.

That process is forked from a clean one that has imported everything: a fork of ours would lack the
threads that zarr and torch have started here, and wait for them for ever.
"""

import multiprocessing
import os
import random
import resource
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from tests.fuzz.asking import Kind, Spoilt

Outcome = Literal["accepted", "refused", "traceback", "hang", "crash", "memory", "escape", "wordy"]
RIGHT = ("accepted", "refused")
MB = 1e6
STARTING_SECONDS = 60.0  # of the process that judges
LONGEST_MESSAGE = 6000  # characters: a screen or two


@dataclass(frozen=True)
class Limits:
    """What an input may take.

    Attributes:
      seconds: of wall time [s].
      memory: above what the process had before [MB].
    """

    seconds: float = 30.0
    memory: float = 1000.0


@dataclass(frozen=True)
class Verdict:
    """What became of one input.

    Attributes:
      kind, number: which input it was.
      outcome: "accepted" and "refused" are right, all else is a fault.
      words: the message, or the traceback.
      seconds: it took [s].
      memory: above what the process had before [MB].
    """

    kind: str
    number: int
    outcome: Outcome
    words: str = ""
    seconds: float = 0.0
    memory: float = 0.0

    @property
    def right(self) -> bool:
        """Nothing is wrong with what became of it."""
        return self.outcome in RIGHT


def source(kind: str, seed: int, number: int) -> random.Random:
    """Seed of all chance in one input, which depends on nothing else."""
    return random.Random(f"{kind} {seed} {number}")


def judged(
    make: Callable[[Path], Kind], work: Path, count: int, seed: int, limits: Limits = Limits()
) -> Iterator[Verdict]:
    """Judge the inputs 0 to `count` of a kind, one after the other.

    Args:
      make: the kind, of a folder for its samples; a function of a module.
      work: that folder.
      count: of inputs.
      seed: of all chance.
      limits: of one input.
    """
    context, number, name = multiprocessing.get_context("forkserver"), 0, make(work).name
    context.set_forkserver_preload(["tests.fuzz.kinds"])
    while number < count:
        ours, theirs = context.Pipe(duplex=False)
        child = context.Process(
            target=_work, args=(make, work, number, count, seed, limits, theirs)
        )
        child.start()
        theirs.close()
        _next(ours, name, number, Limits(STARTING_SECONDS))  # says that it is ready
        while number < count:
            verdict = _next(ours, name, number, limits)
            number += 1
            yield verdict
            if verdict.outcome in ("hang", "crash"):
                break
        child.kill()
        child.join()
        ours.close()


def _next(ours: Connection, kind: str, number: int, limits: Limits) -> Verdict:
    begun = time.monotonic()
    try:
        if ours.poll(limits.seconds):
            return ours.recv()  # type: ignore[no-any-return]
    except (EOFError, ConnectionError):
        return Verdict(kind, number, "crash", "the process died", time.monotonic() - begun)
    return Verdict(kind, number, "hang", f"no end after {limits.seconds:g} s", limits.seconds)


def _work(
    make: Callable[[Path], Kind],
    work: Path,
    first: int,
    count: int,
    seed: int,
    limits: Limits,
    parent: Connection,
) -> None:
    kind = make(work)
    parent.send(Verdict(kind.name, first, "accepted", "ready"))
    _bound_memory(limits)
    for number in range(first, count):
        spoilt = kind.draw(source(kind.name, seed, number))
        parent.send(_judge(kind, number, spoilt, limits))


def _judge(kind: Kind, number: int, spoilt: Spoilt, limits: Limits) -> Verdict:
    before, begun = _reset_peak(), time.monotonic()
    with TemporaryDirectory(prefix="fuzz-") as place:
        inside = Path(place) / "inside"
        inside.mkdir()
        there = Path.cwd()
        os.chdir(inside)
        outcome, words = _asked(kind, spoilt, inside)
        os.chdir(there)
        if outcome in RIGHT and (left := [path.name for path in Path(place).iterdir()]) != [
            "inside"
        ]:
            outcome, words = "escape", f"wrote outside of its folder: {left}"
    seconds, memory = time.monotonic() - begun, _peak() - before
    if outcome in RIGHT and memory > limits.memory:
        outcome, words = "memory", f"took {memory:.0f} MB"
    return Verdict(kind.name, number, outcome, words, seconds, memory)


def _asked(kind: Kind, spoilt: Spoilt, inside: Path) -> tuple[Outcome, str]:
    try:
        refusal = kind.ask(spoilt, inside)
    except MemoryError:
        return "memory", traceback.format_exc()
    except BaseException:
        return "traceback", traceback.format_exc()
    if refusal is None:
        return "accepted", ""
    if not refusal.strip() or len(refusal) > LONGEST_MESSAGE:
        return "wordy", f"a message of {len(refusal)} characters: {refusal[:200]}"
    return "refused", refusal


def _bound_memory(limits: Limits) -> None:
    """Let the process fail, not the machine."""
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = size + int(3 * limits.memory * MB)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _reset_peak() -> float:
    """Let the kernel forget the largest size so far; the size now [MB]."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _peak() -> float:
    """Largest resident size since it was forgotten [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024 / MB
    return 0.0
