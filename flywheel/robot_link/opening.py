"""The addresses of robots in written form: `simulated`, `tcp://...`, `ros://...`, `MODULE:CLASS`."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import urlsplit

from flywheel.errors import ConfigError, LinkError
from flywheel.robot_link.own import OwnLink, made
from flywheel.robot_link.protocol import RobotLink
from flywheel.robot_link.ros import PORT as BRIDGE_PORT
from flywheel.robot_link.ros import RosLink
from flywheel.robot_link.simulated import SimulatedLink
from flywheel.robot_link.stand_in import StandInConfig
from flywheel.robot_link.tcp import TcpLink
from flywheel.robots import Robot

SIMULATED, TCP, ROS = "simulated", "tcp", "ros"
PORT = 7420  # where a robot listens if nothing else is said
WAYS = f'"{SIMULATED}", "{TCP}://HOST:PORT", "{ROS}://HOST:PORT" or "MODULE:CLASS"'


def open_link(
    where: str,
    robot: Robot,
    period: float,
    stand_in: StandInConfig | None = None,
    arguments: Mapping[str, Any] | None = None,
) -> RobotLink:
    """Reach a robot.

    Args:
      where: "simulated" for a stand-in in its own process, "tcp://HOST:PORT" (the port may be
        omitted), "ros://HOST:PORT" for rosbridge, or "MODULE:CLASS" for a user's class that takes a
        Robot and the arguments.
      robot: of the MJCF.
      period: of a stand-in's control loop [s].
      stand_in: its physics and sensors, beyond its MJCF.
      arguments: of a user's class.

    Raises:
      ConfigError: the address is invalid.
      LinkError: the robot does not answer, is another one, or has another control period.
    """
    link = _opened(where, robot, period, stand_in or StandInConfig(), arguments or {})
    try:
        link.info.check_is(robot)
        if abs(link.info.period - period) > 1e-9:
            raise LinkError(
                f"The robot's control period is {link.info.period:g} s, the model's control step "
                f"(network.dt) is {period:g} s; they must be the same."
            )
    except LinkError:
        link.close()
        raise
    return link


def check_way(where: str, stand_in: StandInConfig, arguments: Mapping[str, Any]) -> None:
    """Check an address of `open_link`, and what is given beside it.

    Raises:
      ConfigError: it is none, or a robot there takes no description of a stand-in, or no arguments.
    """
    if is_tcp(where) or _is_ros(where):
        _address(where)
    elif where != SIMULATED:
        module, colon, name = where.partition(":")
        if not colon or not all(part.isidentifier() for part in (*module.split("."), name)):
            raise ConfigError(f"A robot is reached by {WAYS}, got {where!r}.")
    if where != SIMULATED and (told := stand_in.model_dump(exclude_defaults=True)):
        raise ConfigError(
            f"A stand-in ({', '.join(told)}) goes with {SIMULATED}, got {where!r}, a robot with its own "
            "physics."
        )
    if arguments and (where == SIMULATED or is_tcp(where)):
        raise ConfigError(
            f"Arguments ({', '.join(arguments)}) are those of {ROS}:// or of MODULE:CLASS; {where!r} takes "
            "none."
        )


def is_tcp(where: str) -> bool:
    """True for the address of a robot's own server."""
    return where == TCP or where.startswith(f"{TCP}://")


def _is_ros(where: str) -> bool:
    return where == ROS or where.startswith(f"{ROS}://")


def _opened(
    where: str, robot: Robot, period: float, stand_in: StandInConfig, arguments: Mapping[str, Any]
) -> RobotLink:
    check_way(where, stand_in, arguments)
    if where == SIMULATED:
        return SimulatedLink(robot, stand_in, period)
    if is_tcp(where):
        return TcpLink(*_address(where))
    if _is_ros(where):
        host, port = _address(where)
        return made(RosLink, where, robot, arguments, host=host, port=port, period=period)
    module, _, name = where.partition(":")
    return OwnLink(where, _class(module, name), robot, arguments)


def _address(where: str) -> tuple[str, int]:
    """Host and port of an address of TCP or ROS."""
    scheme = where.partition("://")[0]
    try:
        parts = urlsplit(where if "://" in where else f"{where}://")
        port = parts.port or (PORT if scheme == TCP else BRIDGE_PORT)
    except ValueError:
        raise ConfigError(f"{where!r} has no port from 1 to 65535.") from None
    if parts.path or parts.query or parts.username:
        raise ConfigError(f"A robot is reached by {scheme}://HOST:PORT, got {where!r}.")
    return parts.hostname or "127.0.0.1", port


def _class(module: str, name: str) -> Callable[..., Any]:
    try:
        there = importlib.import_module(module)
    except Exception as error:  # it is the user's code
        words = f"{type(error).__name__}: {error}"
        raise ConfigError(f"The module {module} cannot be imported: {words}.") from error
    try:
        return getattr(there, name)
    except AttributeError:
        raise ConfigError(f"The module {module} has no {name}.") from None
