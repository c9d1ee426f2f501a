"""`flywheel diagnose` and `diagnose-bench`: what can be asked for about missing physics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.options import DtOption, ThreadsOption, WindowOption, within
from flywheel.quantities import SAMPLES, Bounds

ANSWERS = Bounds(1, 1000)
app = typer.Typer()

TrainedSpec = Annotated[
    str | None,
    typer.Option(
        metavar="[LABEL=]SPEC",
        help="A trained model to test in the plant's stead: a run's folder (its champion), RUN:NAME, "
        "or a file of weights.",
        show_default=False,
    ),
]
UnsureOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="EFFECT=5%",
        help="What the MJCF says only so well (standard deviation, up to three of which are believed), "
        "such as cable_stiffness or body_mass: fitted beside everything else. May be given again.",
        show_default=False,
    ),
]


@app.command()
def diagnose(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="CSV...", help="Logs to explain.", show_default=False)
    ],
    robot: Annotated[
        str,
        typer.Option(
            help="Your .xml, a shipped robot's name, or an adopted plant's folder.",
            show_default=False,
        ),
    ],
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            help="A further log, on which the answer is only judged. May be given again.",
            show_default=False,
        ),
    ] = None,
    effects: Annotated[
        str, typer.Option(help="Effects to consider, by name; all of the library by default.")
    ] = "",
    unsure: UnsureOption = None,
    window: WindowOption = None,
    model: TrainedSpec = None,
    dt: DtOption = 0.01,
    threads: ThreadsOption = 2,
    page: Annotated[Path, typer.Option(help="Where the HTML page goes.")] = Path("diagnosis.html"),
    json: Annotated[
        Path | None, typer.Option(help="Where the answer goes as JSON.", show_default=False)
    ] = None,
) -> None:
    """Find out which physical effect a robot has that its MJCF, or a trained model, lacks.

    The exit code is the verdict: 0 NOISE_ONLY, 10 EFFECT, 11 AMBIGUOUS, 12 PARTIAL,
    13 OUTSIDE_LIBRARY, 20 DATA_INSUFFICIENT, 21 NOT_CONVERGED.

    [bold]Example[/bold]

    flywheel diagnose monday.csv tuesday.csv --held-out friday.csv --robot my_robot.xml
    """
    from flywheel.cli.diagnose import explain

    code = explain(
        recordings,
        held_out or [],
        robot,
        model,
        effects,
        unsure or [],
        window,
        dt,
        threads,
        page,
        json,
    )
    raise typer.Exit(code)


@app.command()
def adopt(
    answer_file: Annotated[
        Path,
        typer.Argument(metavar="JSON", help="Of `flywheel diagnose --json`.", show_default=False),
    ],
    robot: Annotated[
        str,
        typer.Option(help="What was diagnosed, as it was given there.", show_default=False),
    ],
    out: Annotated[Path, typer.Option(help="Folder of the versions.")] = Path("plants"),
    answer: Annotated[
        int | None,
        typer.Option(
            help="Which of several answers, from 1; also takes what held-out recordings speak against.",
            show_default=False,
            callback=within(ANSWERS),
        ),
    ] = None,
) -> None:
    """Make the effects that were found part of the plant, as a new version of it.

    Nothing is written over: to go back, use an earlier version.

    [bold]Example[/bold]

    flywheel adopt answer.json --robot my_robot.xml
    """
    from flywheel.cli.adopt import take_over

    take_over(answer_file, robot, out, answer)


@app.command("diagnose-bench")
def diagnose_bench(
    folder: Annotated[Path, typer.Argument(help="One result file per case.")] = Path(
        "runs/diagnose-bench"
    ),
    robot: Annotated[str, typer.Option(help="prism3, icosa6 or platform4.")] = "prism3",
    groups: Annotated[
        str, typer.Option(help="none, single, pairs, triples, outside, hard.")
    ] = "none,single,pairs,triples,outside,hard",
    sizes: Annotated[str, typer.Option(help="Of single effects, in typical sizes.")] = "0.5,1,2",
    seeds: Annotated[int, typer.Option(help="Cases of each kind.", callback=within(SAMPLES))] = 5,
    only: Annotated[str, typer.Option(help="Part of the names of the cases wanted.")] = "",
    model: TrainedSpec = None,
    address: Annotated[str | None, typer.Option(help="Of an existing Ray cluster.")] = None,
) -> None:
    """Hide effects in recordings of another simulator, have them diagnosed, and count.

    Cases that have a result in the folder are not done again, so that it can be stopped at any time.

    [bold]Example[/bold]

    flywheel diagnose-bench --groups single --sizes 1 --seeds 1 --only winch
    """
    from flywheel.cli.diagnose_bench import examine, listed

    examine(folder, robot, groups.split(","), listed(sizes), range(seeds), only, model, address)
