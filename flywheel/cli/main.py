"""All commands of `flywheel`."""

from __future__ import annotations

from typing import Annotated

import typer

from flywheel.cli.app import App
from flywheel.cli.demo import demo
from flywheel.cli.driving.drive import drive
from flywheel.cli.driving.navigate import navigate
from flywheel.cli.exits import CODES, Commands
from flywheel.cli.list import list_
from flywheel.cli.logs.adopt import adopt
from flywheel.cli.logs.compare import compare
from flywheel.cli.logs.correct import correct
from flywheel.cli.logs.design import design
from flywheel.cli.logs.diagnose import diagnose
from flywheel.cli.logs.fit import fit
from flywheel.cli.logs.power import power
from flywheel.cli.recordings import commands as recordings
from flywheel.cli.robot import check as robot
from flywheel.cli.runs import config, data
from flywheel.cli.runs.evaluate import evaluate
from flywheel.cli.runs.report import report
from flywheel.cli.runs.run import run
from flywheel.cli.runs.summary import summary
from flywheel.cli.runs.ui import ui

RUNS = "Runs of the flywheel"
LOGS = "Logs of a real robot"
YOURS = "Your robot"

app = App(
    name="flywheel",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=CODES,
)


@app.callback()
def flywheel(
    debug: Annotated[
        bool,
        typer.Option("--debug", help="Show where an error was raised, in addition to the message."),
    ] = False,
) -> None:
    """Learn the dynamics of a cable-driven robot by using them: collect, train, evaluate, repeat.

    Start here:

    [bold]flywheel demo[/bold] [dim](three minutes: find a hidden effect in a robot)[/dim]

    [bold]flywheel run prism3[/bold] [dim](the whole loop on this machine; flywheel report shows it)[/dim]

    [bold]flywheel robot check my.xml[/bold] [dim](check your own robot)[/dim]

    [bold]flywheel diagnose log.csv --robot my.xml[/bold] [dim](a log: effects that the model \
lacks)[/dim]

    [bold]flywheel recordings import log.csv --robot my.xml --store runs/my[/bold] [dim](a log to learn \
from)[/dim]
    """


app.command(rich_help_panel=RUNS)(demo)
app.command(rich_help_panel=RUNS)(run)
app.command("list", rich_help_panel=RUNS)(list_)
app.add_typer(config.app, name="config", rich_help_panel=RUNS)
app.command(rich_help_panel=RUNS)(evaluate)
app.command(rich_help_panel=RUNS)(navigate)
app.command(rich_help_panel=RUNS)(drive)
app.command(rich_help_panel=RUNS)(report)
app.command(rich_help_panel=RUNS)(summary)
app.command(rich_help_panel=RUNS)(ui)
app.add_typer(data.app, name="data", rich_help_panel=RUNS)
app.command(rich_help_panel=LOGS)(diagnose)
app.command(rich_help_panel=LOGS)(adopt)
app.command(rich_help_panel=LOGS)(correct)
app.command(rich_help_panel=LOGS)(fit)
app.command(rich_help_panel=LOGS)(compare)
app.command(rich_help_panel=LOGS)(power)
app.command(rich_help_panel=LOGS)(design)
app.add_typer(recordings.app, name="recordings", rich_help_panel=LOGS)
app.add_typer(robot.app, name="robot", rich_help_panel=YOURS)

if __name__ == "__main__":
    app(prog_name="flywheel")
