"""Options of commands that the library takes as they are: a field's words in the docstring are its help."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from inspect import getdoc
from typing import Annotated, Literal

from flywheel.quantities import (
    DRAWS,
    HORIZON_SECONDS,
    MINUTES,
    TYPICAL_SIZES,
    ControlStep,
    HorizonSeconds,
    Samples,
    Seed,
)


def said_of(name: str, thing: Callable[..., object]) -> str:
    """Description of a record's attribute, or a function's argument, in one line; "" for none."""
    _, *found = re.split(r"^(?:Attributes|Args):\n", getdoc(thing) or "", maxsplit=1, flags=re.M)
    for entry in re.split(r"\n(?=  \S)", "".join(found)):
        names, _, text = entry.partition(":")
        if name in names.strip().split(", "):
            return " ".join(text.split())
    return ""


@dataclass(frozen=True)
class AdaptOptions:
    """Requests to an adaptation of an MJCF or a structure.

    Attributes:
      winches: Passive cables that become winches, by name or pattern: 'side*'.
      winch_kind: Control of these winches.
      unit: Of a structure's lengths; dm of nodes, m of a platform.
      up: A structure's axis that points up; y of nodes, z of a platform.
      without: Name of an adaptation to leave out.
    """

    winches: Annotated[tuple[str, ...], "--winch"] = ()
    winch_kind: Literal["rate", "position"] = "rate"
    unit: Literal["m", "dm", "cm", "mm"] | None = None
    up: Literal["x", "y", "z"] | None = None
    without: frozenset[str] = frozenset()


@dataclass(frozen=True)
class ImportOptions:
    """Options of an import of logs.

    Attributes:
      split: Split of the episodes, permanently; auto is by the hash of the content.
      dt: Control step, in seconds.
    """

    split: Literal["auto", "train", "validation", "test"] = "auto"
    dt: ControlStep = 0.01


@dataclass(frozen=True)
class ComparisonOptions:
    """Options of a comparison of models with recordings.

    Attributes:
      horizon: Horizon of each prediction, in seconds; less if the recordings are shorter.
      draws: Draws of the noise, for its influence on the error.
      seed: Seed of the draws.
      fit_starts: Also the errors of plants with fitted initial states; slow.
    """

    horizon: HorizonSeconds = 1.0
    draws: Annotated[int, DRAWS] = 100
    seed: Seed = 0
    fit_starts: bool = False


@dataclass(frozen=True)
class DiagnosisOptions:
    """Options of a diagnosis.

    Attributes:
      window: Length of the windows, in seconds; by default suitable for the robot.
      minutes: Stop after so many minutes with the best answer so far, as on Ctrl-C.
      seed: Seed of all random numbers.
    """

    window: Annotated[float | None, HORIZON_SECONDS] = None
    minutes: Annotated[float | None, MINUTES] = None
    seed: Seed = 0


@dataclass(frozen=True)
class PowerOptions:
    """Options of the power of an experiment.

    Attributes:
      size: Size of the effects to distinguish, in typical sizes.
      window: Length of the windows, in seconds; by default suitable for the robot.
    """

    size: Annotated[float, TYPICAL_SIZES] = 1.0
    window: Annotated[float | None, HORIZON_SECONDS] = None


@dataclass(frozen=True)
class DesignOptions:
    """Options of the design of an experiment.

    Attributes:
      size: Size of the effects, in typical sizes.
      seconds: Length of the script, in seconds.
      candidates: Number of drawn scripts; as many variations follow.
      seed: Seed of all random numbers.
    """

    size: Annotated[float, TYPICAL_SIZES] = 1.0
    seconds: HorizonSeconds = 3.0
    candidates: Samples = 64
    seed: Seed = 0
