"""Settings that count only beside others. One given on the command line without these is refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from flywheel.errors import ConfigError
from flywheel.files import shown

Counts = Callable[[Any], bool]  # of a `RunConfig`


def _task(*names: str) -> tuple[str, Counts]:
    return f"task.name={' or '.join(names)}", lambda config: config.task.name in names


def _kind(*kinds: str) -> tuple[str, Counts]:
    names = " or ".join(kinds)
    return f"{names} in terrain.kinds", lambda config: not {*kinds}.isdisjoint(config.terrain.kinds)


_ON_COURSES = (
    "task.name=obstacle_course, collect.courses or evaluate.unseen",
    lambda config: (
        config.task.name == "obstacle_course"
        or bool(config.collect.courses or config.evaluate.unseen)
    ),
)
_DRAWN_GOALS = (
    "task.name=reach, reach_among_boxes or tour, and no task.goal",
    lambda config: config.task.name != "obstacle_course" and config.task.goal is None,
)
_DRAWN_BOXES = (
    "task.name=reach_among_boxes, and no task.obstacles",
    lambda config: config.task.name == "reach_among_boxes" and not config.task.obstacles,
)
# A setting, or all settings below it -> what it needs in words, and whether a configuration has that. Those
# of a part with the setting `on` need that one, and are not listed.
NEEDS: dict[str, tuple[str, Counts]] = {
    "task.course": _task("obstacle_course"),
    "task.spread": _ON_COURSES,
    "task.stops": _task("tour"),
    "task.radius": _DRAWN_GOALS,
    "task.obstacles": _task("reach_among_boxes"),
    "task.boxes": _DRAWN_BOXES,
    "task.box_half_width": _DRAWN_BOXES,
    "task.box_height": _DRAWN_BOXES,
    "terrain.slope": _kind("slope"),
    "terrain.bump_height": _kind("bumps"),
    "terrain.bump_length": _kind("bumps"),
    "terrain.step_height": _kind("steps"),
    "terrain.step_length": _kind("steps"),
    "terrain.size": _kind("slope", "bumps", "steps"),
    "terrain.cell": _kind("slope", "bumps", "steps"),
    "evaluate.floor_window": ("evaluate.floor=true", lambda config: config.evaluate.floor),
}


def check_heard(config: Any, overrides: Sequence[str]) -> None:
    """Check that each override counts in the `RunConfig` that it is part of.

    Raises:
      ConfigError: one has no effect; the message names the setting that it needs.
    """
    missing = {setting: words for setting, (words, counts) in NEEDS.items() if not counts(config)}
    for name, part in config:
        if not getattr(part, "on", True):
            settings = [each for each in type(part).model_fields if each != "on"]
            missing |= dict.fromkeys([f"{name}.{each}" for each in settings], f"{name}.on=true")
    for override in overrides:
        for setting, needs in missing.items():
            if re.match(rf"{re.escape(setting)}(?![a-z_])", override):
                raise ConfigError(
                    f"{shown(override)} has no effect: {setting} needs {needs}. Give that as well, or leave "
                    "it out."
                )
