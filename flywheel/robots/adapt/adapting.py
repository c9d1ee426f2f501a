"""Adaptation of an MJCF until it can be used: small adaptations, one after the other.

What `flywheel robot check` says of a refused file comes from the same adaptations: a problem is mended
by the one after which it is gone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

from flywheel.errors import RobotError
from flywheel.options import AdaptOptions
from flywheel.robots.adapt.copies import copies
from flywheel.robots.adapt.draft import Change, Draft
from flywheel.robots.adapt.files import includes, pictures
from flywheel.robots.adapt.made_winches import made_winches
from flywheel.robots.adapt.meshes import meshes
from flywheel.robots.adapt.names import names
from flywheel.robots.adapt.old_words import old_words
from flywheel.robots.adapt.points import points
from flywheel.robots.adapt.ranges import forces, limits, ranges
from flywheel.robots.adapt.ropes import ropes
from flywheel.robots.adapt.servos import as_winches, joined
from flywheel.robots.adapt.springs import beside_winches, pull_only
from flywheel.robots.adapt.start import fitting, start
from flywheel.robots.adapt.structure import bent, structural
from flywheel.robots.adapt.structures import from_structure, is_structure
from flywheel.robots.adapt.tensions import alone, tensions
from flywheel.robots.adapt.upright import upright
from flywheel.robots.problems import problems_of

# By name: first those of the text, without which MuJoCo may refuse it, then those of the robot.
OF_TEXT: dict[str, Callable[[Draft], Iterator[Change]]] = {
    "includes": includes,
    "files": pictures,
    "meshes": meshes,
    "old-words": old_words,
    "copies": copies,
    "names": names,
    "keys": fitting,
}
OF_ROBOT: dict[str, Callable[[Draft], Iterator[Change]]] = {
    "upright": upright,
    "ropes": ropes,
    "winches": made_winches,
    "joined": joined,
    "limits": limits,
    "tensions": tensions,
    "motors": alone,
    "servos": as_winches,
    "pull-only": pull_only,
    "springs": beside_winches,
    "forces": forces,
    "ranges": ranges,
    "points": points,
    "start": start,
}
STRUCTURE = "structure"  # name of what is made of a file that is no MJCF
ADAPTATIONS = OF_TEXT | OF_ROBOT
ENDING = 60  # characters by which a problem is known whose elements have other names, or are fewer


@dataclass(frozen=True)
class Adapted:
    """An MJCF after all adaptations.

    Attributes:
      xml: its text.
      changes: the names of adaptations, and their changes, in their order.
      mended: each problem of the MJCF before, those of structure first -> the adaptation after which
        it is gone; "" if it stays.
      left: problems that it still has.
    """

    xml: str
    changes: tuple[tuple[str, Change], ...]
    mended: dict[str, str]
    left: tuple[str, ...]


def adapt(path: str | Path, options: AdaptOptions = AdaptOptions()) -> Adapted:
    """Adapt the MJCF of a file, in memory. The cables of a structure that is no MJCF become winches.

    Args:
      path: of the file.
      options: requests, and names of what is left out.

    Raises:
      MjcfError: no such file, or neither an MJCF nor a structure.
    """
    root, made = None, []
    if is_structure(path):
        root, change = from_structure(path, options.unit, options.up)
        options, made = replace(options, winches=options.winches or ("*",)), [(STRUCTURE, change)]
    draft = Draft(path, options, root)
    run = _Run(draft)
    run.changes += made
    run.apply(OF_TEXT)
    if not run.stopped:
        run.apply(OF_ROBOT)
    if run.changes:
        ElementTree.indent(draft.root)
    return Adapted(draft.xml, tuple(run.changes), run.mended, run.left)


class _Run:
    """The adaptations of one draft.

    Attributes:
      changes: so far.
      left: problems that the draft has.
      mended: each problem that it had -> the adaptation after which it is gone.
      stopped: no adaptation can follow.
    """

    def __init__(self, draft: Draft) -> None:
        self._draft = draft
        self.changes: list[tuple[str, Change]] = []
        self.left = draft.problems()
        self.mended = dict.fromkeys(self.left, "")
        self.stopped = False
        self._first: dict[str, str] = {}  # problem -> the words in which it was told first

    def apply(self, adaptations: dict[str, Callable[[Draft], Iterator[Change]]]) -> None:
        """Apply some of them, as far as they can be."""
        of_text = adaptations is OF_TEXT
        for name, adaptation in adaptations.items():
            if name in self._draft.options.without:
                continue
            try:
                made = list(adaptation(self._draft))
            except RobotError as error:
                self._stop((*bent(self._draft), *problems_of(error)))
                return
            try:
                if made and not of_text:
                    self._draft.model  # noqa: B018  which MuJoCo still compiles
            except RobotError as error:
                refused = f"The adaptation {name!r} makes an MJCF that is refused: {error}"
                self._stop((*bent(self._draft), refused))
                return
            if made:
                self.changes += [(name, change) for change in made]
                self._look(name, of_text)
        if of_text and (found := structural(self._draft)):
            self._stop(found)

    def _look(self, name: str, of_text: bool) -> None:
        """See which problems are gone after an adaptation."""
        now = self._draft.problems()
        new = [problem for problem in now if problem not in self.left]
        for problem in self.left:
            first = self._first.get(problem, problem)
            rest = [each for each in new if each[-ENDING:] == problem[-ENDING:]]
            if problem not in now and not rest and first in self.mended:
                self.mended[first] = name
            self._first |= dict.fromkeys(rest, first)
        if of_text:  # what MuJoCo would not even compile has more to tell now
            more = (problem for problem in new if problem not in self._first)
            self.mended |= {problem: "" for problem in more if problem not in self.mended}
        self.left = now

    def _stop(self, problems: tuple[str, ...]) -> None:
        """Adapt no more; tell these problems first."""
        first = dict.fromkeys(problems, "")
        ends = {problem[-ENDING:] for problem in problems}
        self.mended = first | {p: n for p, n in self.mended.items() if p[-ENDING:] not in ends}
        self.left = (*first, *(each for each in self.left if each[-ENDING:] not in ends))
        self.stopped = True
