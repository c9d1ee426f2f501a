"""`flywheel correct`: train a network on a plant's residual in a robot's logs."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import end_if_stopped
from flywheel.cli.options import number
from flywheel.quantities import Bounds, ControlStep, HorizonSeconds, Seed, Threads

if TYPE_CHECKING:
    from flywheel.training.residual import ResidualResult
    from flywheel.validation import Frozen

M = TypeVar("M", bound="Frozen")
T = TypeVar("T", bound="Frozen")
NETWORK = "network"
ANY = Bounds(-1e12, 1e12)  # of a setting, whose own bounds are asked afterwards

ModelStatements = Annotated[
    tuple[str, ...],
    typer.Option(
        "--set",
        metavar="SETTING=NUMBER",
        help="Value of a setting of the training, such as steps=800, or of the model, such as "
        "network.width=32. Repeatable.",
    ),
]


def correct(
    recordings: Annotated[list[Path], "CSV..."],
    *,
    robot: str,
    out: Path = Path("corrected.npz"),
    horizon: HorizonSeconds = 2.0,
    seed: Seed = 0,
    settings: ModelStatements = (),
    dt: ControlStep = 0.01,
    threads: Threads = 2,
    json: Path | None = None,
) -> None:
    """Train a small network that corrects a plant, with a robot's logs.

    The plant predicts; the network learns the residual, in minutes from minutes of logs. A fifth of
    the logs is held out, and determines the applied fraction of the correction: none if it does not
    help. Ctrl-C or SIGTERM writes the best correction so far.

    [bold]Example[/bold]

    flywheel correct monday.csv tuesday.csv --robot plants/my_robot-1 --out my_robot.npz

    Args:
      recordings: Logs for the training.
      robot: Your .xml, a shipped robot's name, or an adopted plant's folder.
      out: Output file of the model.
      horizon: Horizon of the predictions, in seconds.
      seed: Seed of the training.
      dt: Control step, in seconds.
      threads: Simulations at the same time.
      json: Output file of the answer as JSON.
    """
    from flywheel.cli.logs.reading import read_tracks
    from flywheel.cli.models import open_plant
    from flywheel.dynamics.plant import RestartedPlant
    from flywheel.dynamics.residual import ResidualConfig, ResidualWeights
    from flywheel.runtime.pool.interrupts import StopRequest
    from flywheel.runtime.pool.progress import console_progress
    from flywheel.training.residual import ResidualTraining, train_residual

    check_model_outputs(out, json, [*recordings, robot])
    given = (ResidualTraining, {"horizon": horizon, "seed": seed})
    config, training = settings_of(settings, (ResidualConfig, {}), given, NETWORK)
    plant, shown = RestartedPlant.from_measurements(open_plant(robot, dt, threads)), console()
    tracks = read_tracks(recordings, plant.robot, dt, shown)
    with StopRequest() as stop, console_progress().stage("correct", training.steps) as stage:

        def told(done: float, note: str) -> None:
            stage.update(training.steps * done, note)

        found = train_residual(plant, tracks, config, training, told, stop)
    seconds = sum(t.steps for t in tracks) * dt
    digest = ResidualWeights.of(found.model).write(
        out, {**found.notes(), "recordings": [p.name for p in recordings], "seconds": seconds}
    )
    _show(shown, found, out, robot, seconds, recordings)
    shown.keep_json(json, {**found.notes(), "share": found.model.share, "digest": digest})
    end_if_stopped(stop, "this is the best correction so far")


def check_model_outputs(out: Path, json: Path | None, inputs: Sequence[str | Path]) -> None:
    """Check that a file of weights and the answer can be written.

    Raises:
      ConfigError, DataError: they cannot, or the weights are not called .npz.
    """
    from flywheel.errors import ConfigError
    from flywheel.outputs import check_outputs

    if out.suffix != ".npz":  # else two models could share one side file
        raise ConfigError(f"--out is the file of the weights, which end in .npz; got {out.name}.")
    outputs = {"model": out, "side file of the model": out.with_suffix(".json"), "JSON": json}
    check_outputs(outputs, inputs=inputs)


def settings_of(
    statements: Sequence[str],
    model: tuple[type[M], Mapping[str, Any]],
    training: tuple[type[T], Mapping[str, Any]],
    part: str,
) -> tuple[M, T]:
    """The settings of a model and of its training, from "steps=800" and "network.width=32".

    Args:
      statements: such texts.
      model, training: class of the settings, and their given values.
      part: before the dot of the model's settings.

    Raises:
      ConfigError: there is no such setting, or its value is invalid.
    """
    from flywheel.cli.logs.diagnose import SETTINGS, pairs_of
    from flywheel.errors import ConfigError
    from flywheel.validation import validated

    of_model, of_training = dict(model[1]), dict(training[1])
    for path, text in pairs_of(statements, SETTINGS):
        first, dot, name = path.partition(".")
        value = number(text, path, ANY)
        whole = int(value) if value == int(value) else value
        if dot and first == part:
            of_model[name] = whole
        else:
            of_training[path] = whole
    return (
        validated(model[0], of_model, f"--set {part}", ConfigError),
        validated(training[0], of_training, "--set", ConfigError),
    )


def _show(
    out: Out,
    found: ResidualResult,
    path: Path,
    robot: str,
    seconds: float,
    recordings: Sequence[Path],
) -> None:
    gone = 1.0 - found.error / found.plant_error
    if found.model.share:
        out.say(
            f"{gone:.0%} of the plant's held-out error is removed, with {found.model.share:.0%} "
            "of the correction.",
            style="bold",
        )
    else:
        out.say(
            "The correction does not clearly help on held-out recordings: the model is the "
            "unchanged plant. More logs may help.",
            style="bold",
        )
    rows = [("plant", found.plant_error), ("corrected", found.error)]
    heads = ("model", "#held-out error, relative to the plant's usual one at that lead time")
    out.print(
        table(
            f"{found.windows} training windows of {found.horizon:g} s, {found.held_out} held out, of "
            f"{seconds:.0f} s; {found.steps} steps in {found.seconds:.0f} s",
            heads,
            rows,
        )
    )
    out.say(f"Model: {path}")
    out.say(next_comparison(recordings, robot, path))


def next_comparison(recordings: Sequence[Path], robot: str, model: Path) -> str:
    """The command that compares a model with its plant."""
    words = ("--robot", robot, "--model", "plant", "--model", str(model))
    return f"next: {shlex.join(('flywheel', 'compare', str(recordings[0]), *words))}"
