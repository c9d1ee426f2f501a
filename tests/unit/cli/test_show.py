"""What commands print: names from outside are shown as they are."""

import io
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from flywheel.cli.console import Out, cell, console, table
from flywheel.cli.main import app
from flywheel.runtime.pool.progress import console_progress

NAMES = (
    "[red]x.csv",
    "[/]",
    "[link=http://x.example]a[/link]",
    r"a\[b]",
    "\\",
    ":smile:.csv",
    "$x$ {y} %s",
)


def flat(text: str) -> str:
    """Without the lines that Rich begins, and its frames."""
    return "".join(line.strip(" │┃|") for line in text.splitlines())


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_printed_as_it_is_in_lines_titles_columns_and_cells(name, capsys):
    out = console()
    out.say(f"Page: {name}", style="bold")
    assert capsys.readouterr().out == f"Page: {name}\n"
    out.print(table(name, [name, "#n"], [(name, 1.0)]))
    assert flat(capsys.readouterr().out).count(name) == 3


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_progress_shows_a_name_as_it_is(name, terminal):
    screen = Console(file=io.StringIO(), force_terminal=terminal, width=200, color_system=None)
    progress = console_progress(screen)
    progress.say(f"The run is in {name}.")
    with progress.stage(name, 1.0) as stage:
        stage.update(0.5, name)
    shown = screen.file.getvalue()
    assert f"The run is in {name}." in shown
    assert shown.count(name) >= 2


def test_what_would_steer_the_terminal_is_written_out(capsys):
    console().say("a\x1b[2Jb")
    console().print(table("t\x1b[1m", ["c"], [("x\rbad",)]))
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and "\r" not in shown
    assert r"a\x1b[2Jb" in shown and r"x\rbad" in shown


def test_a_long_line_is_not_broken(capsys):
    Out(20).say("x " * 100)
    assert capsys.readouterr().out == "x " * 100 + "\n"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(None, "-"), (float("nan"), "-"), (12345.6, "12,346"), (0.123456, "0.1235"), ("[a]", "[a]")],
)
def test_a_cell_has_about_four_digits(value, shown):
    assert cell(value) == shown


@pytest.mark.parametrize("name", ["[red]run", "[/]", ":smile:"])
def test_a_command_names_a_folder_as_it_is_called(name, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["report", name])
    assert done.exit_code == 2
    assert f"There is no result.json in {name};" in done.stderr
