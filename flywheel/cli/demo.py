"""`flywheel demo`: identify a hidden effect in a simulated robot, in a few minutes."""

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

from flywheel.cli.console import Out, console, table
from flywheel.quantities import SEED, DemoSeconds, Threads

if TYPE_CHECKING:
    from flywheel.demo.demonstration import Demonstration
    from flywheel.runtime.pool.progress import Progress, Stage

ROBOT, SECONDS = "prism3", 3.0
SEEDS = 10_000  # that are drawn from: short enough to be typed again
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")  # where one of these is set, a browser has a place


@dataclass(frozen=True)
class Narrator:
    """Prints findings to stdout, and progress to stderr. Implements `Progress`."""

    out: Out
    progress: Progress

    def say(self, text: str) -> None:
        """Print a finding."""
        self.out.say(text)

    def stage(self, title: str, total: float) -> AbstractContextManager[Stage]:
        """Show the progress of a step."""
        return self.progress.stage(title, total)


def demo(
    *,
    robot: str = ROBOT,
    effect: Annotated[str | None, "NAME[@PLACE][:SIZE]"] = None,
    seed: Annotated[int | None, SEED] = None,
    seconds: DemoSeconds = SECONDS,
    threads: Threads = 2,
    page: Path = Path("demo.html"),
    show: Annotated[bool | None, "--show/--no-show"] = None,
) -> None:
    """Hide physics missing from the MJCF in a simulated robot, and try to identify it.

    The robot is simulated in its own process, and returns only measurements. They are compared with
    the MJCF, diagnosed, and compared again with the identified effects; at the end the hidden
    effect is revealed. The exit code is 0 for every outcome.

    [bold]Examples[/bold]

    flywheel demo

    flywheel demo --effect cable_friction:2 --seed 7

    Args:
      robot: Your .xml, or a shipped robot's name.
      effect: The robot's effect beyond its MJCF: torque_speed:2 is twice its typical size, none is
        nothing. Drawn by default.
      seed: Seed of all random numbers; a new one each time by default.
      seconds: Length of each recording, in seconds.
      threads: Simulations at the same time.
      page: Output file of the HTML page.
      show: Open the page in a browser; by default on a terminal with a screen.
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
        f"The effect of {loaded.name} beyond its MJCF is hidden until the end. To repeat this: "
        f"{again}"
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
    """The command that repeats this demonstration."""
    parts = ["flywheel", "demo", "--seed", str(seed)]
    if robot != ROBOT:
        parts += ["--robot", robot]
    if effect is not None:
        parts += ["--effect", effect]
    if seconds != SECONDS:
        parts += ["--seconds", f"{seconds:g}"]
    return shlex.join(parts)


def _reveal(out: Out, story: Demonstration) -> None:
    """Print the hidden effect, with its estimate."""
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
        out.print(table("hidden effect", heads, rows))
    out.say(story.assessment.sentence, style="bold")


def _filmed(out: Out, story: Demonstration, path: Path) -> Path | str:
    """The video of the page, or the reason for none."""
    from flywheel.demo.page import worst_window

    try:
        return worst_window(story).film(path)
    except Exception as error:  # whatever a graphics driver throws
        out.say(f"No video: {error}")
        return str(error)


def _on_a_screen(out: Out) -> bool:
    """True if somebody would see a browser window."""
    screen = sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in DISPLAYS)
    return out.is_terminal and screen


def open_page(out: Out, page: Path) -> None:
    """Show the page in a browser, or report that there is none."""
    if not webbrowser.open(page.absolute().as_uri()):
        out.say("No browser was found to open it with.")
