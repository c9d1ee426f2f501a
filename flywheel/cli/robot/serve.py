"""`flywheel robot serve`: a stand-in for a robot, behind a TCP port."""

from __future__ import annotations

from typing import Annotated

from flywheel.cli.console import console
from flywheel.cli.robot.stand_in import StandInOptions
from flywheel.quantities import Bounds, ControlStep

LOOPBACK = "127.0.0.1"


def serve(
    robot: Annotated[str, "ROBOT"],
    *,
    stand_in: StandInOptions = StandInOptions(),
    period: ControlStep = 0.01,
    real_time: Annotated[bool, "--real-time/--lockstep"] = True,
    host: str = LOOPBACK,
    port: Annotated[int, Bounds(0, 65_535)] = 7420,
) -> None:
    """Start a stand-in for a robot: simulate it with hidden effects, and let others drive it.

    It returns only measurements. Ctrl-C ends it.

    [bold]Example[/bold]

    flywheel robot serve prism3 --hidden torque_speed --hidden payload:2 --latency 0.03

    flywheel drive runs/prism3 --robot tcp://127.0.0.1:7420

    Args:
      robot: Your .xml, or a shipped robot's name.
      period: Control period, in seconds.
      real_time: Run in real time, or wait for the driver.
      host: Address to listen on; this machine only by default.
      port: Port; 0 for one that is free.
    """
    import asyncio

    from flywheel.robot_link import StandIn
    from flywheel.robot_link.server import RobotServer
    from flywheel.robots import load_robot

    out = console()
    found = load_robot(robot)
    server = RobotServer(StandIn(found, stand_in.config(), period), real_time, say=out.say)
    if host != LOOPBACK:
        out.say(
            f"Everybody with access to {host} can drive this robot: there is no password.",
            style="yellow",
        )

    def listening(port: int) -> None:
        pace = "in real time" if real_time else "in lockstep"
        out.say(f"{found.name} waits {pace} at tcp://{host}:{port}. Ctrl-C ends it.")

    try:
        asyncio.run(server.serve(host, port, listening))
    except KeyboardInterrupt:
        late = server.pace.late
        out.say(
            f"Ended; {late} of {server.pace.periods} control periods came late."
            if late
            else "Ended."
        )
