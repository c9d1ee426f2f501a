"""`flywheel robot adapt`: a laboratory's MJCF becomes a robot."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.console import Out, console
from flywheel.cli.exits import FAILED
from flywheel.cli.robot.picture import PictureOption, write_picture
from flywheel.cli.robot.settling import control_step, verdict
from flywheel.cli.robot.steps import chosen, said
from flywheel.options import AdaptOptions

if TYPE_CHECKING:
    from flywheel.robots.adapt import Adapted, Change

SETTLED = 0.01  # of the robot's length: a keyframe that is farther from rest is replaced


def adapt(
    mjcf: Annotated[Path, "MJCF"],
    *,
    output: Annotated[Path | None, "--output", "-o"] = None,
    options: AdaptOptions = AdaptOptions(),
    picture: PictureOption = None,
    dry_run: Annotated[bool, "--dry-run"] = False,
    yes: Annotated[bool, "--yes"] = False,
) -> None:
    """Write the robot that `check` accepts, with the reason of each change.

    Changes are certain, equivalent (both files were simulated, and moved alike), or guesses, which are
    asked for. Exits with 1 if the MJCF cannot become a robot, or guesses are not confirmed.

    [bold]Example[/bold]

    flywheel robot adapt lab.xml -o my_robot.xml --winch 'side*'

    Args:
      mjcf: An .xml; or a structure in .yaml or .json.
      output: New file; by default MJCF's name with -robot.xml.
      dry_run: List the changes only.
      yes: Take all guesses without asking.
    """
    from flywheel.outputs import check_outputs
    from flywheel.registry import lookup
    from flywheel.robots.adapt import ADAPTATIONS
    from flywheel.robots.adapt.structures import is_structure

    for name in options.without:
        lookup(ADAPTATIONS, name, "adaptation")
    place = output or Path(f"{mjcf.stem}-robot.xml")
    if not dry_run:
        check_outputs({"robot": place, "picture": picture}, [mjcf])
    out = console()
    xml = _adapted(out, mjcf, options, ask=not dry_run and not yes)
    if xml is None:
        out.say(f"{mjcf} can be used as it is.", style="green")
        return
    xml, usable = _settled(out, xml)
    if usable and is_structure(mjcf):
        xml = _stepped(out, xml)
    if dry_run:
        out.say("Nothing is written (--dry-run).")
    else:
        _write(out, xml, place, picture)
    if not usable:
        raise typer.Exit(FAILED)


def _adapted(out: Out, mjcf: Path, options: AdaptOptions, ask: bool) -> str | None:
    """The adapted MJCF, with its changes shown and, if `ask`, its guesses confirmed; None without changes.

    Raises:
      Exit: it cannot become a robot, or guesses are not confirmed.
    """
    from flywheel.errors import MjcfError
    from flywheel.robots.adapt import STRUCTURE
    from flywheel.robots.adapt import adapt as adapted_from

    try:
        adapted = adapted_from(mjcf, options)
    except MjcfError as error:
        raise MjcfError(f"{mjcf}: {error}") from None
    _show(out, mjcf, adapted)
    if ask and (declined := _declined(out, adapted)):
        if STRUCTURE in declined:
            out.say("Nothing is written: give --unit and --up.")
            raise typer.Exit(FAILED)
        adapted = adapted_from(mjcf, replace(options, without=options.without | declined))
        _refuse_left(out, mjcf, adapted)
    return adapted.xml if adapted.changes else None


def _write(out: Out, xml: str, place: Path, picture: Path | None) -> None:
    from flywheel.outputs import write_output
    from flywheel.robots import read_robot

    write_output(place, f"{xml}\n")
    if picture is not None:
        write_picture(out, read_robot(xml), picture)
    out.say(f"Written: {place}. See it with: flywheel robot check {place}", style="bold")


def _show(out: Out, mjcf: Path, adapted: Adapted) -> None:
    _refuse_left(out, mjcf, adapted)
    for number, (name, change) in enumerate(adapted.changes, 1):
        guess = change.certainty == "guess"
        out.say(
            f"{number}. {name} ({change.certainty}): {change.reason}", "yellow" if guess else None
        )
        for edit in change.edits:
            out.say(f"     {edit}")
        if change.evidence:
            out.say(f"     {change.evidence}")
    counts = Counter(str(change.certainty) for _, change in adapted.changes)
    if counts:
        out.say(f"Changes: {', '.join(f'{count} {kind}' for kind, count in counts.items())}.")


def _refuse_left(out: Out, mjcf: Path, adapted: Adapted) -> None:
    """End with 1 if problems are left.

    Raises:
      Exit: there are.
    """
    if adapted.left:
        out.say(f"{mjcf} cannot become a robot, and nothing is written:", style="red")
        for number, problem in enumerate(adapted.left, 1):
            out.say(f"{number}. {problem}")
        raise typer.Exit(FAILED)


def _declined(out: Out, adapted: Adapted) -> frozenset[str]:
    """Names of the adaptations whose guesses are declined, as asked on a terminal.

    Raises:
      Exit: there are guesses, and no terminal.
    """
    guesses = [(name, change) for name, change in adapted.changes if change.certainty == "guess"]
    if not guesses:
        return frozenset()
    names = ", ".join(dict.fromkeys(name for name, _ in guesses))
    if not on_terminal():
        out.say(
            f"Nothing is written: --yes takes the guesses ({names}), --without NAME leaves one out."
        )
        raise typer.Exit(FAILED)
    if typer.confirm(f"Take all guesses ({names})?", default=True):
        return frozenset()
    return frozenset(name for name, change in guesses if not _taken(name, change))


def on_terminal() -> bool:
    """True if somebody can answer questions."""
    return sys.stdin.isatty()


def _taken(name: str, change: Change) -> bool:
    return typer.confirm(f"Take {name}? {change.reason}", default=True)


def _settled(out: Out, xml: str) -> tuple[str, bool]:
    """A robot whose first keyframe is at rest, if it comes to rest; and False if it cannot be used."""
    from flywheel.dynamics.plant import Plant, settling
    from flywheel.errors import ModelError
    from flywheel.robots import read_robot
    from flywheel.robots.adapt import with_key
    from flywheel.robots.remarks import without_winches

    robot = read_robot(xml)
    for remark in without_winches(robot):
        out.say(remark, style="yellow")
    try:
        found = settling(Plant(robot, control_step(robot, None)))
    except ModelError as error:
        out.say(str(error), style="red")
        return xml, False
    usable, words = verdict(robot, found)
    out.say(words, style="green" if usable else "red")
    if usable and found.rest is not None and found.moved > SETTLED * robot.length:
        state = found.rest
        xml = with_key(xml, state.qpos[0], state.act[0])
        out.say(
            f"The first keyframe is where it rests, {found.moved:.3g} m from where it was, so that no reset "
            "begins with a fall."
        )
    return xml, usable


def _stepped(out: Out, xml: str) -> str:
    """A structure's robot, whose file says no time steps, with those that suit it."""
    from flywheel.dynamics.plant import Plant
    from flywheel.robots import read_robot
    from flywheel.robots.adapt import with_steps

    robot = read_robot(xml)
    best = chosen(Plant(robot, control_step(robot, None)))
    if best is None:
        return xml
    out.say(f"Its time steps are chosen by what they cost: {said(best)}.")
    return with_steps(xml, best.integrator, best.timestep)
