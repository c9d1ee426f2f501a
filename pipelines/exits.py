"""How a command ends: one clean message, and an exit code that a script can rely on."""

from __future__ import annotations

import traceback
from typing import Any

import typer
from typer.core import TyperGroup

FAILED = 1  # a check did not pass, or a run could not go on
USAGE = 2  # bad usage or bad input
INTERRUPTED = 130  # stopped by Ctrl-C or SIGTERM; finished work is kept

CODES = """\
[bold]Exit codes:[/bold] 0 all is well, 1 a check failed or a run could not go on, \
2 bad usage or input, 130 interrupted (finished work is kept)."""


class Commands(TyperGroup):
    """Turns errors that were raised on purpose into a message and an exit code."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        from flywheel.errors import FlywheelError

        try:
            return super().invoke(ctx)
        except FlywheelError as error:
            if ctx.params.get("debug"):
                traceback.print_exception(error)
                typer.echo(getattr(error, "trace", ""), err=True)
            typer.secho(f"flywheel: {error}", err=True, fg=typer.colors.RED)
            raise typer.Exit(exit_code(error)) from None
        except KeyboardInterrupt:
            typer.echo("flywheel: interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None


def exit_code(error: Exception) -> int:
    """The exit code that tells a script what kind of error it was."""
    from flywheel.errors import ModelError, RunError
    from flywheel.runtime.interrupts import Interrupted
    from flywheel.runtime.jobs import JobFailed, WorkerDied

    if isinstance(error, Interrupted):
        return INTERRUPTED
    if isinstance(error, (RunError, ModelError, JobFailed, WorkerDied)):
        return FAILED
    return USAGE
