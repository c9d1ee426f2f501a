"""A rosbridge with a stand-in behind it, in a thread: enough of its protocol for one robot."""

import asyncio
import json
import threading
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection, serve

from flywheel.robot_link import StandIn


class RosBridge:
    """Publishes what a stand-in measures, and hands it commands, in real time.

    Args:
      robot: the stand-in.
      period: between measurements [s].
      hides: points that are never seen.
    """

    def __init__(self, robot: StandIn, period: float, hides: tuple[int, ...] = ()) -> None:
        self.robot, self.period, self.hides = robot, period, hides
        self.commands: list[list[float]] = []
        self.resets = 0
        self.port = 0
        self._started = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()), daemon=True)
        self._thread.start()
        assert self._started.wait(10)

    def stop(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(10)

    async def _run(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        self._topics: dict[str, str] = {}
        async with serve(self._talk, "127.0.0.1", 0) as server:
            self.port = server.sockets[0].getsockname()[1]
            self._started.set()
            await self._end.wait()

    async def _talk(self, socket: ServerConnection) -> None:
        moving = asyncio.create_task(self._move(socket))
        try:
            async for text in socket:
                await self._hear(socket, json.loads(text))
        finally:
            moving.cancel()

    async def _hear(self, socket: ServerConnection, message: dict[str, Any]) -> None:
        if message["op"] == "subscribe":
            self._topics[message["topic"]] = message["type"]
        elif message["op"] == "publish" and message["topic"] == "/robot/command":
            self.commands.append(message["msg"]["data"])
            self.robot.send(np.array(message["msg"]["data"]), np.inf)
        elif message["op"] == "call_service":
            self.robot.reset(self.resets)
            self.resets += 1
            answer = {"op": "service_response", "service": message["service"], "id": message["id"]}
            values = {"success": True, "message": ""}
            await socket.send(json.dumps({**answer, "values": values, "result": True}))

    async def _move(self, socket: ServerConnection) -> None:
        count = 1000
        while True:
            await asyncio.sleep(self.period)
            if not self.resets:
                continue
            self.robot.advance()
            count += 1
            sample = self.robot.sample()
            points: list[dict[str, float | None]] = [
                dict(zip("xyz", p, strict=True)) for p in sample.points.tolist()
            ]
            for hidden in self.hides:
                points[hidden] = dict.fromkeys("xyz")
            nanoseconds = round(count * self.period * 1e9)
            stamp = {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
            header = {"stamp": stamp, "frame_id": "world"}
            names = [winch.name for winch in self.robot._robot.winches]
            for topic, said in {
                "/robot/points": {"header": header, "points": points, "channels": []},
                "/robot/winches": {
                    "header": header,
                    "name": names,
                    "position": sample.winch.tolist(),
                },
            }.items():
                if topic in self._topics:
                    await socket.send(json.dumps({"op": "publish", "topic": topic, "msg": said}))
