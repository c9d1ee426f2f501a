"""`flywheel list`: the available names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.table import Table

from flywheel.cli.console import console, first_line, table
from flywheel.cli.options import LawFiles

if TYPE_CHECKING:
    from flywheel.runtime.config.run_config import RunConfig


TRIED = 0.01  # control step at which law files are tried [s]


class Kind(StrEnum):
    """Kinds of names."""

    robots = "robots"
    tasks = "tasks"
    models = "models"
    controllers = "controllers"
    effects = "effects"
    datasets = "datasets"
    configs = "configs"
    runs = "runs"
    settings = "settings"


def list_(
    kind: Kind,
    *,
    effects_from: LawFiles = (),
) -> None:
    """List available robots, tasks, models, effects, settings and so on.

    [bold]Examples[/bold]

    flywheel list robots

    flywheel list effects --effects-from my_laws.py [dim](also checks the file)[/dim]

    Args:
      kind: Kind of names.
      effects_from: A Python file with effects of your own, which is run. Repeatable.
    """
    if effects_from and kind is not Kind.effects:
        raise typer.BadParameter(f"--effects-from is for effects, not for {kind.value}.")
    console().print(effects(effects_from) if kind is Kind.effects else LISTS[kind.value]())


def effects(effects_from: Sequence[Path] = ()) -> Table:
    """The effects of the library, and of law files, which are tested on a shipped robot."""
    from flywheel.cli.models import Library
    from flywheel.dynamics.plant import Plant
    from flywheel.robots import ROBOTS, load_robot

    library = Library.of(effects_from)
    if library.files:
        robot = load_robot(next(iter(ROBOTS)))
        library.check(Plant(robot, robot.control_steps(TRIED)[0]))
    rows = [(name, first_line(effect)) for name, effect in library.asked().items()]
    return table("Effects", ["name", "what"], rows)


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
    """Predictors: networks to be trained, and baselines."""
    from flywheel.dynamics import PlantDynamics
    from flywheel.dynamics.baselines.named import BASELINES
    from flywheel.dynamics.baselines.weights import FITTED
    from flywheel.dynamics.gnn import NetworkConfig
    from flywheel.dynamics.gnn.shipped import ModelCard, shipped_networks

    rows = [
        ("lean", "network", first_line(NetworkConfig.lean)),
        ("paper", "network", first_line(NetworkConfig.paper)),
        ("hybrid", "network", first_line(NetworkConfig.hybrid)),
        *((name, "baseline", first_line(make)) for name, make in BASELINES.items()),
        *((f"{name}, fitted", "baseline", first_line(kind)) for name, kind in FITTED.items()),
        ("oracle", "MuJoCo", first_line(PlantDynamics)),
        *(
            (f"shipped for {robot}", "network", str(ModelCard.read(path)))
            for robot, path in shipped_networks().items()
        ),
    ]
    return table("Dynamics models", ["model", "kind", "what"], rows)


def datasets() -> Table:
    """The variations of the plant that the configurations name."""
    rows = [
        (name, data.name, _different(data.plant))
        for name, (_, config) in _configs().items()
        for data in config.datasets
    ]
    return table("Data sets (variations of the plant)", ["in", "data set", "differs by"], rows)


def configs() -> Table:
    """The shipped configurations, and those in ./configs."""
    rows = [
        (name, config.model, config.iterations, len(config.datasets), _first_sentence(file))
        for name, (file, config) in _configs().items()
    ]
    columns = ["configuration", "model", "#iterations", "#data sets", "purpose"]
    return table("Configurations (flywheel run NAME, flywheel config copy NAME)", columns, rows)


def runs() -> Table:
    """The runs in runs/."""
    from flywheel.cli.runs.opening import known_runs
    from flywheel.errors import FlywheelError
    from flywheel.results import RunResult

    rows: list[tuple[object, ...]] = []
    for folder in known_runs():
        try:
            result = RunResult.load(folder)
            state = "finished" if result.finished else "not finished"
            rows.append((str(folder), result.robot, len(result.of_arm("mppi")), state))
        except FlywheelError as error:
            rows.append((str(folder), None, None, str(error)))
    return table("Runs", ["folder", "robot", "#iterations", "state"], rows)


def settings() -> Table:
    """The settings of a diagnosis."""
    from flywheel.diagnosis.settings import Settings, described, numbers

    rows = [(path, value, described(path)) for path, value in numbers(Settings()).items()]
    title = "Settings of a diagnosis (--set SETTING=NUMBER of diagnose, power and design)"
    return table(title, ["setting", "#value", "what"], rows)


def registry(title: str, module: str, name: str) -> Callable[[], Table]:
    """A list of a registry, with the first line of each entry's docstring."""

    def listed() -> Table:
        entries: dict[str, Any] = getattr(import_module(module), name)
        rows = [(key, first_line(entry)) for key, entry in entries.items()]
        return table(title, ["name", "what"], rows)

    return listed


def _configs() -> dict[str, tuple[Path, RunConfig]]:
    """Name, or path of the user's own -> file and content."""
    from flywheel.runtime.config.run_config import load_config
    from flywheel.runtime.config.shipped import shipped_configs

    shipped = shipped_configs()
    known = {file.resolve() for file in shipped.values()}
    own = [file for file in sorted(Path("configs").rglob("*.yaml")) if file.resolve() not in known]
    files = {**shipped, **{str(file): file for file in own}}
    return {name: (file, load_config(file)) for name, file in files.items()}


def _different(plant: Any) -> str:
    nominal = type(plant)()
    changed = {k: v for k, v in plant.model_dump().items() if v != getattr(nominal, k)}
    return ", ".join(f"{key} x {value:g}" for key, value in changed.items()) or "nothing"


def _first_sentence(file: Path) -> str:
    """The first sentence of the comment at the beginning of a file."""
    lines = takewhile(
        lambda line: line.startswith("#"), file.read_text(encoding="utf-8").splitlines()
    )
    comment = " ".join(line.removeprefix("#").strip() for line in lines)
    return comment.split(". ")[0].removesuffix(".")


LISTS: dict[str, Callable[[], Table]] = {
    "robots": robots,
    "tasks": registry("Tasks", "flywheel.tasks", "TASKS"),
    "models": models,
    "controllers": registry("Controllers", "flywheel.control", "CONTROLLERS"),
    "effects": effects,
    "datasets": datasets,
    "configs": configs,
    "runs": runs,
    "settings": settings,
}
