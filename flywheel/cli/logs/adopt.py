"""`flywheel adopt`: add the identified effects to the plant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flywheel.cli.console import console, table
from flywheel.cli.options import LawFiles
from flywheel.quantities import Bounds

if TYPE_CHECKING:
    from flywheel.effects import AdoptedPlant


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
    from flywheel.diagnosis.results.answer import Answer
    from flywheel.effects import AdoptedPlant
    from flywheel.errors import DataError
    from flywheel.robots import load_robot

    summary, library = _read(answer_file), Library.of(effects_from)
    parent = adopted_file(robot)
    diagnosed = load_robot(robot) if parent is None else AdoptedPlant.read(parent)[1]
    about = Answer.of(summary).robot
    if about.digest != diagnosed.digest:
        raise DataError(
            f"{answer_file} is about {about.name or 'an unknown robot'} ({about.digest[:12]}), not "
            f"{diagnosed.name} ({diagnosed.digest[:12]})."
        )
    path = adoption.adopt(summary, diagnosed, out, answer, parent, library.known)
    plant, _ = AdoptedPlant.read(path)
    rows = [
        (effect.effect, effect.location, name, value)
        for effect in plant.effects
        for name, value in effect.parameters.items()
    ]
    shown = console()
    shown.print(table(f"{path.parent}", ("effect", "at", "parameter", "#value"), rows))
    own = "".join(f" --effects-from {path.parent / law.file}" for law in plant.effects_from)
    for line in (
        f"Diagnose and compare with --robot {path.parent}{own}.",
        (
            f"Run with effects={path}{_in_run(path.parent, plant)}: data are then simulated on this "
            "plant."
        ),
    ):
        shown.print(line, soft_wrap=True, markup=False)


def _in_run(folder: Path, plant: AdoptedPlant) -> str:
    """The override of a run that names the law files of a plant."""
    files = ",".join(str(folder / law.file) for law in plant.effects_from)
    return f" 'effects_from=[{files}]'" if files else ""


def _read(path: Path) -> dict[str, Any]:
    from flywheel.errors import DataError
    from flywheel.files import read_json

    summary = read_json(path, "answer", DataError)
    if not isinstance(summary, dict) or "answer_set" not in summary:
        raise DataError(f"{path} is not the JSON of `flywheel diagnose`: it has no answer_set.")
    return summary
