"""Settings of tasks."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from flywheel.quantities import (
    Bounds,
    EpisodeSeconds,
    Metres,
    Place,
    PositiveRobotLengths,
    RobotLengths,
    Weight,
)
from flywheel.robots import MOST_BOXES, Box
from flywheel.validation import Frozen

Range = tuple[PositiveRobotLengths, PositiveRobotLengths]


class TaskConfig(Frozen):
    """Distribution and cost of tasks. Lengths are in units of the robot's length L.

    Attributes:
      name: kind of task, as in `TASKS`.
      goal: (x, y) of a given goal [m]; None to draw it. For the reaching tasks only.
      radius: (least, most) distance of a drawn goal from the start [L]; its bearing is uniform.
      tolerance: distance at which the goal counts as reached [L]. 0.17 L is the 0.5 m of published
        planners, for rods of 2.95 m.
      seconds: time limit [s].
      along: weight of the distance to the goal, averaged over the horizon (the paper's alpha1).
      final: weight of the distance to the goal at the end of the horizon.
      broadside: weight of the robot's spread along the way to the goal. It makes a long robot turn
        sooner; too much makes the robot stretch itself out across the way, and stay.
      turn: way that counts as much as turning by one radian, for a robot that rolls across its axis [L];
        0 to ignore where it rolls. prism3 rolls 1.4 L while it turns by a radian.
      aside: way that counts as much as one of the same length along that axis. prism3 rolls three times
        as far as it moves along its axis in the same time.
      arrival: reward for reaching the goal within the horizon.
      near: weight alpha2 of the collision term, among boxes only.
      course: of the task "obstacle_course": the name of a shipped one, or the path of an MJCF.
      spread: radius around the course's start and goals within which they are drawn [L].
      stops: number of goals of the task "tour", each at `radius` from the last.
      obstacles: given boxes [m]; empty to draw `boxes` of them.
      boxes: number of boxes to draw between start and goal.
      box_half_width: (least, most) of a drawn box [L].
      box_height: of a drawn box [L].
      clearance: of planned paths, between the centre of mass and the boxes [L].
      headroom: height of a box's underside above z = 0 from which planned paths lead under it [L]. The
        shipped robots with rods rest 0.7 to 0.8 L high.
      cell: of the grid for paths around boxes [L].
      moves: "diagonal" (8 neighbours) or "manhattan" (4).
    """

    name: Literal["reach", "reach_among_boxes", "obstacle_course", "tour"] = "reach"
    goal: tuple[Metres, Metres] | None = None
    radius: Range = (1.5, 2.5)
    tolerance: PositiveRobotLengths = 0.17
    seconds: EpisodeSeconds = 60.0
    along: Weight = 0.5
    final: Weight = 1.0
    broadside: Weight = 0.0
    turn: RobotLengths = 0.0
    aside: Annotated[float, Bounds(1, 100)] = 3.0
    arrival: Weight = 0.0
    near: Weight = 0.005
    course: Place = "s_course"
    spread: RobotLengths = 0.5
    stops: Annotated[int, Bounds(1, 100)] = 3
    obstacles: tuple[Box, ...] = Field(default=(), max_length=MOST_BOXES)
    boxes: Annotated[int, Bounds(1, 100)] = 2
    box_half_width: Range = (0.15, 0.35)
    box_height: PositiveRobotLengths = 0.5
    clearance: RobotLengths = 0.5
    headroom: PositiveRobotLengths = 0.8
    cell: Annotated[float, Bounds(0.001, 10, "L")] = 0.1
    moves: Literal["diagonal", "manhattan"] = "diagonal"

    @model_validator(mode="after")
    def _has_one_source_of_goals(self) -> Self:
        if self.goal is not None and self.name in ("obstacle_course", "tour"):
            own = "its course's" if self.name == "obstacle_course" else "drawn"
            raise ValueError(
                f"the goals of the task {self.name!r} are {own}, but goal={self.goal} is given; leave it "
                "out, or ask for 'reach' or 'reach_among_boxes'"
            )
        return self

    @model_validator(mode="after")
    def _ranges_rise_from_zero(self) -> Self:
        for name in ("radius", "box_half_width"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} needs 0 < least <= most, got {(low, high)}")
        if self.radius[0] <= self.tolerance:
            raise ValueError(
                f"goals at {self.radius[0]} L would be reached at the start already: the "
                f"tolerance is {self.tolerance} L"
            )
        return self
