"""`flywheel design`: commands that distinguish effects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import end_if_stopped
from flywheel.cli.logs.diagnose import SetOption, about_settings, changes_of
from flywheel.cli.options import (
    TYPICAL_SIZES,
    DtOption,
    EffectsFromOption,
    JsonOption,
    NoiseOption,
    PageOption,
    PlantOption,
    ThreadsOption,
    length_of,
    within,
)
from flywheel.quantities import HORIZON_SECONDS, SAMPLES, SEED

if TYPE_CHECKING:
    from flywheel.diagnosis.experiments.design import Design
    from flywheel.runtime.pool.progress import Stage

Rivals = Annotated[
    list[str],
    typer.Argument(
        metavar="EFFECT EFFECT...", help="Effects, at any place (payload) or at one (payload@s2)."
    ),
]
SizeOption = Annotated[
    float,
    typer.Option(help="Size of the effects, in typical sizes.", callback=within(TYPICAL_SIZES)),
]
SecondsOption = Annotated[
    float, typer.Option(help="Length of the script, in seconds.", callback=within(HORIZON_SECONDS))
]
CandidatesOption = Annotated[
    int,
    typer.Option(
        help="Number of drawn scripts; as many variations follow.", callback=within(SAMPLES)
    ),
]


def design(
    rivals: Rivals,
    robot: PlantOption,
    noise: NoiseOption = "0.003",
    size: SizeOption = 1.0,
    seconds: SecondsOption = 3.0,
    candidates: CandidatesOption = 64,
    effects_from: EffectsFromOption = None,
    settings: SetOption = None,
    seed: Annotated[
        int, typer.Option(help="Seed of all random numbers.", callback=within(SEED))
    ] = 0,
    dt: DtOption = 0.01,
    threads: ThreadsOption = 2,
    out: Annotated[Path, typer.Option(help="Output file of the commands.")] = Path("commands.csv"),
    page: PageOption = None,
    json: JsonOption = None,
) -> None:
    """Write the commands that best distinguish effects between which a diagnosis could not decide.

    Ctrl-C or SIGTERM writes the best commands so far.

    [bold]Example[/bold]

    flywheel design cable_friction capstan --robot prism3 --out to_tell.csv
    """
    from flywheel.cli.models import Library, about_plant, open_plant
    from flywheel.data.recordings.commands import write_commands
    from flywheel.diagnosis.experiments.design import Designer
    from flywheel.diagnosis.selection.candidates import Rival
    from flywheel.diagnosis.settings import Settings, changed
    from flywheel.reports.experiment_page import write_design
    from flywheel.runtime.config.demand import check_predictions
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress

    predictions = candidates * (1 + len(rivals))  # of each script, and with each rival
    check_predictions(predictions, seconds, dt, "--candidates, effects, --seconds, --dt")
    _check_outputs([robot, *(effects_from or [])], out, page, json)
    library, shown = Library.of(effects_from), console()
    plant = open_plant(robot, dt, threads, library)
    named = [Rival.named(name, plant.robot, library.known) for name in rivals]
    tuned = changed(Settings(), changes_of(settings or []))
    designer = Designer(plant, named, length_of(noise, plant.robot), size, settings=tuned)
    with StopRequest() as stop, console_progress().stage("try scripts", 2 * candidates) as stage:
        told = partial(_tell, stage)
        found = designer.design(seconds, candidates, seed, told, stop)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_commands(found.controls, dt, out, plant.robot)
    _show(shown, found)
    shown.say(f"Commands: {out}")
    if page is not None:
        about = {"commands": out.name, "seed": str(seed), **about_plant(plant)}
        about |= library.about | about_settings(tuned)
        winches = [winch.name for winch in plant.robot.winches]
        shown.say(f"Page: {write_design(found, page, about, winches)}")
    shown.keep_json(json, {**found.summary(), **library.provenance})
    end_if_stopped(stop, "these are the best commands so far")


def _tell(stage: Stage, tried: int, best: float) -> None:
    stage.update(tried, f"best {best:.1f} sigma")


def _check_outputs(
    inputs: Sequence[str | Path], script: Path, page: Path | None, json: Path | None
) -> None:
    """Check that all outputs can be written, and that no script is overwritten.

    Raises:
      DataError: an output cannot be written, or the script exists already.
    """
    from flywheel.errors import DataError
    from flywheel.outputs import check_outputs

    check_outputs({"script": script, "page": page, "JSON": json}, inputs=inputs)
    if script.exists():
        raise DataError(f"The file {script} exists already; it is not overwritten.")


def _show(out: Out, found: Design) -> None:
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
