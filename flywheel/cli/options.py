"""Options shared by several commands, and parsing of numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from flywheel.quantities import FACTOR, NOISE, Bounds, ControlStep, Threads

if TYPE_CHECKING:
    from flywheel.diagnosis.fitting.windows import ChannelNoise
    from flywheel.records import ChannelKind
    from flywheel.robots import Robot

N = TypeVar("N", int, float, None)
CHAMPION = "champion"  # the model of a run that its gate let pass
UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def within(bounds: Bounds) -> Callable[[N], N]:
    """A callback that accepts numbers within the bounds, and an omitted option."""

    def checked(value: N) -> N:
        if value is not None and value not in bounds:
            raise typer.BadParameter(f"It must be a number {bounds}; got {value!r}.")
        return value

    return checked


RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="A run's folder, e.g. runs/prism3.")
]
Overrides = Annotated[
    tuple[str, ...],
    typer.Argument(
        metavar="[KEY=VALUE]...",
        help="Settings to change, by their path in the configuration, e.g. mppi.samples=64.",
    ),
]
LawFiles = Annotated[tuple[Path, ...], "PY"]
ChannelStatements = Annotated[
    tuple[str, ...],
    typer.Option(
        "--channel",
        metavar="KIND[@NAME]=NOISE",
        help="Measured beside the points, of every cable or winch or of one, with its noise: tension=0.5N, "
        "length@long_01=0.3mm, winch=0.1mm. Repeatable.",
    ),
]
SettingStatements = Annotated[
    tuple[str, ...],
    typer.Option(
        "--set",
        metavar="SETTING=NUMBER",
        help="Value of a setting, such as limits.threshold=36; `flywheel list settings` shows "
        "them. Repeatable.",
    ),
]


@dataclass(frozen=True, kw_only=True)
class PlantOptions:
    """The plant that a command asks or tests.

    Attributes:
      robot: Your .xml, a shipped robot's name, or an adopted plant's folder.
      effects_from: A Python file with effects of your own, which is run. Repeatable.
      dt: Control step, in seconds.
      threads: Simulations at the same time.
    """

    robot: str
    effects_from: LawFiles = ()
    dt: ControlStep = 0.01
    threads: Threads = 2

    @property
    def files(self) -> tuple[str | Path, ...]:
        """Paths that no output may overwrite."""
        return (*self.effects_from, self.robot)


def number(text: str, what: str, bounds: Bounds, unit: str = "") -> float:
    """Parse a number within bounds.

    Args:
      text: input.
      what: name of the number, at the beginning of a sentence.
      bounds: of the number.
      unit: behind it.

    Raises:
      ConfigError: it is not one.
    """
    from flywheel.errors import ConfigError
    from flywheel.files import shown

    try:
        value = float(text.removesuffix(unit))
    except ValueError:
        value = math.nan  # which is within no bounds
    if value not in bounds:
        raise ConfigError(f"{what} must be a number {bounds}; got {shown(text)}.")
    return value


def length_of(text: str, robot: Robot) -> float:
    """A length [m]; a number without a unit is a fraction of the robot's length.

    Raises:
      ConfigError: not a positive number, or another unit.
    """
    unit = next((name for name in UNITS if text.endswith(name)), "")
    what = (
        f"A length, in {', '.join(UNITS)}, or without a unit as a fraction of the robot's "
        f"({robot.length:g} m), such as 9mm, 0.009m, 0.003,"
    )
    value = number(text, what, FACTOR, unit)
    return value * (UNITS[unit] if unit else robot.length)


def channels_of(statements: Sequence[str], robot: Robot) -> tuple[ChannelNoise, ...]:
    """Channels beside the points: "tension=0.5N" of every cable, "tension@long_01=0.5N" of one.

    Of two noises of one channel the last counts.

    Raises:
      ConfigError: not of that form, a noise that is no positive number, or another unit.
      UnknownNameError: no such kind, cable or winch.
    """
    from flywheel.data.recordings.sources import FORCES, LENGTHS
    from flywheel.diagnosis.fitting.windows import ChannelNoise
    from flywheel.errors import ConfigError
    from flywheel.files import shown
    from flywheel.records import ChannelKind
    from flywheel.registry import lookup

    cables, winches = ([each.name for each in parts] for parts in (robot.cables, robot.winches))
    kinds: dict[str, tuple[ChannelKind, list[str], dict[str, float]]] = {
        "tension": ("tension", cables, FORCES),
        "length": ("length", cables, LENGTHS),
        "winch": ("winch", winches, FORCES if robot.tension_driven else LENGTHS),
    }
    found = dict[tuple[ChannelKind, str], ChannelNoise]()
    for statement in statements:
        wanted, _, text = statement.partition("=")
        name, _, place = wanted.partition("@")
        kind, names, units = lookup(kinds, name, "channel")
        unit = next((u for u in sorted(units, key=len, reverse=True) if text.endswith(u)), "")
        what = f"The noise of a {kind}, in {', '.join(units)}, such as 0.5{next(iter(units))},"
        if not unit:
            raise ConfigError(f"{what} needs one of these units; got {shown(text)}.")
        sigma = number(text, what, FACTOR, unit) * units[unit]
        NOISE.check(sigma, what, ConfigError)
        part = "winch" if kind == "winch" else "cable"
        some = [lookup(dict.fromkeys(names, place), place, part)] if place else names
        found |= {(kind, each): ChannelNoise((kind, each), sigma) for each in some}
    return tuple(found.values())
