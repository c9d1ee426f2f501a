"""The commands of `flywheel recordings`."""

from __future__ import annotations

from flywheel.cli.app import App
from flywheel.cli.recordings.export import export
from flywheel.cli.recordings.guess import guess
from flywheel.cli.recordings.import_logs import import_
from flywheel.cli.recordings.show import show

app = App(no_args_is_help=True, help="Import and export logs of real robots.")
app.command("import")(import_)
app.command()(guess)
app.command()(show)
app.command()(export)
