"""The `flywheel` command."""

import typer

app = typer.Typer(name="flywheel", no_args_is_help=True)


@app.callback()
def flywheel() -> None:
    """Turn the flywheel: plan, collect, retrain, evaluate, decide."""
