"""All problems of an MJCF at once: whoever mends one after the other is led astray by their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from flywheel.errors import MjcfError, RobotError

T = TypeVar("T")


class Several(RobotError):
    """More than one problem.

    Args:
      problems: in the order in which they were found.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(listed(problems))
        self.problems = tuple(problems)


class Problems:
    """Problems in the order in which they were found, the decisive ones first."""

    def __init__(self) -> None:
        self._found: list[str] = []

    def add(self, problem: str) -> None:
        """One more."""
        self._found.append(problem)

    def attempt(self, read: Callable[[], T]) -> T | None:
        """The result of reading something, or None with its problems added."""
        try:
            return read()
        except Several as error:
            self._found.extend(error.problems)
        except RobotError as error:
            self.add(str(error))
        return None

    def check(self, bad_input: bool = False) -> None:
        """Refuse an MJCF that has any.

        Args:
          bad_input: MuJoCo refuses it, too.

        Raises:
          MjcfError: it has, and is bad input; the message says all of them.
          RobotError: it has.
        """
        if self._found and bad_input:
            raise MjcfError(listed(self._found))
        if len(self._found) > 1:
            raise Several(self._found)
        if self._found:
            raise RobotError(self._found[0])


def listed(problems: Sequence[str]) -> str:
    """All problems in one message, numbered if they are several."""
    if len(problems) == 1:
        return problems[0]
    return "\n".join(["", *(f"{i}. {each}" for i, each in enumerate(problems, 1))])
