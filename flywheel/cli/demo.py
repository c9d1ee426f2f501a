"""`flywheel demo`: the story of a robot that is not its model, in a few minutes."""

from __future__ import annotations

import os
import secrets
import shlex
import sys
import webbrowser
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console, table
from flywheel.cli.options import ThreadsOption, within
from flywheel.quantities import DEMO_SECONDS, SEED

if TYPE_CHECKING:
    from flywheel.demo.demonstration import Demonstration
    from flywheel.runtime.pool.progress import Progress, Stage

ROBOT, SECONDS = "prism3", 3.0
SEEDS = 10_000  # that are drawn from: short enough to be typed again
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # where one of these is set, a browser has a place

RobotOption = Annotated[str, typer.Option(help="Your .xml, or a shipped robot's name.")]
EffectOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[@PLACE][:SIZE]",
        help="What the robot has beyond its MJCF: torque_speed:2 is twice its typical size, none is nothing. "
        "Drawn by default.",
        show_default=False,
    ),
]
SeedOption = Annotated[
    int | None,
    typer.Option(
        help="Of all that is random; another one each time by default.",
        callback=within(SEED),
        show_default=False,
    ),
]
SecondsOption = Annotated[
    float,
    typer.Option(help="Length of each recording, in seconds.", callback=within(DEMO_SECONDS)),
]
ShowOption = Annotated[
    bool | None,
    typer.Option(
        "--show/--no-show",
        help="Open the page in a browser; by default where there is a terminal and a screen.",
        show_default=False,
    ),
]


@dataclass(frozen=True)
class Narrator:
    """Tells findings where results go, and progress where progress goes. Implements `Progress`."""

    out: Out
    progress: Progress

    def say(self, text: str) -> None:
        """Tell a finding."""
        self.out.say(text)

    def stage(self, title: str, total: float) -> AbstractContextManager[Stage]:
        """Show how far a step is."""
        return self.progress.stage(title, total)


def demo(
    robot: RobotOption = ROBOT,
    effect: EffectOption = None,
    seed: SeedOption = None,
    seconds: SecondsOption = SECONDS,
    threads: ThreadsOption = 2,
    page: Annotated[Path, typer.Option(help="Where the HTML page goes.")] = Path("demo.html"),
    show: ShowOption = None,
) -> None:
    """Hide physics in a robot that its MJCF lacks, and see whether it is found.

    The robot is simulated in a process of its own, and gives nothing but measurements. They are compared
    with the MJCF, diagnosed, and compared again with what was found; at the end it is said what was hidden.
    The exit code is 0 whether that was found or not.

    [bold]Examples[/bold]

    flywheel demo

    flywheel demo --effect cable_friction:2 --seed 7
    """
    from flywheel.demo.demonstration import DemoConfig, demonstrate, drawn_effect, hidden_truth
    from flywheel.demo.page import write_demo
    from flywheel.outputs import check_outputs
    from flywheel.robots import load_robot
    from flywheel.runtime.pool.progress import console_progress

    check_outputs({"page": page}, inputs=[robot])
    out, loaded = console(), load_robot(robot)
    number = secrets.randbelow(SEEDS) if seed is None else seed
    wanted = drawn_effect(loaded, number) if effect is None else effect
    hidden_truth(wanted, loaded)  # refuses what cannot be hidden, before anything is said
    again = _command(robot, effect, number, seconds)
    out.say(
        f"What {loaded.name} has beyond its MJCF is hidden until the end. The same again: {again}"
    )
    config = DemoConfig(seconds=seconds, threads=threads)
    story = demonstrate(loaded, wanted, number, config, Narrator(out, console_progress()))
    _reveal(out, story)
    with TemporaryDirectory() as folder:
        film = _filmed(out, story, Path(folder) / "film.mp4")
        out.say(f"Page: {write_demo(story, page, again, film)}")
    if _on_a_screen(out) if show is None else show:
        open_page(out, page)


def _command(robot: str, effect: str | None, seed: int, seconds: float) -> str:
    """The command that does the same again."""
    parts = ["flywheel", "demo", "--seed", str(seed)]
    if robot != ROBOT:
        parts += ["--robot", robot]
    if effect is not None:
        parts += ["--effect", effect]
    if seconds != SECONDS:
        parts += ["--seconds", f"{seconds:g}"]
    return shlex.join(parts)


def _reveal(out: Out, story: Demonstration) -> None:
    """Say what was hidden, beside what was found."""
    from flywheel.cli.logs.diagnose import effects_table
    from flywheel.demo.page import truth

    if any(story.diagnosis.answers):
        out.print(effects_table(story.diagnosis))
    rows = [
        (
            each.label if not number else "",
            each.parameter,
            each.value,
            each.found and each.found.value,
            each.found and f"{each.found.low:.4g} to {each.found.high:.4g}",
            each.unit,
        )
        for number, each in enumerate(truth(story))
    ]
    if rows:
        heads = ("hidden", "parameter", "#true value", "#found", "#95 % interval", "unit")
        out.print(table("what was hidden", heads, rows))
    out.say(story.assessment.sentence, style="bold")


def _filmed(out: Out, story: Demonstration, path: Path) -> Path | str:
    """The video of the page, or why there is none."""
    from flywheel.demo.page import worst_window

    try:
        return worst_window(story).film(path)
    except Exception as error:  # whatever a graphics driver throws
        out.say(f"No video: {error}")
        return str(error)


def _on_a_screen(out: Out) -> bool:
    """Whether somebody sees a browser that is opened."""
    screen = sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in DISPLAYS)
    return out.is_terminal and screen


def open_page(out: Out, page: Path) -> None:
    """Show the page in a browser, or say that there is none."""
    if not webbrowser.open(page.absolute().as_uri()):
        out.say("No browser was found to open it with.")
