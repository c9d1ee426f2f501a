"""`flywheel robot check`: content of an MJCF, its settling, and the command to run it."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flywheel.cli.app import App
from flywheel.cli.console import Out, console, table
from flywheel.cli.exits import FAILED, USAGE
from flywheel.cli.robot.adapt import adapt
from flywheel.cli.robot.log import log
from flywheel.cli.robot.picture import PictureOption, write_picture
from flywheel.cli.robot.reveal import reveal
from flywheel.cli.robot.serve import serve
from flywheel.cli.robot.settling import DT, control_step, share, verdict
from flywheel.cli.robot.steps import beyond_limit, show_steps

if TYPE_CHECKING:
    from flywheel.dynamics.plant import Plant, Settling
    from flywheel.records import Floats, State
    from flywheel.robots import Attachment, Robot
    from flywheel.robots.adapt import Adapted

app = App(no_args_is_help=True, help="Bring your own robot.")
app.command()(adapt)
app.command()(serve)
app.command()(reveal)
app.command()(log)

EDGES = ("body", "cable", "contact")
NEAR = 0.01  # of the robot's length: nearer counts as where the keyframe says
UNITS = {"decimetres": 10.0, "centimetres": 100.0, "millimetres": 1000.0}  # how many are a metre
STRANGE = 3.0  # times the Earth's gravity; Jupiter's is 2.5 times as strong
LONG = 50.0  # [m]; no body of a cable robot that was built is as long, telescopes' cabins included
CONFIG = "prism3"  # that a robot of one's own is run with


@app.command()
def check(
    mjcf: Annotated[str, "MJCF"],
    *,
    dt: Annotated[
        float | None,
        typer.Option(
            max=1.0,
            help="Time between commands, in seconds; by default 0.01 or the nearest possible one.",
        ),
    ] = None,
    picture: PictureOption = None,
) -> None:
    """Print the content of an MJCF, test its settling and time steps, and show how to run it.

    Exits with 1 if the MJCF cannot be used.

    [bold]Example[/bold]

    flywheel robot check my_robot.xml

    Args:
      mjcf: Your .xml, or a shipped robot's name.
    """
    from flywheel.dynamics.plant import Plant, settling
    from flywheel.errors import ModelError
    from flywheel.outputs import check_outputs
    from flywheel.robots.remarks import remarks

    out = console()
    check_outputs({"picture": picture}, [mjcf])
    found = _loaded(out, mjcf)
    step = control_step(found, dt)
    if picture is not None:
        write_picture(out, found, picture)
    _show_robot(out, found)
    _show_graph(out, found)
    plant = Plant(found, step)
    for remark in (*_about_units(plant), *remarks(found)):
        out.say(remark, style="yellow")
    if words := beyond_limit(plant):
        out.say(words, style="red")
    try:
        end = settling(plant)
    except ModelError as error:
        out.say(str(error), style="red")
        raise typer.Exit(FAILED) from None
    usable, words = verdict(found, end)
    out.say(words, style="red" if not usable else "green" if end.still else "yellow")
    if not usable:
        raise typer.Exit(FAILED)
    if not show_steps(out, plant):
        raise typer.Exit(FAILED)
    for remark in _remarks(found, end, step):
        out.say(remark, style="yellow")
    if found.winches and not found.tension_driven:
        command = shlex.join(["flywheel", "run", CONFIG, *_overrides(mjcf, found, step)])
        out.say(f"Run it with: {command}", style="bold")


def _loaded(out: Out, mjcf: str) -> Robot:
    """The robot of a file or a name; exits with 1 and all problems if it cannot be used, with 2 if MuJoCo
    cannot either.

    Raises:
      MjcfError: the file is missing, or not an MJCF.
      UnknownNameError: no such robot.
    """
    from flywheel.errors import MjcfError, RobotError
    from flywheel.robots import load_robot
    from flywheel.robots.adapt import adapt as adapted_from
    from flywheel.robots.mjcf_source import read_mjcf

    if _is_file(mjcf):
        read_mjcf(mjcf)  # which says why a file cannot be read
    try:
        return load_robot(mjcf)
    except RobotError as error:
        code = USAGE if isinstance(error, MjcfError) else FAILED
    try:
        adapted = adapted_from(mjcf)
    except MjcfError as error:
        raise MjcfError(f"{mjcf}: {error}") from None
    _show_problems(out, mjcf, adapted)
    raise typer.Exit(code)


def _show_problems(out: Out, mjcf: str, adapted: Adapted) -> None:
    """All problems of a refused MJCF, those of structure first, each with what mends it."""
    out.say(f"{mjcf} cannot be used:", style="red")
    for number, (problem, name) in enumerate(adapted.mended.items(), 1):
        out.say(f"{number}. {problem}")
        if name:
            sure = {str(change.certainty) for each, change in adapted.changes if each == name}
            out.say(f"   -> adapt mends it: {name} ({' and '.join(sorted(sure))})", style="green")
    command = shlex.join(["flywheel", "robot", "adapt", mjcf])
    if not adapted.left:
        out.say(f"All of them are mended by: {command}", style="bold")
    elif any(adapted.mended.values()):
        many = f"{len(adapted.left)} of them"
        out.say(f"Mend {many} by hand first; the others are then mended by: {command}")


def _is_file(mjcf: str) -> bool:
    """True for a file, False for a shipped robot."""
    from flywheel.errors import UnknownNameError
    from flywheel.robots import ROBOTS
    from flywheel.robots.adapt.structures import is_structure

    if mjcf in ROBOTS:
        return False
    if Path(mjcf).suffix != ".xml":
        hint = " Structures become MJCFs by flywheel robot adapt." if is_structure(mjcf) else ""
        raise UnknownNameError(
            f"{mjcf!r} is neither a file ending in .xml nor a shipped robot: {', '.join(ROBOTS)}.{hint}"
        )
    return True


def _about_units(plant: Plant) -> Iterator[str]:
    """Hints at lengths that are not in metres, and gravity that is not the Earth's."""
    from flywheel.robots import GRAVITY
    from flywheel.robots.mjcf_reader import gravity_of

    robot, gravity = plant.robot, float(abs(gravity_of(plant.model)[2]))
    times = gravity / GRAVITY
    for unit, many in UNITS.items():
        if math.isclose(times, many, rel_tol=0.03):
            yield (
                f"Gravity is {gravity:g} m/s^2, and L = {robot.length:.4g} m: lengths in {unit}? MuJoCo "
                f"counts in metres: divide lengths by {many:g}, and everything that has metres in it."
            )
            return
    if not gravity:
        yield "There is no gravity: nothing falls or stands, and drops and tasks on the ground say nothing."
    elif times > STRANGE:
        yield f"Gravity is {gravity:g} m/s^2, {times:.3g} times the Earth's. Is it meant?"
    if robot.length > LONG:
        yield (
            f"L = {robot.length:.4g} m: lengths in millimetres or centimetres? MuJoCo counts in metres."
        )


