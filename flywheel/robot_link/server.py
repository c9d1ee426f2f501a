"""A stand-in behind a TCP port: in real time, or as fast as it is observed.

Only one driver can connect at a time. When it leaves, is lost, or sends an invalid message, the
robot holds its winches.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from flywheel.errors import FlywheelError, LinkError
from flywheel.robot_link.protocol import RobotInfo
from flywheel.robot_link.stand_in import StandIn
from flywheel.robot_link.wire import (
    LONGEST_LINE,
    About,
    Hello,
    Measured,
    Message,
    Observe,
    Ready,
    Refused,
    Reset,
    Send,
    Stop,
    Stopped,
    check_format,
    request_of,
)

LOOPBACK = "127.0.0.1"
SILENCE = 60.0  # after which a driver that says nothing is taken to be lost [s]
Say = Callable[[str], None]


@dataclass
class Pace:
    """Statistics of real time.

    Attributes:
      periods: control periods so far.
      late: number of these that began more than a period late.
    """

    periods: int = 0
    late: int = 0


class RobotServer:
    """Lets one driver after the other drive a stand-in.

    Args:
      robot: the stand-in.
      real_time: let its clock run by itself; else it waits to be observed.
      say: receives connections and disconnections.
    """

    def __init__(
        self,
        robot: StandIn,
        real_time: bool = False,
        say: Say = lambda words: None,
        silence: float | None = SILENCE,
    ) -> None:
        self._robot, self._real_time, self._say = robot, real_time, say
        self._silence = silence
        self._ticked = asyncio.Condition()
        self._driven = self._failed = False
        self._ticking: asyncio.Task[None] | None = None
        self.pace = Pace()

    @property
    def info(self) -> RobotInfo:
        """Its description."""
        return replace(self._robot.info, real_time=self._real_time)

    async def serve(
        self, host: str, port: int, listening: Callable[[int], None] = lambda port: None
    ) -> None:
        """Accept drivers, until cancelled.

        Args:
          host: the local machine only, unless another address of it is given.
          port: 0 for any free one.
          listening: receives the port.

        Raises:
          LinkError: the port is not available.
        """
        try:
            server = await asyncio.start_server(self._let_in, host, port, limit=LONGEST_LINE)
        except OSError as error:
            raise LinkError(f"Cannot listen on {host}:{port}: {error.strerror}.") from None
        async with server:
            listening(server.sockets[0].getsockname()[1])
            await server.serve_forever()

    async def _let_in(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        who = "{}:{}".format(*writer.get_extra_info("peername")[:2])
        try:
            if self._driven:
                writer.write(Refused(message="Somebody else drives this robot.").line())
                return
            self._driven = True
            self._say(f"{who} drives.")
            try:
                why = await self._talk(reader, writer)
            finally:
                self._robot.stop()
                self._driven = False
            self._say(f"{who} {why}; the robot holds still.")
        except ConnectionError:
            self._say(f"{who} is lost; the robot holds still.")
        finally:
            writer.close()
            with suppress(ConnectionError):
                await writer.wait_closed()

    async def _talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> str:
        """Serve one driver; returns the reason for its end."""
        greeted = False
        while True:
            try:
                line = await asyncio.wait_for(reader.readline(), self._silence)
            except TimeoutError:
                return f"was silent for {self._silence:g} s"
            except ValueError:
                writer.write(
                    Refused(message=f"A message has at most {LONGEST_LINE:,} bytes.").line()
                )
                return "sent too long a message"
            if not line:
                return "left"
            try:
                request = request_of(line)
                if not greeted and not isinstance(request, Hello):
                    raise LinkError("The first message must be hello.")
                greeted = True
                answer = await self._answer(request)
            except FlywheelError as error:
                writer.write(Refused(message=str(error)).line())
                return f"was rejected ({error})"
            if answer is not None:
                writer.write(answer.line())
                await writer.drain()

    async def _answer(self, request: Message) -> Message | None:
        robot = self._robot
        if isinstance(request, Hello):
            check_format(request.format, "driver")
            return About.of(self.info)
        if isinstance(request, Reset):
            await self._halt()
            robot.reset(request.seed)
            self._begun, self._given, self._failed = time.monotonic(), -1, False
            self.pace = Pace()
            if self._real_time:
                self._ticking = asyncio.create_task(self._tick())
            return Ready()
        if isinstance(request, Observe):
            return await self._observed()
        if isinstance(request, Send):
            robot.send(request.controls, request.valid_until)  # type: ignore[arg-type]  # becomes an array
            return None
        if isinstance(request, Stop):
            robot.stop()
            return Stopped()
        raise LinkError(f"{type(request).__name__} is not a message of a driver.")

    async def _observed(self) -> Message:
        if not self._real_time:
            return Measured.of(self._robot.observe())
        if self._ticking is None:
            raise LinkError("The robot must be reset before it is driven.")
        ticking = self._ticking
        async with self._ticked:
            await self._ticked.wait_for(lambda: self.pace.periods > self._given or self._failed)
        if self._failed:
            await ticking  # raises what ended it
        self._given = self.pace.periods
        return Measured.of(self._robot.sample())

    async def _tick(self) -> None:
        """Run control periods in real time. A command counts for the period of its arrival."""
        period = self._robot.info.period
        while not self._failed:
            due = self._begun + (self.pace.periods + 1) * period
            await asyncio.sleep(due - time.monotonic())
            self.pace.late += time.monotonic() > due + period
            async with self._ticked:
                self._failed = True
                try:
                    self._robot.advance()
                    self.pace.periods += 1
                    self._failed = False
                finally:
                    self._ticked.notify_all()

    async def _halt(self) -> None:
        """Stop the clock."""
        if self._ticking is not None:
            self._ticking.cancel()
            with suppress(asyncio.CancelledError):
                await self._ticking
            self._ticking = None
