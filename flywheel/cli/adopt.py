"""`flywheel adopt`: what was found becomes part of the plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flywheel.cli.plants import adopted_file
from flywheel.cli.show import console, table
from flywheel.diagnosis.adoption import adopt
from flywheel.diagnosis.results.answer import Answer
from flywheel.effects import AdoptedPlant
from flywheel.errors import DataError
from flywheel.files import read_json
from flywheel.robots import load_robot


def take_over(answer_file: Path, robot_name: str, folder: Path, answer: int | None) -> None:
    """Write the next version of the plant that was diagnosed, and show what it has."""
    summary = _read(answer_file)
    parent = adopted_file(robot_name)
    robot = load_robot(robot_name) if parent is None else AdoptedPlant.read(parent)[1]
    about = Answer.of(summary).robot
    if about.digest != robot.digest:
        raise DataError(
            f"{answer_file} is about {about.name or 'an unknown robot'} ({about.digest[:12]}), not "
            f"{robot.name} ({robot.digest[:12]})."
        )
    path = adopt(summary, robot, folder, answer, parent)
    plant, _ = AdoptedPlant.read(path)
    rows = [
        (effect.effect, effect.location, name, value)
        for effect in plant.effects
        for name, value in effect.parameters.items()
    ]
    out = console()
    out.print(table(f"{path.parent}", ("effect", "at", "parameter", "#value"), rows))
    for line in (
        f"Diagnose and compare with --robot {path.parent}.",
        f"Run with effects={path}: data are then simulated on this plant.",
    ):
        out.print(line, soft_wrap=True, markup=False)


def _read(path: Path) -> dict[str, Any]:
    summary = read_json(path, "answer", DataError)
    if not isinstance(summary, dict) or "answer_set" not in summary:
        raise DataError(f"{path} is not the JSON of `flywheel diagnose`: it has no answer_set.")
    return summary
