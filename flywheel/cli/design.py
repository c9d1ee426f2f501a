"""`flywheel design`: the commands that tell rivals apart."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from flywheel.cli.experiment import about_plant, length_of
from flywheel.cli.plants import open_plant
from flywheel.cli.show import Out, console, table
from flywheel.data.recordings.commands import write_commands
from flywheel.diagnosis.experiments.design import Design, Designer
from flywheel.diagnosis.selection.candidates import Rival
from flywheel.errors import DataError
from flywheel.outputs import check_outputs, write_output
from flywheel.reports.experiment_page import design_sentence, write_design
from flywheel.runtime.pool.progress import console_progress


def propose(
    names: Sequence[str],
    robot_name: str,
    noise: str,
    size: float,
    seconds: float,
    count: int,
    seed: int,
    dt: float,
    threads: int,
    script: Path,
    page: Path | None,
    answer: Path | None,
) -> None:
    """Find the script, write it, and say what it is worth."""
    check_outputs({"script": script, "page": page, "JSON": answer}, inputs=[robot_name])
    if script.exists():
        raise DataError(f"There is a file {script} already; it is not written over.")
    plant = open_plant(robot_name, dt, threads)
    robot, out = plant.robot, console()
    rivals = [Rival.named(name, robot) for name in names]
    designer = Designer(plant, rivals, length_of(noise, robot), size)
    with console_progress().stage("try scripts", 2 * count) as stage:
        found = designer.design(
            seconds, count, seed, lambda n, best: stage.update(n, f"best {best:.1f} sigma")
        )
    script.parent.mkdir(parents=True, exist_ok=True)
    write_commands(found.controls, dt, script, robot)
    _show(out, found)
    out.say(f"Commands: {script}")
    if page is not None:
        about = {"commands": script.name, "seed": str(seed), **about_plant(plant)}
        winches = [winch.name for winch in robot.winches]
        out.say(f"Page: {write_design(found, page, about, winches)}")
    if answer is not None:
        write_output(answer, json.dumps(found.summary(), indent=1) + "\n")
        out.say(f"JSON: {answer}")


def _show(out: Out, found: Design) -> None:
    out.say(design_sentence(found), style="bold")
    columns = ("rivals", "", "#|cos|", "#apart [sigma]", "#random: |cos|", "#random: apart [sigma]")
    rows = [
        (
            pair.first.label,
            pair.second.label,
            pair.likeness,
            pair.separation,
            pair.plain_likeness,
            pair.plain,
        )
        for pair in found.pairs
    ]
    title = (
        f"{found.tried} scripts tried ({found.unsafe} unsafe), noise {1000 * found.sigma:.2f} mm"
    )
    out.print(table(title, columns, rows))
