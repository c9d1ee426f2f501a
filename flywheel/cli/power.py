"""`flywheel power`: what commands would show."""

from __future__ import annotations

import json
from pathlib import Path

from flywheel.cli.diagnose import library_of
from flywheel.cli.experiment import about_plant, length_of
from flywheel.cli.plants import open_plant
from flywheel.cli.show import Out, console, table
from flywheel.data.recordings.commands import read_commands
from flywheel.diagnosis.experiments.power import ENOUGH, Power, Prospect, power
from flywheel.outputs import check_outputs, write_output
from flywheel.reports.experiment_page import confusions, power_sentence, write_power


def foretell(
    commands: Path,
    robot_name: str,
    noise: str,
    size: float,
    effects: str,
    window: float | None,
    dt: float,
    threads: int,
    page: Path | None,
    answer: Path | None,
) -> None:
    """Say what a script would show; print it, and write page and JSON if asked."""
    check_outputs({"page": page, "JSON": answer}, inputs=[commands, robot_name])
    plant = open_plant(robot_name, dt, threads)
    robot, out = plant.robot, console()
    controls, sigma = read_commands(commands, robot, dt), length_of(noise, robot)
    found = power(plant, controls, sigma, library_of(effects), size, seconds=window)
    _show(out, found)
    if page is not None:
        about = {"commands": commands.name, **about_plant(plant)}
        out.say(f"Page: {write_power(found, page, about)}")
    if answer is not None:
        write_output(answer, json.dumps(found.summary(), indent=1) + "\n")
        out.say(f"JSON: {answer}")


def _show(out: Out, found: Power) -> None:
    out.say(power_sentence(found), style="bold")
    columns = ("effect", "at", "#smallest seen", "unit", "#/ typical", "most like", "#|cos|")
    title = f"noise {1000 * found.sigma:.2f} mm; {ENOUGH:g} sigma count as seen, and as told apart"
    rows = [_row(prospect) for prospect in found.prospects]
    last = f"#apart at {found.size:g} typical, in sigma"
    out.print(table(title, (*columns, last), rows))
    for words in confusions(found):
        out.say(words)


def _row(prospect: Prospect) -> tuple[object, ...]:
    candidate = prospect.candidate
    names = (candidate.effect.name, candidate.location)
    if not prospect.visible:
        return (*names, "invisible", "", None, "", None, None)
    parameter, rival = candidate.effect.sizes[0], prospect.rival
    return (
        *names,
        prospect.smallest * candidate.typical[0],
        parameter.unit,
        prospect.smallest,
        "" if rival is None else rival.label,
        prospect.likeness,
        None if rival is None else prospect.separation,
    )
