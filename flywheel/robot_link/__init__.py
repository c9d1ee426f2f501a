"""The door through which a robot comes in: what it is to whoever drives it, and the ways to reach one.

`StandIn` is a robot that does not exist: the truth simulator with sensors. `SimulatedLink` has one in a
process of its own, `TcpLink` reaches one by the network, `ReplayedLink` plays back what went over a link.
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