def _remarks(robot: Robot, found: Settling, step: float) -> Iterator[str]:
    """Surprising but allowed properties."""
    from flywheel.evaluation.statistics import shows_turn

    if found.moved > NEAR * robot.length and found.rest is not None:
        yield (
            f"Its keyframe is {share(robot, found.moved)} from where it rests, so every "
            f"reset begins with a fall. Take this one:\n{key_line(found.rest)}"
        )
    if robot.control_steps(DT) != (DT,):
        yield (
            f"Its timestep of {robot.timestep:g} s does not divide the {DT:g} s that commands take by "
            f"default. Give them --dt {step:.12g}."
        )
    if not robot.free:
        yield (
            "It has joints: it can be run as below, and power, design and recordings work; compare and "
            "diagnose, which restart it from what is seen, cannot use it yet."
        )
    if dark := [body.name for body in robot.bodies if not shows_turn(robot, body)]:
        yield (
            "The rotation of a body is invisible if its tracked points are one or in one place "
            f"({', '.join(dark)}): give it more, if that matters."
        )


def key_line(state: State) -> str:
    """A keyframe at a state (1,), in MJCF."""

    def numbers(values: Floats) -> str:
        return " ".join(f"{value + 0.0:.7g}" for value in values.round(6))

    act = f' act="{numbers(state.act[0])}"' if state.act.size else ""
    return f'<key name="settled" qpos="{numbers(state.qpos[0])}"{act}/>'


