"""The process of a stand-in that `SimulatedLink` starts."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading

from flywheel.errors import FlywheelError
from flywheel.robot_link.server import LOOPBACK, RobotServer
from flywheel.robot_link.stand_in import StandIn, StandInConfig
from flywheel.robots import read_robot


def main() -> None:
    """Serve one stand-in until the standard input is closed."""
    if not (line := sys.stdin.buffer.readline()):
        return  # whoever started it is gone already
    order = json.loads(line)
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        robot = read_robot(order["mjcf"])
        stand_in = StandIn(robot, StandInConfig.model_validate(order["config"]), order["dt"])
        server = RobotServer(stand_in, silence=None)  # whoever started it may take its time
        asyncio.run(server.serve(LOOPBACK, 0, lambda port: _say(port=port)))
    except FlywheelError as error:
        _say(error=str(error))


def _say(**words: object) -> None:
    sys.stdout.write(json.dumps(words) + "\n")
    sys.stdout.flush()


def _end_with_input() -> None:
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main()
