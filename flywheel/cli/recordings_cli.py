"""`flywheel recordings`: what can be asked for about logs of real robots."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flywheel.cli.options import DtOption

app = typer.Typer(no_args_is_help=True, help="Bring logs of a real robot in, and out.")

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
RobotOption = Annotated[
    str | None,
    typer.Option(
        help="Your .xml, or a shipped robot's name; by default the run's.", show_default=False
    ),
]


class SplitChoice(StrEnum):
    """What recordings are for; `auto` lets the hash of the content decide."""

    auto = "auto"
    train = "train"
    validation = "validation"
    test = "test"


@app.command("import")
def import_(
    logs: Annotated[list[Path], typer.Argument(metavar="CSV...", show_default=False)],
    store: Annotated[
        Path,
        typer.Option(
            metavar="RUN_OR_STORE",
            help="A run's folder, or a folder of episodes; made if there is none.",
            show_default=False,
        ),
    ],
    robot: RobotOption = None,
    split: Annotated[
        SplitChoice, typer.Option(help="What the episodes are for, for ever.")
    ] = SplitChoice.auto,
    dt: DtOption = 0.01,
    mapping: Annotated[
        Path | None,
        typer.Option(
            "--map",
            help="YAML with names, units and axes for all of them; by default the one of the same "
            "name beside each.",
            show_default=False,
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Read and report, but store nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Make episodes of CSV logs, and say what was masked, repaired or resampled.

    If one of them cannot be used, none is stored, and the message says why.

    [bold]Examples[/bold]

    flywheel recordings import monday.csv --robot prism3 --store runs/prism3/store --dry-run

    flywheel recordings import logs/*.csv --robot my.xml --store mine --split test
    """
    from flywheel.cli.recordings import import_logs

    chosen = None if split is SplitChoice.auto else split.value
    import_logs(logs, store, robot, chosen, dt, mapping, dry_run, as_json)


@app.command("show")
def show_recordings(
    store: Annotated[
        Path,
        typer.Argument(
            metavar="RUN_OR_STORE",
            help="A run's folder, or a folder of episodes.",
            show_default=False,
        ),
    ],
    as_json: AsJson = False,
) -> None:
    """Show the recordings in a store, and the setting that lets a run learn from them.

    [bold]Example[/bold]

    flywheel recordings show runs/prism3/store
    """
    from flywheel.cli.recordings import show_stored

    show_stored(store, as_json)


@app.command()
def export(
    store: Annotated[
        Path,
        typer.Argument(
            metavar="RUN_OR_STORE",
            help="A run's folder, or a folder of episodes.",
            show_default=False,
        ),
    ],
    episode: Annotated[str, typer.Argument(metavar="EPISODE", show_default=False)],
    output: Annotated[Path, typer.Argument(metavar="OUT.csv", show_default=False)],
    robot: RobotOption = None,
) -> None:
    """Write an episode, recorded or simulated, as the CSV that a robot's log would be.

    [bold]Example[/bold]

    flywheel recordings export runs/prism3 i0001-mppi-collect-0000 episode.csv
    """
    from flywheel.cli.recordings import export_episode

    export_episode(store, episode, output, robot)
