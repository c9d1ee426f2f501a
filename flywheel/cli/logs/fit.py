"""`flywheel fit`: fit a baseline to a robot's logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import end_if_stopped
from flywheel.cli.logs.correct import (
    ModelStatements,
    check_model_outputs,
    next_comparison,
    settings_of,
)
from flywheel.quantities import ControlStep, Seed

if TYPE_CHECKING:
    from flywheel.training.baselines import Fitted

MODEL = "model"


def fit(
    model: Literal["arx", "tdpe"],
    recordings: Annotated[list[Path], "CSV..."],
    *,
    robot: str,
    out: Path = Path("fitted.npz"),
    attachments: Literal["mjcf", "heuristic", "uninformed"] | None = None,
    seed: Seed = 0,
    settings: ModelStatements = (),
    dt: ControlStep = 0.01,
    json: Path | None = None,
) -> None:
    """Fit a baseline to a robot's logs, as a yardstick for a network.

    A fifth of the logs is held out: it decides on the ridge of the linear model, and on the step at which
    the engine's contact numbers are kept. Ctrl-C or SIGTERM writes the best numbers so far.

    [bold]Example[/bold]

    flywheel fit tdpe monday.csv tuesday.csv --robot prism3 --attachments heuristic --out tdpe.npz

    Args:
      model: arx (linear) or tdpe (the rigid-body engine).
      recordings: Logs for the fit.
      robot: Your .xml, a shipped robot's name, or an adopted plant's folder.
      out: Output file of the model.
      attachments: Attachments of the engine's cables: the MJCF's, on the circles of the end caps, or (the
        default) the end caps' centres.
      seed: Seed of the fit.
      dt: Control step, in seconds.
      json: Output file of the answer as JSON.
    """
    from flywheel.cli.logs.reading import read_tracks
    from flywheel.cli.models import open_plant
    from flywheel.dynamics.baselines.weights import FITTED, BaselineWeights
    from flywheel.errors import ConfigError
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress
    from flywheel.training import baselines

    if attachments and model != "tdpe":
        raise ConfigError(f"--attachments is for tdpe; {model} has none.")
    check_model_outputs(out, json, [*recordings, robot])
    given: dict[str, Any] = {"attachments": attachments} if attachments else {}
    config, fitting = settings_of(
        settings, (FITTED[model].Config, given), (baselines.FitSettings, {"seed": seed}), MODEL
    )
    owner, shown = open_plant(robot, dt).robot, console()
    tracks = read_tracks(recordings, owner, dt, shown)
    with StopRequest() as stop, console_progress().stage("fit", 1.0) as stage:
        start = FITTED[model](owner, dt, config)
        found = baselines.fit(start, tracks, fitting, stage.update, stop)
    notes = {"before": found.before, "error": found.error, "windows": found.windows, **found.about}
    names = [path.name for path in recordings]
    digest = BaselineWeights.of(found.model).write(out, {**notes, "recordings": names})
    _show(shown, found, out, robot, recordings)
    shown.keep_json(json, {**notes, "digest": digest})
    end_if_stopped(stop, "these are the best numbers so far")


def _show(out: Out, found: Fitted, path: Path, robot: str, recordings: list[Path]) -> None:
    rows = [("before the fit", found.before), ("fitted", found.error)]
    heads = ("", "#RMSE / L of the tracked points [%]")
    out.print(table(f"{found.windows} held-out windows", heads, rows))
    out.print(table("Fit", ["number", "#value"], list(found.about.items())))
    out.say(f"Model: {path}")
    out.say(next_comparison(recordings, robot, path))
