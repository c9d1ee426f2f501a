"""A fitted baseline in a file: its numbers, and a readable side file that describes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.baselines.engine import RigidBodyEngine
from flywheel.dynamics.baselines.linear import LinearDynamics
from flywheel.dynamics.weight_files import (
    FORMAT,
    Kinds,
    StoredModel,
    Wanted,
    read_arrays,
    read_side_file,
    reading,
    side_file_of,
)
from flywheel.effects import NAMED, Effect
from flywheel.errors import WeightsError
from flywheel.quantities import CONTROL_STEP
from flywheel.registry import lookup
from flywheel.robots import Robot

FitModel = LinearDynamics | RigidBodyEngine
FITTED: dict[str, Any] = {kind.kind: kind for kind in (LinearDynamics, RigidBodyEngine)}
_ABOUT: Kinds = {"kind": str, "dt": (int, float), "config": dict}


@dataclass(frozen=True)
class BaselineWeights(StoredModel):
    """A fitted baseline in its stored form; the arrays are the fitted numbers.

    Attributes:
      kind: name in `FITTED`.
      dt: control step [s].
      config: settings of the kind.
    """

    kind: str
    dt: float
    config: dict[str, Any]

    @classmethod
    def of(cls, model: FitModel) -> Self:
        """The numbers of a model."""
        config = model.config.model_dump(mode="json")
        return cls(model.robot.digest, model.arrays, model.kind, model.dt, config)

    @property
    def head(self) -> dict[str, Any]:
        return {"kind": self.kind, "robot": self.robot, "dt": self.dt, "config": self.config}

    @classmethod
    def read(cls, path: Path | str, robot: Robot) -> Self:
        """Read what `write` wrote.

        Raises:
          ModelError: the file is missing or damaged, or for another robot.
        """
        path = Path(path)
        about = side_file_of(path, robot, FORMAT, _ABOUT)
        model = lookup(FITTED, about["kind"], "baseline")
        dt = CONTROL_STEP.check(about["dt"], f"The control step in {path.name}", WeightsError)
        with reading(path):
            config = model.Config.model_validate(about["config"])
            wanted = {
                name: Wanted(shape, np.dtype(np.float64))
                for name, shape in model.shapes(robot, config).items()
            }
            found = cls(robot.digest, {}, about["kind"], dt, config.model_dump(mode="json"))
            arrays = read_arrays(path, wanted, found.head, about["digest"])
        return replace(found, arrays=arrays)

    def dynamics(
        self,
        robot: Robot,
        threads: int = 1,
        library: Mapping[str, Effect] = NAMED,
        arithmetic: Arithmetic = Arithmetic(),
    ) -> FitModel:
        """The dynamics model, on one thread of the processor, in float64 and without effects in any case."""
        kind = FITTED[self.kind]
        config = kind.Config.model_validate(self.config)
        found: FitModel = kind.of(robot, self.dt, config, self.arrays)
        return found


def is_baseline(path: Path | str) -> bool:
    """True if a file of weights describes a fitted baseline.

    Raises:
      ModelError: it is missing or malformed.
    """
    return read_side_file(path).get("kind") in FITTED
