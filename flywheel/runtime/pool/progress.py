"""Progress display: live bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.progress import Progress as RichProgress
from rich.text import Text

from flywheel.outputs import printable


class Stage(Protocol):
    """One piece of work with a progress display."""

    def update(self, done: float, note: str = "") -> None:
        """Report that `done` of the stage's total is done."""
        ...


class Progress(Protocol):
    """Progress display for people."""

    def say(self, text: str) -> None:
        """Show one line about an event."""
        ...

    def stage(self, title: str, total: float) -> AbstractContextManager[Stage]:
        """Show a stage while a block runs: `with progress.stage("collect", 12) as stage: stage.update(3)`."""
        ...


class Quiet:
    """Shows nothing."""

    def say(self, text: str) -> None:
        """Show nothing."""

    @contextmanager
    def stage(self, title: str, total: float) -> Iterator[Stage]:
        """Show nothing."""
        yield self

    def update(self, done: float, note: str = "") -> None:
        """Show nothing."""


class Lines:
    """Plain lines, for logs and pipes.

    Args:
      write: takes one line, e.g. `print`.
      every: seconds between two lines of one stage.
      clock: for tests.
    """

    def __init__(
        self,
        write: Callable[[str], None],
        every: float = 15.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._write = write
        self._every = every
        self._clock = clock

    def say(self, text: str) -> None:
        """Write the line."""
        self._write(text)

    @contextmanager
    def stage(self, title: str, total: float) -> Iterator[Stage]:
        """Write a line at the beginning of the stage, at intervals, and at its end."""
        shown = _StageLines(title, total, self._write, self._every, self._clock)
        yield shown
        shown.end()


class _StageLines:
    def __init__(
        self,
        title: str,
        total: float,
        write: Callable[[str], None],
        every: float,
        clock: Callable[[], float],
    ) -> None:
        self._title, self._total, self._write = title, max(total, 1e-9), write
        self._every, self._clock = every, clock
        self._start = self._last = clock()

    def update(self, done: float, note: str = "") -> None:
        now = self._clock()
        if now - self._last < self._every:
            return
        self._last = now
        share = min(done / self._total, 1.0)
        past = now - self._start
        left = f", {clock_face(past / share - past)} left" if 0 < share < 1 else ""
        rate = f", {done / past:.3g}/s" if past > 0 else ""
        words = f", {note}" if note else ""
        self._write(f"{self._title}: {share:4.0%} after {clock_face(past)}{left}{rate}{words}")

    def end(self) -> None:
        self._write(f"{self._title}: done in {clock_face(self._clock() - self._start)}")


class Bars:
    """Live bars on a terminal."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, text: str) -> None:
        """Write the line above the bar."""
        self._console.print(printable(text), highlight=False, markup=False, emoji=False)

    @contextmanager
    def stage(self, title: str, total: float) -> Iterator[Stage]:
        """Show a bar until the stage ends."""
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description:<22}", markup=False),
            BarColumn(),
            TaskProgressColumn(show_speed=True),
            TimeElapsedColumn(),
            _TimeLeft(),
            TextColumn("{task.fields[note]}", markup=False),
        )
        with RichProgress(*columns, console=self._console, refresh_per_second=4) as bars:
            yield _StageBar(bars, bars.add_task(title, total=total, note=""))


class _TimeLeft(ProgressColumn):
    """The time left by the share that is done, as plain lines have it."""

    def render(self, task: Task) -> Text:
        share, past = task.completed / max(task.total or 0.0, 1e-9), task.elapsed or 0.0
        return Text(
            clock_face(past / share - past) if 0.0 < share < 1.0 else "", "progress.remaining"
        )


class _StageBar:
    def __init__(self, bars: RichProgress, task: object) -> None:
        self._bars, self._task = bars, task

    def update(self, done: float, note: str = "") -> None:
        self._bars.update(self._task, completed=done, note=note)  # type: ignore[arg-type]


def console_progress(console: Console | None = None) -> Progress:
    """Bars on a terminal, plain lines elsewhere."""
    console = console or Console(stderr=True)
    if console.is_terminal:
        return Bars(console)
    return Lines(
        lambda line: console.print(
            printable(line), highlight=False, markup=False, emoji=False, soft_wrap=True
        )
    )


def clock_face(seconds: float) -> str:
    """Seconds as m:ss or h:mm:ss."""
    minutes, rest = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
