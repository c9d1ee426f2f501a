"""`flywheel power`: effects that commands would show, before an experiment is made."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flywheel.cli.console import Out, console, table
from flywheel.cli.logs.diagnose import about_settings, changes_of
from flywheel.cli.options import (
    ChannelStatements,
    PlantOptions,
    SettingStatements,
    channels_of,
    length_of,
)
from flywheel.options import PowerOptions

if TYPE_CHECKING:
    from flywheel.diagnosis.experiments.power import Power, Prospect


def power(
    commands: Annotated[Path, "CSV"],
    *,
    chosen: PlantOptions,
    noise: str = "0.003",
    channel: ChannelStatements = (),
    effects: str = "",
    options: PowerOptions = PowerOptions(),
    settings: SettingStatements = (),
    page: Path | None = None,
    json: Path | None = None,
) -> None:
    """Predict which effects an experiment could show: their smallest sizes, and similar effects.

    [bold]Example[/bold]

    flywheel power commands.csv --robot prism3 --noise 5mm --page power.html

    Args:
      commands: Columns time and ctrl.<actuator>.
      noise: Noise of each coordinate: a fraction of the robot's length, or a length (9mm).
      effects: Effects to consider, by name; all of the library by default.
      page: Output file of an HTML page.
      json: Output file of the answer as JSON.
    """
    from flywheel.cli.models import about_plant, opened
    from flywheel.data.recordings.commands import read_commands
    from flywheel.diagnosis.experiments.power import power as foreseen
    from flywheel.diagnosis.settings import Settings, changed
    from flywheel.outputs import check_outputs
    from flywheel.reports.experiment_page import write_power

    check_outputs({"page": page, "JSON": json}, inputs=[commands, *chosen.files])
    (plant, library), out = opened(chosen), console()
    asked = library.asked(effects, plant.robot)
    tuned = changed(Settings(), changes_of(settings))
    controls = read_commands(commands, plant.robot, plant.dt)
    sigma = length_of(noise, plant.robot)
    beside = channels_of(channel, plant.robot)
    found = foreseen(plant, controls, sigma, asked, options, tuned, beside)
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
    columns = ("effect", "at", "#smallest visible", "unit", "#/ typical")
    alone = () if found.by_points is None else ("#by points alone, / typical",)
    like = ("most like", "#|cos|", f"#apart at {found.size:g} typical, in sigma")
    title = (
        f"noise {1000 * found.sigma:.2f} mm; {found.enough:g} sigma count as visible, and as "
        "distinguished"
    )
    rows = [_row(prospect, found.bare_sizes) for prospect in found.prospects]
    out.print(table(title, (*columns, *alone, *like), rows))
    for words in confusions(found):
        out.say(words)


def _row(prospect: Prospect, by_points: Mapping[str, float]) -> tuple[object, ...]:
    candidate = prospect.candidate
    names = (candidate.effect.name, candidate.location)
    alone = [by_points[candidate.label]] if by_points else []
    if not prospect.visible:
        return (*names, "invisible", "", None, *alone, "", None, None)
    parameter, rival = candidate.effect.sizes[0], prospect.rival
    return (
        *names,
        prospect.smallest * candidate.typical[0],
        parameter.unit,
        prospect.smallest,
        *alone,
        "" if rival is None else rival.label,
        prospect.likeness,
        None if rival is None else prospect.separation,
    )
