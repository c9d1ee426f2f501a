"""All problems of an MJCF at once: whoever mends one after the other is led astray by their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import mujoco

from flywheel.errors import MjcfError, RobotError

T = TypeVar("T")


class Alike(RobotError):
    """A problem of one element, told together with those that have the same.

    Args:
      kind: of the element: "tendon".
      name: of the element, as in a sentence: "'left'".
      sentence: with {} for the elements.
    """

    def __init__(self, kind: str, name: str, sentence: str) -> None:
        super().__init__(_about(kind, [name], sentence))
        self.parts = kind, name, sentence


class Problems:
    """Problems in the order in which they were found, the decisive ones first."""

    def __init__(self) -> None:
        self._found: dict[str | tuple[str, str], list[str]] = {}  # (kind, sentence) -> elements
        self._got: dict[tuple[str, str], list[str]] = {}  # their values
        self._bad_input = False

    def __len__(self) -> int:
        return len(self._found)

    def add(self, problem: str, bad_input: bool = False) -> None:
        """One more; bad input if there is no robot in such a file."""
        self._found[problem] = []
        self._bad_input |= bad_input

    def add_alike(self, kind: str, name: str, sentence: str, got: str = "") -> None:
        """One more, see `Alike`; `got` is the element's value, which the sentence ends with."""
        self._found.setdefault((kind, sentence), []).append(name)
        if got:
            self._got.setdefault((kind, sentence), []).append(got)

    def add_first(self, problem: str) -> None:
        """One more, before all others."""
        self._found = {problem: [], **self._found}

    def attempt(self, read: Callable[[], T]) -> T | None:
        """The result of reading something, or None with its problems added."""
        try:
            return read()
        except Alike as error:
            self.add_alike(*error.parts)
        except RobotError as error:
            for problem in problems_of(error):
                self.add(problem, isinstance(error, MjcfError))
        return None

    def check(self) -> None:
        """Refuse an MJCF that has any.

        Raises:
          MjcfError: it has, and one of them is bad input; the message says all of them.
          RobotError: it has.
        """
        if self._found:
            problems = [
                key if isinstance(key, str) else _about(key[0], names, key[1], self._got.get(key))
                for key, names in self._found.items()
            ]
            error = (MjcfError if self._bad_input else RobotError)(listed(problems))
            error.problems = tuple(problems)
            raise error


def called(model: mujoco.MjModel, kind: str, number: int) -> str:
    """An element of a kind ("tendon") in a sentence: its name, or its number if it has none."""
    name = getattr(model, kind)(number).name
    return repr(name) if name else f"number {number}"


def problems_of(error: RobotError) -> tuple[str, ...]:
    """The problems of a refused MJCF, one by one."""
    return error.problems or (str(error),)


def listed(problems: Sequence[str]) -> str:
    """All problems in one message, numbered if they are several."""
    if len(problems) == 1:
        return problems[0]
    return "\n".join(["", *(f"{i}. {each}" for i, each in enumerate(problems, 1))])


def _about(kind: str, names: Sequence[str], sentence: str, got: Sequence[str] | None = None) -> str:
    words = sentence.replace("{}", f"the {kind}{'s' if len(names) > 1 else ''} {', '.join(names)}")
    if got:
        words = f"{words.removesuffix('.')}; got {', '.join(dict.fromkeys(got))}."
    return words[0].upper() + words[1:]
