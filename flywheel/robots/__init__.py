"""Robots: read from an MJCF, and the shipped ones."""

from importlib.resources import files

from flywheel.registry import lookup
from flywheel.robots.added import add_plain, free_name
from flywheel.robots.bodies import moving_bodies, tracked_site, turn_of
from flywheel.robots.drawn_terrain import MOST_BOXES, TerrainConfig, draw_terrain
from flywheel.robots.ground import Ground, collides, ground_of
from flywheel.robots.mjcf_reader import read_robot
from flywheel.robots.obstacle_course import COURSES, ObstacleCourse, load_course
from flywheel.robots.parts import Attachment, Body, Cable, Primitive, TrackedPoint, Winch
from flywheel.robots.robot import Robot
from flywheel.robots.symmetries import Symmetries, symmetries_of
from flywheel.robots.world import GRAVITY
from flywheel.terrain import Box

ROBOTS = {"prism3": "prism3.xml", "icosa6": "icosa6.xml", "platform4": "platform4.xml"}


def load_robot(name: str) -> Robot:
    """Load a shipped robot by name, or a user's own by the path of its MJCF (ending in .xml).

    Raises:
      UnknownNameError: no such robot.
      RobotError: the MJCF cannot be used.
    """
    if name.endswith(".xml"):
        return read_robot(name)
    file = lookup(ROBOTS, name, "robot")
    return read_robot(files(__name__).joinpath("mjcf", file).read_text())


__all__ = [
    "COURSES",
    "GRAVITY",
    "MOST_BOXES",
    "ROBOTS",
    "Attachment",
    "Body",
    "Box",
    "Cable",
    "Ground",
    "ObstacleCourse",
    "Primitive",
    "Robot",
    "Symmetries",
    "TerrainConfig",
    "TrackedPoint",
    "Winch",
    "add_plain",
    "collides",
    "draw_terrain",
    "free_name",
    "ground_of",
    "load_course",
    "load_robot",
    "moving_bodies",
    "read_robot",
    "symmetries_of",
    "tracked_site",
    "turn_of",
]
