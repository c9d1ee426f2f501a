"""`flywheel compare`: what can be asked for about models and recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.options import DtOption, ThreadsOption, within
from flywheel.quantities import HORIZON_SECONDS, SAMPLES, SEED

app = typer.Typer()


Recordings = Annotated[
    list[Path], typer.Argument(metavar="CSV...", help="Logs to predict.", show_default=False)
]
RobotName = Annotated[
    str,
    typer.Option(
        help="Your .xml, a shipped robot's name, or an adopted plant's folder.", show_default=False
    ),
]
Models = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[LABEL=]SPEC",
        help="plant (the default), an adopted plant's folder, a run's folder (its champion), "
        "RUN:NAME, or a file of weights. May be given again.",
        show_default=False,
    ),
]
HorizonOption = Annotated[
    float,
    typer.Option(help="Predicted from each present, in seconds.", callback=within(HORIZON_SECONDS)),
]
DrawsOption = Annotated[
    int,
    typer.Option(help="Of the noise, for what it makes of the error.", callback=within(SAMPLES)),
]


@app.command()
def compare(
    recordings: Recordings,
    robot: RobotName,
    model: Models = None,
    horizon: HorizonOption = 1.0,
    dt: DtOption = 0.01,
    draws: DrawsOption = 100,
    seed: Annotated[int, typer.Option(help="Of the draws.", callback=within(SEED))] = 0,
    fit_starts: Annotated[
        bool, typer.Option(help="Also what plants leave where starts are fitted; slow.")
    ] = False,
    threads: ThreadsOption = 2,
    page: Annotated[Path, typer.Option(help="Where the HTML page goes.")] = Path("comparison.html"),
    json: Annotated[
        Path | None, typer.Option(help="Where the numbers go as JSON.", show_default=False)
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            help="Where the last model's worst window goes as mp4, besides the page.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Compare models with recordings: is the error more than noise, and where is it?

    The exit code speaks for the last model: 0 NOISE_ONLY, 1 MORE_THAN_NOISE.

    [bold]Example[/bold]

    flywheel compare monday.csv --robot my_robot.xml --model before=plant --model after=plants/my_robot-1
    """
    from flywheel.cli.compare import put_beside
    from flywheel.runtime.config.demand import check_predictions

    check_predictions(draws, horizon, dt, "--draws, --horizon, --dt")
    code = put_beside(
        recordings,
        robot,
        model or [],
        horizon,
        dt,
        draws,
        seed,
        fit_starts,
        threads,
        page,
        json,
        video,
    )
    raise typer.Exit(code)
