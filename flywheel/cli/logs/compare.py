"""`flywheel compare`: models against recordings."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.options import PlantOptions
from flywheel.options import ComparisonOptions

if TYPE_CHECKING:
    from flywheel.diagnosis.comparison import Comparison

MILLI = 1000.0
WORST_BINS = 3  # of each criterion that are shown


def compare(
    recordings: Annotated[list[Path], "CSV..."],
    *,
    chosen: PlantOptions,
    model: Annotated[tuple[str, ...], "[LABEL=]SPEC"] = (),
    options: ComparisonOptions = ComparisonOptions(),
    page: Path = Path("comparison.html"),
    json: Path | None = None,
    video: Path | None = None,
) -> None:
    """Compare models with recordings: is the error more than noise, and where is it?

    The exit code is the last model's: 0 NOISE_ONLY, 1 MORE_THAN_NOISE; with --fit-starts, of its starts.

    [bold]Example[/bold]

    flywheel compare monday.csv --robot my_robot.xml --model before=plant --model after=plants/my_robot-1

    Args:
      recordings: Logs to predict.
      model: plant (the default), an adopted plant's folder, a run's folder (its champion), RUN:NAME, a
        baseline (flywheel list models), or a file of weights (also those of `flywheel correct` and
        `fit`). Repeatable.
      page: Output file of the HTML page.
      json: Output file of the answer as JSON.
      video: Output file (mp4) of the last model's worst window, in addition to the page.
    """
    from flywheel.cli.logs.reading import read_logs
    from flywheel.cli.models import PLANT, open_model, opened
    from flywheel.diagnosis import comparison
    from flywheel.dynamics.plant import swing_period
    from flywheel.outputs import check_outputs
    from flywheel.runtime.config.demand import check_predictions

    check_predictions(options.draws, options.horizon, chosen.dt, "--draws, --horizon, --dt")
    outputs = {"page": page, "JSON": json, "video": video}
    check_outputs(outputs, inputs=[*recordings, *chosen.files])
    out, specs, (plant, library) = console(), model or (PLANT,), opened(chosen)
    robot = plant.robot
    if (period := swing_period(plant)) > options.horizon:
        out.say(
            f"{robot.name} swings every {period:.3g} s: predictions of {options.horizon:g} s see a part of a "
            f"swing; --horizon {period:.2g} is all of it."
        )
    models = [open_model(spec, plant, library) for spec in specs]
    logs = read_logs(recordings, robot, plant.dt, out)
    names, tracks = [each.name for each in logs], [each.trajectory for each in logs]
    found = comparison.compare(models, tracks, options, names)
    _show(out, found)
    about = {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "models": ", ".join(specs),
        "recordings": ", ".join(path.name for path in recordings),
        "control step": f"{plant.dt:g} s",
        **library.about,
    }
    out.say(f"Page: {_page(out, found, page, about, video)}")
    out.keep_json(json, {**found.summary(), **library.provenance})
    raise typer.Exit(found.exit_code)


def _page(
    out: Out, found: Comparison, page: Path, about: dict[str, str], video: Path | None
) -> Path:
    """Film the worst window of the last model, as each model predicts it, and write the page."""
    from flywheel.outputs import write_output
    from flywheel.reports.comparison_page import write_comparison
    from flywheel.reports.comparison_video import film_window

    films: dict[str, Path | str] = {}
    with TemporaryDirectory() as folder:
        for number, model in enumerate(found.models):
            path = Path(folder) / f"{number}.mp4"
            try:
                films[model.name] = film_window(found, model, found.models[-1].worst, path)
            except Exception as error:  # whatever a graphics driver throws
                films[model.name] = str(error)
                out.say(f"No video of {model.name}: {error}")
        last = films[found.models[-1].name]
        if video is not None and isinstance(last, Path):
            write_output(video, last.read_bytes())
            out.say(f"Video: {video}")
        return write_comparison(found, page, about, films)


def _show(out: Out, found: Comparison) -> None:
    from flywheel.reports.comparison_page import about_lengths, channel_rows, sentence

    for model in found.models:
        out.say(f"{model.name}: {model.outcome}. {sentence(found, model)}", style="bold")
    for remark in about_lengths(found):
        out.say(remark)
    windows = found.windows
    if windows.unused:
        out.say(f"No window in {', '.join(windows.unused)}.")
    scale = MILLI * windows.sigma
    rows: list[tuple[object, ...]] = [
        (
            model.name,
            scale * model.rms,
            f"{scale * model.noise_rms[0]:.3g} to {scale * model.noise_rms[2]:.3g}",
            scale,
            model.excess,
            model.probability,
            None if model.fitted is None else MILLI * model.fitted.rms,
            None if model.fitted is None else model.fitted.noise,
        )
        for model in found.models
    ]
    rows.append(("nothing moves", scale * found.persistence_rms, None, scale, *[None] * 4))
    heads = (
        "model",
        "error [mm]",
        "by noise alone [mm]",
        "noise [mm]",
        "#excess",
        "#p",
        "fitted starts [mm]",
        "#variance left",
    )
    seconds = windows.steps * windows.dt
    out.print(table(f"{len(windows)} predictions of {seconds:g} s", heads, rows))
    if beside := channel_rows(found):
        each = [h for m in found.models for h in (f"#{m.name}, error", "#by noise alone")]
        out.print(table("beside the points", ("channel", "unit", "#noise", *each), beside))
    out.print(table(f"largest errors of {found.models[-1].name}", *_worst(found)))


def _worst(found: Comparison) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """The bins with the largest mean squares of the last model, and every model's there."""
    rows: list[tuple[object, ...]] = []
    for number, bins in enumerate(found.models[-1].bins):
        for place, i in enumerate(bins.worst(WORST_BINS)):
            means = [float(model.bins[number].sums.mean[i]) for model in found.models]
            what = f"{bins.of} by {bins.by}" if not place else ""
            rows.append((what, bins.labels[i], *means))
    heads = ("", "bin", *(f"#{model.name}, mean square" for model in found.models))
    return heads, rows
