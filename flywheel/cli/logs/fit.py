"""`flywheel fit`: fit a baseline to a robot's logs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import end_if_stopped
from flywheel.cli.logs.correct import SetOption, settings_of
from flywheel.cli.options import DtOption, JsonOption, PlantOption, within
from flywheel.quantities import SEED

if TYPE_CHECKING:
    from flywheel.training.baselines import Fitted

MODEL = "model"


class Baseline(StrEnum):
    """Baselines that are fitted."""

    arx = "arx"
    tdpe = "tdpe"


class Attachments(StrEnum):
    """Knowledge about the attachments of the cables."""

    mjcf = "mjcf"
    heuristic = "heuristic"
    uninformed = "uninformed"


def fit(
    model: Annotated[
        Baseline, typer.Argument(help="arx (linear) or tdpe (the rigid-body engine).")
    ],
    recordings: Annotated[list[Path], typer.Argument(metavar="CSV...", help="Logs for the fit.")],
    robot: PlantOption,
    out: Annotated[Path, typer.Option(help="Output file of the model.")] = Path("fitted.npz"),
    attachments: Annotated[
        Attachments | None,
        typer.Option(
            help="Attachments of the engine's cables: the MJCF's, on the circles of the end caps, or (the "
            "default) the end caps' centres."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the fit.", callback=within(SEED))] = 0,
    settings: SetOption = None,
    dt: DtOption = 0.01,
    json: JsonOption = None,
) -> None:
    """Fit a baseline to a robot's logs, as a yardstick for a network.

    A fifth of the logs is held out: it decides on the ridge of the linear model, and on the step at which
    the engine's contact numbers are kept. Ctrl-C or SIGTERM writes the best numbers so far.

    [bold]Example[/bold]

    flywheel fit tdpe monday.csv tuesday.csv --robot prism3 --attachments heuristic --out tdpe.npz
    """
    from flywheel.cli.logs.reading import read_logs
    from flywheel.cli.models import open_plant
    from flywheel.dynamics.baselines.weights import FITTED, BaselineWeights
    from flywheel.errors import ConfigError
    from flywheel.outputs import check_outputs
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress
    from flywheel.training.baselines import FITS, FitSettings

    if out.suffix == ".json":
        raise ConfigError(f"--out is the file of the weights, which end in .npz; got {out.name}.")
    if attachments and model is not Baseline.tdpe:
        raise ConfigError(f"--attachments is for tdpe; {model.value} has none.")
    outputs = {"model": out, "side file of the model": out.with_suffix(".json"), "JSON": json}
    check_outputs(outputs, inputs=[*recordings, robot])
    given: dict[str, Any] = {"attachments": attachments.value} if attachments else {}
    config, fitting = settings_of(
        settings or [], (FITTED[model].Config, given), (FitSettings, {"seed": seed}), MODEL
    )
    owner, shown = open_plant(robot, dt).robot, console()
    tracks = [each.trajectory for each in read_logs(recordings, owner, dt, shown)]
    with StopRequest() as stop, console_progress().stage("fit", 1.0) as stage:
        found = FITS[model](owner, dt, tracks, config, fitting, stage.update, stop)
    notes = {"before": found.before, "error": found.error, "windows": found.windows, **found.about}
    names = [path.name for path in recordings]
    digest = BaselineWeights.of(found.model).write(out, {**notes, "recordings": names})
    _show(shown, found, out, robot, names)
    shown.keep_json(json, {**notes, "digest": digest})
    end_if_stopped(stop, "these are the best numbers so far")


def _show(out: Out, found: Fitted, path: Path, robot: str, recordings: list[str]) -> None:
    rows = [("before the fit", found.before), ("fitted", found.error)]
    heads = ("", "#RMSE / L of the tracked points [%]")
    out.print(table(f"{found.windows} held-out windows", heads, rows))
    out.print(table("Fit", ["number", "#value"], list(found.about.items())))
    out.say(f"Model: {path}")
    log = recordings[0] if recordings else "log.csv"
    out.say(f"next: flywheel compare {log} --robot {robot} --model plant --model {path}")
