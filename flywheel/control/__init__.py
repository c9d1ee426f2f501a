"""Control: controllers, and the closed loop around them."""

from flywheel.control.astar import AStar
from flywheel.control.closed_loop import record_episode
from flywheel.control.gaits import Gait
from flywheel.control.mppi import Mppi
from flywheel.control.mppi_config import MppiConfig
from flywheel.control.open_loop import Hold, Playback, RandomControls
from flywheel.control.protocol import Command, Controller, EpisodeOrder
from flywheel.control.starts import (
    above_ground,
    by_a_box,
    perturbed,
    random_drop,
    refuse_fixed,
    standing,
    thrown,
)

CONTROLLERS = {
    "hold": Hold,
    "playback": Playback,
    "random": RandomControls,
    "gait": Gait,
    "mppi": Mppi,
    "astar": AStar,
}

__all__ = [
    "CONTROLLERS",
    "AStar",
    "Command",
    "Controller",
    "EpisodeOrder",
    "Gait",
    "Hold",
    "Mppi",
    "MppiConfig",
    "Playback",
    "RandomControls",
    "above_ground",
    "by_a_box",
    "perturbed",
    "random_drop",
    "record_episode",
    "refuse_fixed",
    "standing",
    "thrown",
]
