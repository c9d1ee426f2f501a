"""The interface to a robot, and the ways to reach one.

`StandIn` is a simulated robot: the truth simulator with sensors. `SimulatedLink` runs one in its
own process, `TcpLink` reaches one over the network, `ReplayedLink` replays the messages of a link.
"""

from flywheel.robot_link.protocol import RobotInfo, RobotLink, Sample
from flywheel.robot_link.simulated import SimulatedLink
from flywheel.robot_link.stand_in import StandIn, StandInConfig
from flywheel.robot_link.tcp import TcpLink
from flywheel.robot_link.transcript import ReplayedLink, TranscribedLink

__all__ = [
    "ReplayedLink",
    "RobotInfo",
    "RobotLink",
    "Sample",
    "SimulatedLink",
    "StandIn",
    "StandInConfig",
    "TcpLink",
    "TranscribedLink",
]
