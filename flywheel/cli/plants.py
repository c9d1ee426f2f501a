"""Plants by name: a shipped robot, an MJCF, or an adopted plant."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from flywheel.dynamics.plant import Plant, with_effects
from flywheel.effects import NAMED, AdoptedPlant
from flywheel.effects.adopted import PLANT, plant_file
from flywheel.robots import load_robot


def adopted_file(name: str) -> Path | None:
    """The file of an adopted plant, where the name is its folder or the file itself."""
    path = Path(name)
    if path.suffix in {".yaml", ".yml"}:
        return plant_file(path)
    with suppress(OSError, ValueError):  # no name that a file can have
        if (path / PLANT).exists():
            return path / PLANT
    return None


def open_plant(name: str, dt: float, threads: int = 1) -> Plant:
    """The plant that a name means.

    Raises:
      RobotError, UnknownNameError, ConfigError: there is none, or it cannot be used.
    """
    path = adopted_file(name)
    if path is None:
        return Plant(load_robot(name), dt, threads=threads)
    adopted, robot = AdoptedPlant.read(path)
    return with_effects(Plant(robot, dt, threads=threads), adopted.terms(robot, NAMED))
