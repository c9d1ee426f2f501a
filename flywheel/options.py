"""Options of commands that the library takes as they are: a field's words in the docstring are its help."""

from __future__ import annotations

import re
from dataclasses import dataclass
from inspect import getdoc
from typing import Annotated, Literal

from flywheel.quantities import DRAWS, HORIZON_SECONDS, SEED


def said_of(name: str, record: type) -> str:
    """Description of one of a record's attributes in its docstring, in one line; "" for none."""
    _, _, attributes = (getdoc(record) or "").partition("Attributes:\n")
    for entry in re.split(r"\n(?=  \S)", attributes):
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
class ComparisonOptions:
    """Options of a comparison of models with recordings.

    Attributes:
      horizon: Horizon of each prediction, in seconds; less if the recordings are shorter.
      draws: Draws of the noise, for its influence on the error.
      seed: Seed of the draws.
      fit_starts: Also the errors of plants with fitted initial states; slow.
    """

    horizon: Annotated[float, HORIZON_SECONDS] = 1.0
    draws: Annotated[int, DRAWS] = 100
    seed: Annotated[int, SEED] = 0
    fit_starts: bool = False
