"""`flywheel power` and `flywheel design`: experiments before they are made."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.options import TYPICAL_SIZES, DtOption, ThreadsOption, WindowOption, within
from flywheel.quantities import HORIZON_SECONDS, SAMPLES, SEED

app = typer.Typer()

RobotOption = Annotated[
    str,
    typer.Option(
        help="Your .xml, a shipped robot's name, or an adopted plant.", show_default=False
    ),
]
NoiseOption = Annotated[
    str,
    typer.Option(help="Of each coordinate: a share of the robot's length, or a length (9mm)."),
]
PageOption = Annotated[
    Path | None, typer.Option(help="Where an HTML page goes.", show_default=False)
]
JsonOption = Annotated[
    Path | None, typer.Option(help="Where the numbers go as JSON.", show_default=False)
]


@app.command()
def power(
    commands: Annotated[
        Path,
        typer.Argument(metavar="CSV", help="Columns time and ctrl.<actuator>.", show_default=False),
    ],
    robot: RobotOption,
    noise: NoiseOption = "0.003",
    size: Annotated[
        float,
        typer.Option(
            help="At which effects are told apart, in typical sizes.",
            callback=within(TYPICAL_SIZES),
        ),
    ] = 1.0,
    effects: Annotated[
        str, typer.Option(help="Effects to consider, by name; all of the library by default.")
    ] = "",
    window: WindowOption = None,
    dt: DtOption = 0.01,
    threads: ThreadsOption = 2,
    page: PageOption = None,
    json: JsonOption = None,
) -> None:
    """Say before an experiment what it could show: how small an effect, and what it is taken for.

    [bold]Example[/bold]

    flywheel power commands.csv --robot prism3 --noise 5mm --page power.html
    """
    from flywheel.cli.power import foretell

    foretell(commands, robot, noise, size, effects, window, dt, threads, page, json)


@app.command()
def design(
    rivals: Annotated[
        list[str],
        typer.Argument(
            metavar="RIVAL RIVAL...",
            help="Effects, at any place (payload) or at one (payload@s2).",
            show_default=False,
        ),
    ],
    robot: RobotOption,
    noise: NoiseOption = "0.003",
    size: Annotated[
        float,
        typer.Option(help="Of the rivals, in typical sizes.", callback=within(TYPICAL_SIZES)),
    ] = 1.0,
    seconds: Annotated[
        float,
        typer.Option(help="Length of the script, in seconds.", callback=within(HORIZON_SECONDS)),
    ] = 3.0,
    candidates: Annotated[
        int,
        typer.Option(
            help="Scripts that are drawn; as many variations follow.", callback=within(SAMPLES)
        ),
    ] = 64,
    seed: Annotated[int, typer.Option(help="Of all that is random.", callback=within(SEED))] = 0,
    dt: DtOption = 0.01,
    threads: ThreadsOption = 2,
    out: Annotated[Path, typer.Option(help="Where the commands go.")] = Path("commands.csv"),
    page: PageOption = None,
    json: JsonOption = None,
) -> None:
    """Write the commands that best tell effects apart between which a diagnosis could not decide.

    [bold]Example[/bold]

    flywheel design cable_friction capstan --robot prism3 --out to_tell.csv
    """
    from flywheel.cli.design import propose
    from flywheel.runtime.config.demand import check_predictions

    predictions = candidates * (1 + len(rivals))  # of each script, and with each rival
    check_predictions(predictions, seconds, dt, "--candidates, rivals, --seconds, --dt")
    propose(rivals, robot, noise, size, seconds, candidates, seed, dt, threads, out, page, json)
