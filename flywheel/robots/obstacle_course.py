"""An obstacle course: boxes with a start and goals among them, drawn as MJCF."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files

import mujoco
import numpy as np

from flywheel.errors import RobotError
from flywheel.registry import lookup
from flywheel.robots.mjcf_numbers import check_numbers
from flywheel.robots.mjcf_source import compiled, read_mjcf
from flywheel.terrain import Box, box_of

COURSES = {
    name: f"{name}.xml"
    for name in ("s_course", "maze", "incline", "corridor", "low_clearance", "composite")
}
GOAL = re.compile(r"goal(\d*)")
Place = tuple[float, float]


@dataclass(frozen=True)
class ObstacleCourse:
    """Start, goals and boxes of a course.

    Attributes:
      name: of the course.
      obstacles: boxes.
      start: (x, y) initial centre of mass of the robot [m].
      goals: (x, y) of each, to be reached one after the other [m].
    """

    name: str
    obstacles: tuple[Box, ...]
    start: Place
    goals: tuple[Place, ...]

    @classmethod
    def from_mjcf(cls, xml: str) -> ObstacleCourse:
        """Read an MJCF: boxes in its world, and sites "start" and "goal", or "goal1", "goal2", ...

        A ground plane is ignored: the robot has its own.

        Raises:
          RobotError: not an MJCF; anything but boxes; no start; no goal.
        """
        _, spec, model = compiled(xml, "course")
        check_numbers(model, "The course")
        boxes = [_box(model, geom) for geom in range(model.ngeom) if not _is_plane(model, geom)]
        sites = {model.site(i).name: model.site(i).pos for i in range(model.nsite)}
        if "start" not in sites:
            raise RobotError(f"{spec.modelname} has no site named start; it has {_listed(sites)}.")
        numbered = {name: match for name in sites if (match := GOAL.fullmatch(name))}
        order = sorted(numbered, key=lambda name: int(numbered[name][1] or 0))
        if not order:
            raise RobotError(
                f"{spec.modelname} has no site named goal, or goal1, goal2, ...; it has {_listed(sites)}."
            )
        goals = tuple(_place(sites[name]) for name in order)
        return cls(spec.modelname, tuple(boxes), _place(sites["start"]), goals)


def load_course(name: str) -> ObstacleCourse:
    """A shipped course by name, or the user's own by the path of its MJCF (ending in .xml).

    Raises:
      UnknownNameError: no such course.
      RobotError: the MJCF cannot be used.
    """
    if not name.endswith(".xml"):
        file = lookup(COURSES, name, "course")
        return ObstacleCourse.from_mjcf(files(__package__).joinpath("courses", file).read_text())
    return ObstacleCourse.from_mjcf(read_mjcf(name, "course"))


def _is_plane(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE)


def _box(model: mujoco.MjModel, geom: int) -> Box:
    name = model.geom(geom).name or f"number {geom}"
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX or model.geom_bodyid[geom] != 0:
        raise RobotError(
            f"Courses have boxes in their world, nothing else; geom {name} is not a box."
        )
    numbers = np.concatenate(
        [array[geom] for array in (model.geom_pos, model.geom_size, model.geom_quat)]
    )
    return box_of(numbers)


def _place(position: np.ndarray) -> Place:
    return float(position[0]), float(position[1])


def _listed(sites: dict[str, np.ndarray]) -> str:
    return ", ".join(sites) or "no sites"
