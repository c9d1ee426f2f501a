"""`flywheel robot check`: what is read off an MJCF, and whether the robot settles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import typer
from rich.console import Console

from flywheel.control.gaits import Gait
from flywheel.dynamics.gnn import ChunkNetwork, NetworkConfig
from flywheel.dynamics.gnn.graph import RobotGraph
from flywheel.dynamics.plant import Plant
from flywheel.errors import ConfigError, ModelError, RobotError, UnknownNameError
from flywheel.robots import ROBOTS, Attachment, Robot, load_robot
from pipelines.exits import FAILED
from pipelines.show import console, table

NETWORKS = {"lean": NetworkConfig.lean(), "paper": NetworkConfig.paper()}
EDGES = ("body", "cable", "contact")
SETTLE_SECONDS = 5.0
STILL = 0.02  # of the robot's length per second: slower counts as settled
LOST = 20.0  # lengths from where it began: further counts as flown away


def check_robot(mjcf: str) -> None:
    """Print what the MJCF says; exit with 1 if it cannot be used, or does not settle."""
    out = console()
    try:
        robot = _loaded(mjcf)
    except RobotError as error:
        out.print(f"[red]{mjcf} cannot be used:[/red]")
        out.print(str(error), markup=False)
        raise typer.Exit(FAILED) from None
    _show_robot(out, robot)
    _show_graph(out, robot)
    try:
        ok, words = settles(robot)
    except ModelError as error:
        ok, words = False, str(error)
    out.print(f"[{'green' if ok else 'red'}]{words}[/]", highlight=False)
    if not ok:
        raise typer.Exit(FAILED)
    settings = f"robot={mjcf}" if has_gaits(robot) else f"robot={mjcf} collect.gaits=0"
    out.print(f"Run it with [bold]flywheel run configs/prism3.yaml {settings}[/bold]")


def settles(robot: Robot) -> tuple[bool, str]:
    """Whether the robot comes to rest from its keyframe under holding winches, and a sentence."""
    plant = Plant(robot)
    start = plant.rest()
    before = plant.observe(start).points[0]
    end = plant.settle(SETTLE_SECONDS)
    hold = robot.holding(plant.winch(end))[:, None]
    points = plant.simulate(end, np.repeat(hold, 10, axis=1)).observations.points[0]
    speed = float(np.linalg.norm(points[-1] - points[0], axis=-1).max() / (10 * plant.dt))
    moved = float(np.linalg.norm(points[-1] - before, axis=-1).max())
    if moved > LOST * robot.length:
        return False, f"It flies away: {moved:.3g} m from its keyframe after {SETTLE_SECONDS:g} s."
    words = f"{moved:.3g} m from its keyframe, at {speed:.3g} m/s, after {SETTLE_SECONDS:g} s"
    if speed > STILL * robot.length:
        return (
            False,
            f"It does not settle: {words}. Are cable damping and the keyframe's act right?",
        )
    return True, f"It settles: {words}."


def has_gaits(robot: Robot) -> bool:
    """Whether iteration 0 can begin with gaits."""
    try:
        Gait(robot, "roll", robot.timestep)
    except ConfigError:
        return False
    return True


def _loaded(mjcf: str) -> Robot:
    if mjcf in ROBOTS:
        return load_robot(mjcf)
    path = Path(mjcf)
    if path.suffix != ".xml":
        raise UnknownNameError(
            f"{mjcf!r} is neither a file ending in .xml nor a shipped robot: {', '.join(ROBOTS)}."
        )
    return Robot.from_mjcf(path)


def _show_robot(out: Console, robot: Robot) -> None:
    mass = sum(body.mass for body in robot.bodies)
    ground = "a ground plane" if robot.grounded else "no ground"
    out.print(
        f"[bold]{robot.name}[/bold]: {len(robot.bodies)} bodies of {mass:.4g} kg in all, "
        f"{len(robot.points)} tracked points, {len(robot.cables)} cables, "
        f"{len(robot.winches)} winches, {ground}; L = {robot.length:.4g} m, "
        f"timestep {robot.timestep:g} s, digest {robot.digest[:12]}",
        highlight=False,
        soft_wrap=True,
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
    out.print(
        table(
            "Winches",
            ["winch", "control", "lowest", "highest", "rest length [m]", "#cables", "measured"],
            [
                (
                    w.name,
                    "rate [m/s]" if w.kind == "rate" else "position [m]",
                    *w.control_range,
                    f"{w.rest_range[0]:.4g} to {w.rest_range[1]:.4g}",
                    len(w.cables),
                    "yes" if w.measured else "no",
                )
                for w in robot.winches
            ],
        )
    )


def _end(robot: Robot, end: Attachment) -> str:
    return "world" if end.body < 0 else robot.bodies[end.body].name


def _show_graph(out: Console, robot: Robot) -> None:
    """What the two graph networks hold of the robot."""
    rows = []
    for name, config in NETWORKS.items():
        graph = RobotGraph(robot, config)
        edges = [
            len(graph.relations[kind].senders) if kind in graph.relations else 0 for kind in EDGES
        ]
        weights = sum(p.numel() for p in ChunkNetwork(robot, config).parameters())
        rows.append((name, graph.body_count, *edges, config.width, f"{weights:,}"))
    columns = ["network", "#nodes", *(f"#{kind} edges" for kind in EDGES), "#width", "#weights"]
    out.print(table("Graph (contact edges: as many as there can be at once)", columns, rows))
