"""`flywheel design`: commands that distinguish effects."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import end_if_stopped
from flywheel.cli.logs.diagnose import about_settings, changes_of
from flywheel.cli.options import (
    ChannelStatements,
    PlantOptions,
    SettingStatements,
    channels_of,
    length_of,
)
from flywheel.options import DesignOptions

if TYPE_CHECKING:
    from flywheel.diagnosis.experiments.design import Design
    from flywheel.runtime.pool.progress import Stage

MANY = "--candidates, effects, --seconds, --dt"  # options that make too many predictions


def design(
    rivals: Annotated[list[str], "EFFECT EFFECT..."],
    *,
    chosen: PlantOptions,
    noise: str = "0.003",
    channel: ChannelStatements = (),
    options: DesignOptions = DesignOptions(),
    settings: SettingStatements = (),
    out: Path = Path("commands.csv"),
    page: Path | None = None,
    json: Path | None = None,
) -> None:
    """Write the commands that best distinguish effects between which a diagnosis could not decide.

    Ctrl-C or SIGTERM writes the best commands so far.

    [bold]Example[/bold]

    flywheel design cable_friction capstan --robot prism3 --out to_tell.csv

    Args:
      rivals: Effects, at any place (payload) or at one (payload@s2).
      noise: Noise of each coordinate: a fraction of the robot's length, or a length (9mm).
      out: Output file of the commands.
      page: Output file of an HTML page.
      json: Output file of the answer as JSON.
    """
    from flywheel.cli.models import about_plant, opened
    from flywheel.data.recordings.commands import write_commands
    from flywheel.diagnosis.experiments.design import Designer, Rival
    from flywheel.diagnosis.settings import Settings, changed
    from flywheel.outputs import check_new, check_outputs
    from flywheel.reports.experiment_page import write_design
    from flywheel.runtime.config.demand import check_predictions
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress

    predicted = options.candidates * (1 + len(rivals))  # of each script, and with each rival
    check_predictions(predicted, options.seconds, chosen.dt, MANY)
    check_outputs({"script": out, "page": page, "JSON": json}, inputs=chosen.files)
    check_new(out)
    (plant, library), shown = opened(chosen), console()
    named = [Rival.named(name, plant.robot, library.known) for name in rivals]
    tuned = changed(Settings(), changes_of(settings))
    sigma, beside = length_of(noise, plant.robot), channels_of(channel, plant.robot)
    designer = Designer(plant, named, sigma, options, tuned, beside)
    tries = console_progress().stage("try scripts", 2 * options.candidates)
    with StopRequest() as stop, tries as stage:
        found = designer.design(partial(_tell, stage), stop)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_commands(found.controls, plant.dt, out, plant.robot)
    _show(shown, found, out)
    if page is not None:
        about = {"commands": out.name, "seed": str(options.seed)}
        about |= about_plant(plant) | library.about | about_settings(tuned)
        names = [winch.name for winch in plant.robot.winches]
        shown.say(f"Page: {write_design(found, page, about, names)}")
    shown.keep_json(json, {**found.summary(), **library.provenance})
    end_if_stopped(stop, "these are the best commands so far")


def _tell(stage: Stage, tried: int, best: float) -> None:
    stage.update(tried, f"best {best:.1f} sigma")


def _show(out: Out, found: Design, script: Path) -> None:
    from flywheel.reports.experiment_page import design_sentence

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
    out.say(f"Commands: {script}")
