"""`flywheel power`: effects that commands would show, before an experiment is made."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.logs.diagnose import SetOption, about_settings, changes_of
from flywheel.cli.options import (
    TYPICAL_SIZES,
    DtOption,
    EffectsFromOption,
    EffectsOption,
    JsonOption,
    NoiseOption,
    PageOption,
    PlantOption,
    ThreadsOption,
    WindowOption,
    length_of,
    within,
)

if TYPE_CHECKING:
    from flywheel.diagnosis.experiments.power import Power, Prospect


def power(
    commands: Annotated[
        Path, typer.Argument(metavar="CSV", help="Columns time and ctrl.<actuator>.")
    ],
    robot: PlantOption,
    noise: NoiseOption = "0.003",
    size: Annotated[
        float,
        typer.Option(
            help="Size of the effects to distinguish, in typical sizes.",
            callback=within(TYPICAL_SIZES),
        ),
    ] = 1.0,
    effects: EffectsOption = "",
    effects_from: EffectsFromOption = None,
    window: WindowOption = None,
    settings: SetOption = None,
    dt: DtOption = 0.01,
    threads: ThreadsOption = 2,
    page: PageOption = None,
    json: JsonOption = None,
) -> None:
    """Predict which effects an experiment could show: their smallest sizes, and similar effects.

    [bold]Example[/bold]

    flywheel power commands.csv --robot prism3 --noise 5mm --page power.html
    """
    from flywheel.cli.models import Library, about_plant, open_plant
    from flywheel.data.recordings.commands import read_commands
    from flywheel.diagnosis.experiments.power import power as foreseen
    from flywheel.diagnosis.settings import Settings, changed
    from flywheel.outputs import check_outputs
    from flywheel.reports.experiment_page import write_power

    inputs: list[str | Path] = [commands, *(effects_from or []), robot]
    check_outputs({"page": page, "JSON": json}, inputs=inputs)
    library, out = Library.of(effects_from), console()
    plant = open_plant(robot, dt, threads, library)
    asked = library.asked(effects, plant.robot)
    tuned = changed(Settings(), changes_of(settings or []))
    controls = read_commands(commands, plant.robot, dt)
    sigma = length_of(noise, plant.robot)
    found = foreseen(plant, controls, sigma, asked, size, None, window, tuned)
    _show(out, found)
    if page is not None:
        about = {
            "commands": commands.name,
            **about_plant(plant),
            **library.about,
            **about_settings(tuned),
        }
        out.say(f"Page: {write_power(found, page, about)}")
    out.keep_json(json, {**found.summary(), **library.provenance})


def _show(out: Out, found: Power) -> None:
    from flywheel.reports.experiment_page import confusions, power_sentence

    out.say(power_sentence(found), style="bold")
    columns = ("effect", "at", "#smallest visible", "unit", "#/ typical", "most like", "#|cos|")
    title = (
        f"noise {1000 * found.sigma:.2f} mm; {found.enough:g} sigma count as visible, and as "
        "distinguished"
    )
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
