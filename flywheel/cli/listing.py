"""`flywheel list`: what there is to choose from."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

from rich.table import Table

from flywheel.cli.show import console, first_line, table

CONFIGS = Path("configs")


def show_list(kind: str) -> None:
    """Print what there is of a kind."""
    console().print(LISTS[kind]())


def robots() -> Table:
    """The shipped robots."""
    from flywheel.robots import ROBOTS, load_robot

    made = [load_robot(name) for name in ROBOTS]
    return table(
        "Robots (or the path of your own MJCF)",
        ["robot", "#bodies", "#tracked points", "#cables", "#winches", "L [m]", "mass [kg]"],
        [
            (
                name,
                len(robot.bodies),
                len(robot.points),
                len(robot.cables),
                len(robot.winches),
                robot.length,
                sum(body.mass for body in robot.bodies),
            )
            for name, robot in zip(ROBOTS, made, strict=True)
        ],
    )


def models() -> Table:
    """What can predict: networks to be trained, and what they are compared with."""
    from flywheel.dynamics import Persistence, PlantDynamics
    from flywheel.dynamics.gnn import NetworkConfig
    from flywheel.dynamics.plant import RestartedPlant

    rows = [
        ("lean", "network", first_line(NetworkConfig.lean)),
        ("paper", "network", first_line(NetworkConfig.paper)),
        ("persistence", "baseline", first_line(Persistence)),
        ("floor", "MuJoCo", first_line(RestartedPlant)),
        ("oracle", "MuJoCo", first_line(PlantDynamics)),
    ]
    return table("Dynamics models", ["model", "kind", "what"], rows)


def datasets() -> Table:
    """The variations of the plant that the configurations name."""
    rows = [
        (str(file.relative_to(CONFIGS)), data.name, _different(data.plant))
        for file, config in _configs()
        for data in config.datasets
    ]
    return table("Data sets (variations of the plant)", ["in", "data set", "differs by"], rows)


def configs() -> Table:
    """The configurations in configs/ and its folders."""
    rows = [
        (str(file), config.robot, config.iterations, len(config.datasets), _first_sentence(file))
        for file, config in _configs()
    ]
    return table("Configurations", ["file", "robot", "#iterations", "#data sets", "what for"], rows)


def runs() -> Table:
    """The runs in runs/."""
    from flywheel.cli.runs import known_runs
    from flywheel.errors import FlywheelError
    from flywheel.runtime.results import RunResult

    rows: list[tuple[object, ...]] = []
    for folder in known_runs():
        try:
            result = RunResult.load(folder)
            state = "finished" if result.finished else "not finished"
            rows.append((str(folder), result.robot, len(result.of_arm("mppi")), state))
        except FlywheelError as error:
            rows.append((str(folder), None, None, str(error)))
    return table("Runs", ["folder", "robot", "#iterations", "state"], rows)


def registry(title: str, module: str, name: str) -> Callable[[], Table]:
    """A list of one of the literal registries, with the first line of what each entry says."""

    def listed() -> Table:
        entries: dict[str, Any] = getattr(import_module(module), name)
        rows = [(key, first_line(entry)) for key, entry in entries.items()]
        return table(title, ["name", "what"], rows)

    return listed


def _configs() -> Iterable[tuple[Path, Any]]:
    from flywheel.runtime.config.run_config import load_config

    return [(file, load_config(file)) for file in sorted(CONFIGS.rglob("*.yaml"))]


def _different(plant: Any) -> str:
    nominal = type(plant)()
    changed = {k: v for k, v in plant.model_dump().items() if v != getattr(nominal, k)}
    return ", ".join(f"{key} x {value:g}" for key, value in changed.items()) or "nothing"


def _first_sentence(file: Path) -> str:
    """Of the comment that a file begins with."""
    lines = takewhile(lambda line: line.startswith("#"), file.read_text().splitlines())
    comment = " ".join(line.removeprefix("#").strip() for line in lines)
    return comment.split(". ")[0].removesuffix(".")


LISTS: dict[str, Callable[[], Table]] = {
    "robots": robots,
    "tasks": registry("Tasks", "flywheel.tasks", "TASKS"),
    "models": models,
    "controllers": registry("Controllers", "flywheel.control", "CONTROLLERS"),
    "datasets": datasets,
    "configs": configs,
    "runs": runs,
}
