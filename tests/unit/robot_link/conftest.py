"""A robot, and servers that end with their test."""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterator

import pytest

from flywheel.robot_link import StandIn, StandInConfig
from flywheel.robot_link.server import LOOPBACK, RobotServer
from flywheel.robots import Robot, load_robot

PERIOD = 0.01
Serve = Callable[..., int]


@pytest.fixture(scope="session")
def prism3() -> Robot:
    return load_robot("prism3")


@pytest.fixture
def serve(prism3: Robot) -> Iterator[Serve]:
    """Starts servers in threads; gives their ports."""
    with contextlib.ExitStack() as ending:

        def start(config: StandInConfig | None = None, real_time: bool = False) -> int:
            ready, ports, loops = threading.Event(), [], []
            server = RobotServer(StandIn(prism3, config or StandInConfig(), PERIOD), real_time)

            def listening(port: int) -> None:
                ports.append(port)
                ready.set()

            async def serving() -> None:
                task = asyncio.create_task(server.serve(LOOPBACK, 0, listening))
                loops.append((asyncio.get_running_loop(), task))
                with contextlib.suppress(asyncio.CancelledError):
                    await task

            thread = threading.Thread(target=lambda: asyncio.run(serving()))
            thread.start()
            assert ready.wait(10)
            ((loop, task),) = loops
            ending.callback(thread.join)
            ending.callback(lambda: loop.call_soon_threadsafe(task.cancel))
            return int(ports[0])

        yield start
