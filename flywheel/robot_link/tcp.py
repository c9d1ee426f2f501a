"""The driver's side of a robot that is reached over TCP."""

from __future__ import annotations

import socket
import time

from flywheel.errors import LinkError
from flywheel.robot_link.wire import (
    LONGEST_LINE,
    About,
    Expected,
    Hello,
    Message,
    MessageLink,
    Refused,
    Reset,
    answer_of,
    check_format,
)

CONNECTING = 10.0  # longest time that a robot may take to be there [s]
# The same to stand where an episode begins; people may have to carry it there [s].
RESETTING = 300.0


class TcpLink(MessageLink):
    """A robot that is reached over TCP. Implements `RobotLink`.

    Args:
      host, port: of its server.
      patience: longest wait for a whole answer [s].

    Raises:
      LinkError: it does not answer, or is not a robot.
    """

    def __init__(self, host: str, port: int, patience: float = 5.0) -> None:
        self._where, self._patience = f"{host}:{port}", patience
        try:
            self._socket = socket.create_connection((host, port), timeout=CONNECTING)
        except OSError as error:
            raise LinkError(f"No robot answers at {self._where}: {error}.") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._received = b""  # after the last line
        try:
            about = self._ask(Hello(), About)
            check_format(about.format, "robot")
        except LinkError:
            self._hang_up()
            raise
        self.info = about.info

    def close(self) -> None:
        """Let it hold its winches, and release it for others. An unreachable robot stops by itself."""
        try:
            self.stop()
        except LinkError:
            pass
        finally:
            self._hang_up()

    def _tell(self, message: Message) -> None:
        try:
            self._socket.sendall(message.line())
        except OSError as error:
            raise self._lost(str(error)) from None

    def _ask(self, message: Message, expected: type[Expected]) -> Expected:
        patience = RESETTING if isinstance(message, Reset) else self._patience
        try:
            until = time.monotonic() + patience
            self._socket.settimeout(patience)
            self._socket.sendall(message.line())
            line = self._line(until)
        except TimeoutError:
            raise self._lost(f"no answer within {patience:g} s") from None
        except OSError as error:
            raise self._lost(str(error)) from None
        if not line:
            raise self._lost("it closed the connection")
        answer = answer_of(line)
        if isinstance(answer, Refused):
            raise LinkError(f"The robot at {self._where} rejects the request: {answer.message}")
        if not isinstance(answer, expected):
            raise LinkError(
                f"The robot at {self._where} answered {type(message).__name__.lower()} with "
                f"{type(answer).__name__.lower()}."
            )
        return answer

    def _line(self, until: float) -> bytes:
        """The next line, if it is whole by then [s of `time.monotonic`]; empty from a closed connection."""
        while b"\n" not in self._received and len(self._received) < LONGEST_LINE:
            if (left := until - time.monotonic()) <= 0:
                raise TimeoutError
            self._socket.settimeout(left)
            if not (more := self._socket.recv(LONGEST_LINE)):
                break
            self._received += more
        line, end, self._received = self._received.partition(b"\n")
        return line + end

    def _lost(self, why: str) -> LinkError:
        self._hang_up()
        return LinkError(f"The link to the robot at {self._where} is lost: {why}.")

    def _hang_up(self) -> None:
        self._socket.close()
