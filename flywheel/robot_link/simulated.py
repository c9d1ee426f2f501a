"""A stand-in in its own process, which waits to be observed: the same commands give the same bits."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys

from flywheel.errors import LinkError
from flywheel.robot_link.server import LOOPBACK
from flywheel.robot_link.stand_in import StandInConfig
from flywheel.robot_link.tcp import TcpLink
from flywheel.robots import Robot

ENDING = 5.0  # that the process may take to end by itself [s]


class SimulatedLink(TcpLink):
    """A stand-in that is started, driven and ended from here.

    Only `config` is passed to the other process, and only measurements are returned.

    Args:
      robot: of its MJCF.
      config: its physics and sensors beyond that.
      period: of its control loop [s].

    Raises:
      LinkError: it does not start; the message says why.
    """

    def __init__(self, robot: Robot, config: StandInConfig, period: float) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "flywheel.robot_link"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            start_new_session=True,  # what ends a group or a terminal is not for it: it ends with its input
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        order = {"mjcf": robot.xml, "config": config.model_dump(), "dt": period}
        try:
            self._process.stdin.write(json.dumps(order).encode() + b"\n")
            self._process.stdin.flush()
            answer = json.loads(self._process.stdout.readline() or b"{}")
            if "port" not in answer:
                raise LinkError(answer.get("error", "The stand-in ended before it was ready."))
            super().__init__(LOOPBACK, answer["port"])
        except (OSError, LinkError) as error:
            self._end()
            raise LinkError(str(error)) from None

    def close(self) -> None:
        """End the process."""
        super().close()
        self._end()

    def _end(self) -> None:
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        with contextlib.suppress(OSError):
            process.stdin.close()  # which it takes as the end
        try:
            process.wait(ENDING)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()
