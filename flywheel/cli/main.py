"""The `flywheel` command: what can be asked for.

Each command is a module of its own, imported only when it is asked for, so that `--help` is
instant.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.comparison_cli import app as comparison_app
from flywheel.cli.diagnosis_cli import app as diagnosis_app
from flywheel.cli.exits import CODES, Commands
from flywheel.cli.experiment_cli import app as experiment_app
from flywheel.cli.navigation_cli import app as navigation_app
from flywheel.cli.options import Overrides, within
from flywheel.cli.recordings_cli import app as recordings_app
from flywheel.quantities import EPISODE_SECONDS, HORIZON_SECONDS, SAMPLES

app = typer.Typer(
    name="flywheel",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=CODES,
)
data_app = typer.Typer(
    no_args_is_help=True, help="Look into the episodes of a run, and check them."
)
robot_app = typer.Typer(no_args_is_help=True, help="Bring your own robot.")
app.add_typer(data_app, name="data")
app.add_typer(robot_app, name="robot")
app.add_typer(recordings_app, name="recordings")
app.add_typer(navigation_app)
app.add_typer(comparison_app)
app.add_typer(diagnosis_app)
app.add_typer(experiment_app)

RunArgument = Annotated[
    Path,
    typer.Argument(metavar="RUN", help="A run's folder, e.g. runs/prism3.", show_default=False),
]


class Kind(StrEnum):
    """What can be listed."""

    robots = "robots"
    tasks = "tasks"
    models = "models"
    controllers = "controllers"
    datasets = "datasets"
    configs = "configs"
    runs = "runs"


@app.callback()
def flywheel(
    debug: Annotated[
        bool, typer.Option("--debug", help="Show where an error was raised, not just the message.")
    ] = False,
) -> None:
    """Learn the dynamics of a cable-driven robot by using them: collect, train, evaluate, repeat.

    Start here:

    [bold]flywheel run configs/prism3.yaml[/bold] [dim](the whole loop, on this machine)[/dim]

    [bold]flywheel report runs/prism3[/bold] [dim](what came of it, as a page)[/dim]

    [bold]flywheel robot check my.xml[/bold] [dim](whether your own robot fits)[/dim]
    """


@app.command()
def run(
    config: Annotated[
        Path, typer.Argument(help="A YAML file, e.g. configs/prism3.yaml.", show_default=False)
    ],
    overrides: Overrides = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run in the folder, from its files.")
    ] = False,
    address: Annotated[
        str | None,
        typer.Option(
            help="Of an existing Ray cluster (host:port, auto); else one is started here."
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            help="Where the run goes; runs/<name of the file> by default.", show_default=False
        ),
    ] = None,
) -> None:
    """Turn the flywheel: collect, train, evaluate, decide, again and again.

    [bold]Examples[/bold]

    flywheel run configs/smoke.yaml [dim](minutes; shows that all works)[/dim]

    flywheel run configs/prism3.yaml seed=1 iterations=3

    flywheel run configs/prism3.yaml --resume [dim](after Ctrl-C, a crash, a power cut)[/dim]
    """
    from flywheel.cli.run import turn

    turn(config, overrides or [], resume=resume, address=address, folder=folder)


@app.command("list")
def list_(kind: Annotated[Kind, typer.Argument(help="What to list.", show_default=False)]) -> None:
    """List what there is to choose from.

    [bold]Example[/bold]

    flywheel list robots
    """
    from flywheel.cli.listing import show_list

    show_list(kind.value)


@app.command()
def evaluate(
    run: RunArgument,
    split: Annotated[str, typer.Option(help="Which episodes: test, validation or train.")] = "test",
    horizon: Annotated[
        float,
        typer.Option(
            help="Of the short predictions, in seconds.", callback=within(HORIZON_SECONDS)
        ),
    ] = 2.0,
    starts: Annotated[
        int, typer.Option(help="Short predictions per episode.", callback=within(SAMPLES))
    ] = 10,
    full: Annotated[bool, typer.Option(help="Also predict whole episodes.")] = True,
    weights: Annotated[
        Path | None, typer.Option(help="Score this weights file instead of the run's own models.")
    ] = None,
    by: Annotated[
        str,
        typer.Option(help="Score apart by: controller, dataset, iteration, source, ground."),
    ] = "all",
) -> None:
    """Score the models of a run on its stored episodes, beside "nothing moves".

    [bold]Examples[/bold]

    flywheel evaluate runs/prism3 --split validation

    flywheel evaluate runs/prism3 --by controller [dim](where it fails)[/dim]
    """
    from flywheel.cli.evaluate import score_models

    score_models(run, split, horizon, starts, full, weights, by)


@app.command()
def report(run: RunArgument) -> None:
    """Make the page of a run, finished or not: one HTML file without any other.

    [bold]Example[/bold]

    flywheel report runs/prism3
    """
    from flywheel.cli.report import make_page

    make_page(run)


@app.command()
def summary(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of runs with different seeds.")
    ],
) -> None:
    """Put several seeds of one configuration into one table.

    [bold]Examples[/bold]

    flywheel run configs/prism3.yaml seed=1 --folder runs/prism3-1

    flywheel summary runs/prism3 runs/prism3-1
    """
    from flywheel.cli.summary import show_seeds

    show_seeds(runs)


@app.command()
def ui(
    run: RunArgument,
    port: Annotated[int, typer.Option(min=1, max=65535, help="To serve at.")] = 5000,
) -> None:
    """Serve the MLflow dashboard of a run on this machine, until Ctrl-C.

    [bold]Example[/bold]

    flywheel ui runs/prism3 --port 5001
    """
    from flywheel.cli.ui import serve

    serve(run, port)


@app.command()
def bench(
    threads: Annotated[str, typer.Option(help="Numbers of threads, one after the other.")] = "1,2",
    seconds: Annotated[
        float,
        typer.Option(
            help="Shortest measurement of one thing, in seconds.",
            callback=within(EPISODE_SECONDS),
        ),
    ] = 1.0,
    only: Annotated[
        str, typer.Option(help="Only these, e.g. plant,plan; all by default.", show_default=False)
    ] = "",
    output: Annotated[Path, typer.Option(help="Where the numbers go, as JSON.")] = Path(
        "bench.json"
    ),
) -> None:
    """Measure this machine: plant, network, planning and store.

    [bold]Example[/bold]

    flywheel bench --threads 1,2 --only plant,plan
    """
    from flywheel.cli.bench import measure

    measure(threads, seconds, only, output)


@data_app.command()
def verify(
    run: RunArgument,
    snapshot: Annotated[str, typer.Option(help="Only this one; everything by default.")] = "",
) -> None:
    """Read every byte again and compare; names what is damaged, exchanged, missing or foreign.

    Of a run's folder also its results, models, configuration and robot; of a store all that is in it.

    [bold]Example[/bold]

    flywheel data verify runs/prism3
    """
    from flywheel.cli.data import verify_store

    verify_store(run, snapshot)


@data_app.command("show")
def show_data(
    run: RunArgument,
    snapshot: Annotated[
        str, typer.Option(help="Show the episodes of this one; the snapshots by default.")
    ] = "",
) -> None:
    """Show the snapshots of a run, or the episodes of one.

    [bold]Example[/bold]

    flywheel data show runs/prism3 --snapshot i0001-mppi
    """
    from flywheel.cli.data import show_store

    show_store(run, snapshot)


@data_app.command("rewind")
def rewind_run(
    run: RunArgument,
    iteration: Annotated[
        int, typer.Argument(help="The first that has to be done again.", show_default=False)
    ],
) -> None:
    """Set aside what a run did from an iteration on, so that --resume does it again.

    Nothing is deleted: results and models go to RUN/aside, episodes to the store's quarantine.

    [bold]Example[/bold]

    flywheel data rewind runs/prism3 1
    """
    from flywheel.cli.data import go_back

    go_back(run, iteration)


@robot_app.command()
def check(
    mjcf: Annotated[
        str, typer.Argument(metavar="MJCF", help="Your .xml, or a shipped robot's name.")
    ],
    dt: Annotated[
        float | None,
        typer.Option(
            max=1.0,
            help="Time between commands, in seconds; 0.01 or what is nearest to it by default.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Say what is read off an MJCF, whether it settles, what a model of it would hold, and how to run it.

    [bold]Example[/bold]

    flywheel robot check my_robot.xml
    """
    from flywheel.cli.robot import check_robot

    check_robot(mjcf, dt)


if __name__ == "__main__":
    app()
