"""Transcripts of a link, and their replay without a robot.

A transcript consists of the lines of the wire format (`wire`): each request, followed by its
answer.
"""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import IO

from flywheel.errors import LinkError
from flywheel.records import Floats
from flywheel.robot_link.protocol import RobotLink, Sample
from flywheel.robot_link.wire import (
    About,
    Expected,
    Hello,
    Measured,
    Message,
    MessageLink,
    Observe,
    Ready,
    Reset,
    Stop,
    Stopped,
    answer_of,
    command_of,
    request_of,
)


class TranscribedLink:
    """Records the messages on a link. Implements `RobotLink`.

    Args:
      link: in use.
      path: of the transcript; an existing file is replaced.
    """

    def __init__(self, link: RobotLink, path: Path) -> None:
        self._link, self.info = link, link.info
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[bytes] = path.open("wb", buffering=0)  # whole lines, also if this is killed
        self._write(Hello(), About.of(self.info))

    def reset(self, seed: int = 0) -> None:
        """As the link does."""
        self._link.reset(seed)
        self._write(Reset(seed=seed), Ready())

    def observe(self) -> Sample:
        """As the link does."""
        sample = self._link.observe()
        self._write(Observe(), Measured.of(sample))
        return sample

    def send(self, controls: Floats, valid_until: float) -> None:
        """As the link does."""
        self._link.send(controls, valid_until)
        self._write(command_of(controls, valid_until))

    def stop(self) -> None:
        """As the link does."""
        self._link.stop()
        self._write(Stop(), Stopped())

    def end(self) -> None:
        """End the transcript; the link stays open."""
        self._file.close()

    def close(self) -> None:
        """As the link does; the transcript ends."""
        self._link.close()
        self.end()

    def _write(self, *messages: Message) -> None:
        for message in messages:
            self._file.write(message.line())


class ReplayedLink(MessageLink):
    """Answers from a transcript, and rejects requests that differ from it.

    Args:
      path: of the transcript.

    Raises:
      LinkError: it is missing, or damaged.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._lines = deque(path.read_bytes().splitlines())
        except OSError as error:
            raise LinkError(f"The transcript {path} cannot be read: {error.strerror}.") from None
        self._path = path
        self.info = self._ask(Hello(), About).info

    @property
    def seconds(self) -> float:
        """Time of the last measurement, by the robot's clock [s]; 0 without one."""
        for line in reversed(self._lines):
            with suppress(LinkError):  # a request, or a line that was cut
                if isinstance(message := answer_of(line), Measured):
                    return message.time
        return 0.0

    def coming(self, kind: type[Expected]) -> Expected:
        """The driver's next message, without advancing.

        Raises:
          LinkError: it is another one, or the transcript ends.
        """
        message = request_of(self._lines[0]) if self._lines else None
        if not isinstance(message, kind):
            raise LinkError(f"{self._path} ends here.")
        return message

    def close(self) -> None:
        """Nothing: there is no connection."""

    def _tell(self, message: Message) -> None:
        then = self._next()
        if request_of(then) != message:
            raise LinkError(
                f"{self._path} was written by another run: recorded {then.decode()[:200]}, now "
                f"{message.model_dump_json()[:200]}."
            )

    def _ask(self, message: Message, expected: type[Expected]) -> Expected:
        self._tell(message)
        answer = answer_of(self._next())
        if not isinstance(answer, expected):
            raise LinkError(f"{self._path} is damaged: the answer to {message} is {answer}.")
        return answer

    def _next(self) -> bytes:
        if not self._lines:
            raise LinkError(f"{self._path} ends before the episode does.")
        return self._lines.popleft()
