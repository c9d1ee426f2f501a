"""`flywheel adopt`: add the identified effects to the plant."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flywheel.cli.console import console, table
from flywheel.cli.options import LawFiles
from flywheel.quantities import Bounds

if TYPE_CHECKING:
    from flywheel.effects import AdoptedPlant
    from flywheel.robots import Robot


def adopt(
    answer_file: Annotated[Path, "JSON"],
    *,
    robot: str,
    out: Path = Path("plants"),
    answer: Annotated[int | None, Bounds(1, 1000)] = None,
    effects_from: LawFiles = (),
) -> None:
    """Add the identified effects to the plant, as a new version of it.

    Nothing is overwritten: to go back, use an earlier version.

    [bold]Example[/bold]

    flywheel adopt answer.json --robot my_robot.xml

    Args:
      answer_file: Output of `flywheel diagnose --json`.
      robot: Robot of the diagnosis, as given there.
      out: Folder of the versions.
      answer: Number of the answer, from 1; also accepts answers rejected by held-out recordings.
      effects_from: A Python file with effects of your own, which is run. Repeatable.
    """
    from flywheel.cli.models import Library, adopted_file
    from flywheel.diagnosis import adoption
    from flywheel.effects import AdoptedPlant

    summary, library = _read(answer_file), Library.of(effects_from)
    parent = adopted_file(robot)
    diagnosed = _diagnosed(answer_file, summary, robot, parent)
    path = adoption.adopt(summary, diagnosed, out, answer, parent, library.known)
    _show(path, AdoptedPlant.read(path)[0])


def _diagnosed(file: Path, summary: dict[str, Any], name: str, parent: Path | None) -> Robot:
    """The robot of a name, whose plant an answer is about.

    Raises:
      DataError: it is about another robot, or about a plant with other effects.
    """
    from flywheel.diagnosis.results.answer import Answer
    from flywheel.effects import AdoptedPlant
    from flywheel.errors import DataError
    from flywheel.robots import load_robot

    there: list[str] = []
    if parent is None:
        robot = load_robot(name)
    else:
        plant, robot = AdoptedPlant.read(parent)
        there = [effect.label for effect in plant.effects]
    about = Answer.of(summary).robot
    if about.digest != robot.digest:
        raise DataError(
            f"{file} is about {about.name or 'an unknown robot'} ({about.digest[:12]}), not "
            f"{robot.name} ({robot.digest[:12]})."
        )
    if about.effects is not None and sorted(about.effects) != sorted(there):
        then, now = (", ".join(labels) or "no effect" for labels in (about.effects, there))
        raise DataError(
            f"{file} is about a plant with {then}; {name} has {now}. An answer replaces all effects of "
            "its plant: name the robot as `diagnose` did, or diagnose this one."
        )
    return robot


def _show(path: Path, plant: AdoptedPlant) -> None:
    """Print an adopted plant's effects, and how to use its file."""
    rows = [
        (effect.effect, effect.location, name, value)
        for effect in plant.effects
        for name, value in effect.parameters.items()
    ]
    shown, folder = console(), str(path.parent)
    shown.print(table(folder, ("effect", "at", "parameter", "#value"), rows))
    laws = [str(path.parent / law.file) for law in plant.effects_from]
    options = [word for law in laws for word in ("--effects-from", law)]
    run = [f"effects={path}", *([f"effects_from=[{','.join(laws)}]"] if laws else [])]
    for line in (
        f"Diagnose and compare with {shlex.join(['--robot', folder, *options])}.",
        f"Run with {shlex.join(run)}: data are then simulated on this plant.",
    ):
        shown.print(line, soft_wrap=True, markup=False)


def _read(path: Path) -> dict[str, Any]:
    from flywheel.errors import DataError
    from flywheel.files import read_json

    summary = read_json(path, "answer", DataError)
    if not isinstance(summary, dict) or "answer_set" not in summary:
        raise DataError(f"{path} is not the JSON of `flywheel diagnose`: it has no answer_set.")
    return summary
