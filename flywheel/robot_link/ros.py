"""A robot behind ROS or ROS 2, by rosbridge (`roslibpy`).

| topic or service | type | content |
|---|---|---|
| `points` | `sensor_msgs/PointCloud` | tracked points [m], in the MJCF's order; NaN or null where missing |
| `winches` | `sensor_msgs/JointState` | positions of winches [m] by name; those with encoders |
| `command` | `std_msgs/Float64MultiArray` | commands (W,), in the MJCF's order |
| `reset` | `std_srvs/Trigger` | answers once the robot rests at the start of an episode |

ROS messages do not expire. The node that moves the winches must hold them itself if no command has
come for `dead_man` seconds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from flywheel.errors import ConfigError, LinkError
from flywheel.records import Floats
from flywheel.robot_link.protocol import RobotInfo, Sample
from flywheel.robots import Robot

PORT = 9090  # of rosbridge
CONNECTING = 10.0  # longest wait for rosbridge [s]
RESETTING = 60.0  # longest wait for a robot that goes back to where an episode begins [s]
SILENCE = 1.0  # longest time without a measurement before the robot is taken to be lost [s]


class RosLink:
    """A robot that publishes its points and subscribes to commands. Implements `RobotLink`.

    Stamps are those of the messages' headers, counted from the first message after a reset, so that
    the clocks of two machines need not agree. That first measurement is assumed to be `latency`
    old.

    Args:
      robot: of its MJCF.
      host, port: of rosbridge.
      period: of the control loop [s].
      points, winches, command, reset: names of topics and of the service.
      latency: age of measurements on arrival [s].
      dead_man: time without commands after which the robot's node holds the winches [s].

    Raises:
      ConfigError: roslibpy is not installed.
      LinkError: no rosbridge answers.
    """

    def __init__(
        self,
        robot: Robot,
        host: str = "127.0.0.1",
        port: int | str = PORT,
        period: float | str = 0.01,
        points: str = "/robot/points",
        winches: str = "/robot/winches",
        command: str = "/robot/command",
        reset: str = "/robot/reset",
        latency: float | str = 0.0,
        dead_man: float | str = 0.5,
    ) -> None:
        try:
            import roslibpy  # an extra, which only robots behind ROS need
        except ImportError:
            raise ConfigError("A robot behind ROS needs roslibpy: install flywheel[ros].") from None
        self._robot, self._where = robot, f"{host}:{port}"
        self.info = RobotInfo.of(
            robot, float(period), latency=float(latency), dead_man=float(dead_man), real_time=True
        )
        self._new = threading.Condition()
        self._points: Floats | None = None
        self._winch = np.full(len(robot.winches), np.nan)
        self._stamp = self._first_stamp = self._arrived = self._begun = 0.0
        self._steps = 0
        self._command = robot.holding(robot.winch_of(robot.keyframe))
        self._ros = roslibpy.Ros(host, int(port), transport="asyncio")
        try:
            self._ros.run(timeout=CONNECTING)
        except Exception as error:  # its own kinds, and those of three transports
            raise LinkError(f"No rosbridge answers at {self._where}: {error}.") from None
        self._request = roslibpy.ServiceRequest
        self._reset = roslibpy.Service(self._ros, reset, "std_srvs/Trigger")
        self._commands = roslibpy.Topic(self._ros, command, "std_msgs/Float64MultiArray")
        self._commands.advertise()
        self._heard = [
            roslibpy.Topic(self._ros, points, "sensor_msgs/PointCloud", queue_length=1),
            roslibpy.Topic(self._ros, winches, "sensor_msgs/JointState", queue_length=1),
        ]
        for topic, told in zip(self._heard, (self._hear_points, self._hear_winches), strict=True):
            topic.subscribe(told)

    def reset(self, seed: int = 0) -> None:
        """Ask the robot to rest at the start of an episode; its clock starts with the next message."""
        try:
            answer = self._reset.call(self._request(), timeout=RESETTING)
        except Exception as error:
            raise LinkError(f"The robot at {self._where} was not reset: {error}.") from None
        if not answer.get("success", False):
            raise LinkError(
                f"The robot at {self._where} was not reset: "
                f"{answer.get('message') or 'without a reason'}."
            )
        self._command = self._robot.holding(self._robot.winch_of(self._robot.keyframe))
        with self._new:
            self._points = None
            self._wait_for_points(time.monotonic() + CONNECTING)
            self._first_stamp, self._begun = self._stamp, self._arrived
        self._steps = -1

    def observe(self) -> Sample:
        """The newest measurement after the next control period; the first at once."""
        now = time.monotonic() - self._begun
        self._steps = max(self._steps + 1, int(now / self.info.period))
        time.sleep(max(0.0, self._steps * self.info.period - now))
        with self._new:
            if self._points is None:
                raise LinkError("The robot must be reset before it is driven.")
            if not self._ros.is_connected:
                raise LinkError(f"The connection to the rosbridge at {self._where} is lost.")
            if time.monotonic() - self._arrived > SILENCE:
                raise LinkError(
                    f"The robot at {self._where} has measured nothing for {SILENCE:g} s."
                )
            stamp = self._stamp - self._first_stamp - self.info.latency
            return Sample(
                self._steps * self.info.period, stamp, self._points.copy(), self._winch.copy()
            )

    def send(self, controls: Floats, valid_until: float) -> None:
        """Publish a command (W,), within the limits."""
        self._publish(self.info.clipped(controls))

    def stop(self) -> None:
        """Publish a holding command."""
        self._publish(self._robot.holding(self._command))

    def close(self) -> None:
        """Stop, and disconnect from rosbridge."""
        if self._ros.is_connected:
            self.stop()
            for topic in self._heard:
                topic.unsubscribe()
            self._commands.unadvertise()
            self._ros.close()

    def _publish(self, controls: Floats) -> None:
        if not self._ros.is_connected:
            raise LinkError(f"The connection to the rosbridge at {self._where} is lost.")
        self._command = controls
        layout = {"dim": [], "data_offset": 0}
        self._commands.publish({"layout": layout, "data": controls.tolist()})

    def _hear_points(self, message: Mapping[str, Any]) -> None:
        found = [[point.get(axis) for axis in "xyz"] for point in message.get("points", ())]
        points = np.array(found, float).reshape(-1, 3)  # null becomes NaN
        if len(points) != len(self._robot.points):
            points = np.full(
                (len(self._robot.points), 3), np.nan
            )  # observe says that none was seen
        with self._new:
            self._points, self._arrived = points, time.monotonic()
            self._stamp = _seconds(message.get("header", {}).get("stamp", {}), self._arrived)
            self._new.notify_all()

    def _hear_winches(self, message: Mapping[str, Any]) -> None:
        known = dict(zip(message.get("name", ()), message.get("position", ()), strict=False))
        winch = np.array([known.get(winch.name, np.nan) for winch in self._robot.winches], float)
        with self._new:
            self._winch = winch

    def _wait_for_points(self, until: float) -> None:
        while self._points is None:
            if not self._new.wait(until - time.monotonic()):
                raise LinkError(
                    f"The robot at {self._where} has measured nothing for {CONNECTING:g} s."
                )


def _seconds(stamp: Mapping[str, Any], otherwise: float) -> float:
    """A header's time [s], of ROS (secs, nsecs) or ROS 2 (sec, nanosec)."""
    seconds = stamp.get("secs", stamp.get("sec"))
    if seconds is None:
        return otherwise
    return float(seconds) + 1e-9 * float(stamp.get("nsecs", stamp.get("nanosec", 0)))
