"""`flywheel compare`: models beside recordings."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from flywheel.cli.logs import read_logs
from flywheel.cli.models import PLANT, open_model
from flywheel.cli.plants import open_plant
from flywheel.cli.show import Out, console, table
from flywheel.diagnosis.comparison import Comparison, compare
from flywheel.outputs import check_outputs, write_output
from flywheel.reports.comparison_page import sentence, write_comparison
from flywheel.reports.comparison_video import film_window

MILLI = 1000.0
WORST_BINS = 3  # of each criterion that are shown


def put_beside(
    logs: Sequence[Path],
    robot_name: str,
    specs: Sequence[str],
    horizon: float,
    dt: float,
    draws: int,
    seed: int,
    fit_starts: bool,
    threads: int,
    page: Path,
    answer: Path | None,
    video: Path | None,
) -> int:
    """Compare, print, write the page, and return the exit code."""
    check_outputs({"page": page, "JSON": answer, "video": video}, inputs=[*logs, robot_name])
    robot, out = open_plant(robot_name, dt).robot, console()
    models = [open_model(spec, robot, robot_name, dt, threads) for spec in specs or (PLANT,)]
    recordings = read_logs(logs, robot, dt, out)
    found = compare(
        models,
        [each.trajectory for each in recordings],
        horizon=horizon,
        draws=draws,
        seed=seed,
        names=[each.name for each in recordings],
        fit_starts=fit_starts,
    )
    _show(out, found)
    about = {
        "robot": f"{robot.name} ({robot.digest[:12]})",
        "models": ", ".join(specs or (PLANT,)),
        "recordings": ", ".join(path.name for path in logs),
        "control step": f"{dt:g} s",
    }
    out.say(f"Page: {_page(out, found, page, about, video)}")
    if answer is not None:
        write_output(answer, json.dumps(found.summary(), indent=1) + "\n")
        out.say(f"JSON: {answer}")
    return found.exit_code


def _page(
    out: Out, found: Comparison, page: Path, about: dict[str, str], video: Path | None
) -> Path:
    """Films of the worst window of the last model, as each model predicts it, and the page."""
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
    for model in found.models:
        out.say(f"{model.name}: {model.outcome}. {sentence(found, model)}", style="bold")
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
    out.print(table(f"where {found.models[-1].name} is off most", *_worst(found)))


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
