"""A user's own link: whatever goes wrong in it is a robot that is lost, with the line where it went wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from traceback import extract_tb
from typing import Any

import numpy as np

from flywheel.errors import ConfigError, FlywheelError, LinkError
from flywheel.records import Floats
from flywheel.robot_link.protocol import RobotInfo, RobotLink, Sample
from flywheel.robots import Robot


def made(
    make: Callable[..., Any], name: str, robot: Robot, arguments: Mapping[str, Any], **more: Any
) -> Any:
    """A link of a class, with the user's arguments, which win over `more`.

    Raises:
      ConfigError: it takes other arguments.
    """
    try:
        return make(robot, **{**more, **arguments})
    except TypeError as error:
        raise ConfigError(
            f"{name} cannot be made from a robot and {dict(arguments)}: {error}."
        ) from None


class OwnLink:
    """A link of a user's class. Implements `RobotLink`.

    Args:
      name: of the class, as MODULE:CLASS.
      make: returns the user's link.
      robot: first argument of the class.
      arguments: the others.

    Raises:
      ConfigError: it takes other arguments, or is no link.
      LinkError: it raises anything else.
    """

    def __init__(
        self, name: str, make: Callable[..., Any], robot: Robot, arguments: Mapping[str, Any]
    ) -> None:
        self._name = name
        with self._called("cannot be made"):
            link = made(make, name, robot, arguments)
        with self._called("info"):
            if not isinstance(link, RobotLink) or not isinstance(link.info, RobotInfo):
                raise ConfigError(
                    f"{name} is not a RobotLink: it needs info, a RobotInfo, and reset, observe, send, stop "
                    "and close."
                )
            self.own: RobotLink = link
            self.info = replace(
                link.info,
                points=tuple(link.info.points),
                winches=tuple(link.info.winches),
                control_low=np.asarray(link.info.control_low, float),
                control_high=np.asarray(link.info.control_high, float),
            )

    def reset(self, seed: int = 0) -> None:
        """As the user's link does."""
        with self._called("reset"):
            self.own.reset(seed)

    def observe(self) -> Sample:
        """The sample of the user's link, checked."""
        with self._called("observe"):
            sample = self.own.observe()
            points, winch = np.asarray(sample.points, float), np.asarray(sample.winch, float)
            return self.info.check(Sample(float(sample.time), float(sample.stamp), points, winch))

    def send(self, controls: Floats, valid_until: float) -> None:
        """As the user's link does."""
        with self._called("send"):
            self.own.send(controls.copy(), valid_until)

    def stop(self) -> None:
        """As the user's link does."""
        with self._called("stop"):
            self.own.stop()

    def close(self) -> None:
        """As the user's link does."""
        with self._called("close"):
            self.own.close()

    @contextmanager
    def _called(self, what: str) -> Iterator[None]:
        """Whatever is raised, as a LinkError with its place."""
        try:
            yield
        except FlywheelError:
            raise
        except Exception as error:
            place = extract_tb(error.__traceback__)[-1]
            raise LinkError(
                f"{self._name}, {what}: {type(error).__name__}: {error} ({place.filename}, line "
                f"{place.lineno})"
            ) from error
