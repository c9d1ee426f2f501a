"""What a user can choose about tasks."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from flywheel.robots import Box

Range = tuple[float, float]


class TaskConfig(BaseModel):
    """Tasks to draw, and what they cost. Lengths are in units of the robot's length L.

    Attributes:
      name: kind of task, as in `TASKS`.
      goal: (x, y) where it is given [m]; None to draw it. For the reaching tasks only.
      radius: (least, most) distance of a drawn goal from the start [L]; its bearing is uniform.
      tolerance: distance at which the goal counts as reached [L]. 0.17 L is the 0.5 m of published
        planners, for rods of 2.95 m.
      seconds: time limit [s].
      along: weight of the distance to the goal, averaged over the horizon (the paper's alpha1).
      final: weight of the distance to the goal at the end of the horizon.
      broadside: weight of the robot's spread along the way to the goal. It makes a long robot turn
        sooner; too much of it makes the robot stretch itself out across the way, and stay.
      arrival: reward for reaching the goal within the horizon.
      near: weight alpha2 of the collision term, among boxes only.
      course: of the task "obstacle_course": the name of a shipped one, or the path of an MJCF.
      spread: radius around the course's start and goals within which they are drawn [L].
      stops: number of goals of the task "tour", one `radius` after the other.
      obstacles: boxes where they are given [m]; none to draw `boxes` of them.
      boxes: number of boxes to draw between start and goal.
      box_half_width: (least, most) of a drawn box [L].
      box_height: of a drawn box [L].
      clearance: that planned ways keep between the centre of mass and the boxes [L].
      cell: of the grid on which ways around boxes are found [L].
      moves: "diagonal" (8 neighbours) or "manhattan" (4).
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Literal["reach", "reach_among_boxes", "obstacle_course", "tour"] = "reach"
    goal: tuple[float, float] | None = None
    radius: Range = (1.5, 2.5)
    tolerance: float = Field(default=0.17, gt=0)
    seconds: float = Field(default=60.0, gt=0)
    along: float = Field(default=0.5, ge=0)
    final: float = Field(default=1.0, ge=0)
    broadside: float = Field(default=0.0, ge=0)
    arrival: float = Field(default=0.0, ge=0)
    near: float = Field(default=0.005, ge=0)
    course: str = "s_course"
    spread: float = Field(default=0.5, ge=0)
    stops: int = Field(default=3, ge=1)
    obstacles: tuple[Box, ...] = ()
    boxes: int = Field(default=2, ge=1)
    box_half_width: Range = (0.15, 0.35)
    box_height: float = Field(default=0.5, gt=0)
    clearance: float = Field(default=0.5, ge=0)
    cell: float = Field(default=0.1, gt=0)
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
                f"goals at {self.radius[0]} L would be reached at the start already: the tolerance "
                f"is {self.tolerance} L"
            )
        return self