def _overrides(mjcf: str, robot: Robot, step: float) -> Iterator[str]:
    """`key=value` with which the shipped configurations can be run with the robot."""
    from flywheel.robots import COURSES
    from flywheel.runtime.config.run_config import RunConfig
    from flywheel.runtime.run.suitability import misfits

    # Quotes for what YAML would take for a list or a number.
    plain = _is_plain(mjcf)
    yield f"model={mjcf if plain else json.dumps(mjcf)}"
    config = RunConfig.model_validate({"evaluate": {"unseen": list(COURSES)}})
    yield from (misfit.override for misfit in misfits(config, robot, step))


def _is_plain(text: str) -> bool:
    """True if YAML reads a text as the same text."""
    import yaml

    try:
        return bool(yaml.safe_load(text) == text)
    except yaml.YAMLError:
        return False


def _show_robot(out: Out, robot: Robot) -> None:
    mass = sum(body.mass for body in robot.bodies)
    ground = "a ground plane" if robot.grounded else "no ground"
    out.say(
        f"{robot.name}: {len(robot.bodies)} bodies of {mass:.4g} kg in all, "
        f"{len(robot.points)} tracked points, {len(robot.cables)} cables, "
        f"{len(robot.winches)} winches, {ground}; L = {robot.length:.4g} m, "
        f"timestep {robot.timestep:g} s, digest {robot.digest[:12]}",
        style="bold",
    )
    out.print(
        table(
            "Bodies",
            ["body", "mass [kg]", "#primitives", "tracked points"],
            [
                (
                    b.name,
                    b.mass,
                    len(b.primitives),
                    " ".join(robot.points[p].name for p in b.points),
                )
                for b in robot.bodies
            ],
        )
    )
    out.print(
        table(
            "Cables",
            ["cable", "from", "to", "k [N/m]", "c [N s/m]", "rest length [m]", "winch"],
            [
                (
                    c.name,
                    *(_end(robot, end) for end in c.ends),
                    c.stiffness,
                    c.damping,
                    c.rest_length,
                    robot.winches[c.winch].name if c.winch >= 0 else "(passive)",
                )
                for c in robot.cables
            ],
        )
    )
    if robot.winches:
        _show_winches(out, robot)


def _show_winches(out: Out, robot: Robot) -> None:
    out.print(
        table(
            "Winches",
            ["winch", "control", "lowest", "highest", "positions", "#cables", "measured"],
            [
                (
                    w.name,
                    f"{w.kind} [{w.unit}]",
                    *w.control_range,
                    f"{w.rest_range[0]:.4g} to {w.rest_range[1]:.4g} {w.position_unit}",
                    len(w.cables),
                    "yes" if w.measured else "no",
                )
                for w in robot.winches
            ],
        )
    )


def _end(robot: Robot, end: Attachment) -> str:
    return "world" if end.body < 0 else robot.bodies[end.body].name


def _show_graph(out: Out, robot: Robot) -> None:
    """Content of the two graph networks of the robot; none for winches that take tensions."""
    if robot.tension_driven:
        return
    from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
    from flywheel.dynamics.gnn.graph import RobotGraph

    networks = {"lean": NetworkConfig.lean(), "paper": NetworkConfig.paper()}
    rows = []
    for name, config in networks.items():
        graph = RobotGraph(robot, config)
        edges = [
            len(graph.relations[kind].senders) if kind in graph.relations else 0 for kind in EDGES
        ]
        weights = sum(p.numel() for p in ChunkNetwork(robot, config).parameters())
        rows.append((name, graph.body_count, *edges, config.width, f"{weights:,}"))
    columns = ["network", "#nodes", *(f"#{kind} edges" for kind in EDGES), "#width", "#weights"]
    out.print(table("Graph (contact edges: as many as there can be at once)", columns, rows))
