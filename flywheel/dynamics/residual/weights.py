"""A corrected plant in a file: the network's weights, and their plant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import torch
from pydantic import Field

from flywheel.dynamics.arithmetic import Arithmetic
from flywheel.dynamics.plant import Plant, RestartedPlant, with_effects
from flywheel.dynamics.residual.config import ResidualConfig
from flywheel.dynamics.residual.model import ResidualDynamics
from flywheel.dynamics.residual.network import ResidualNetwork
from flywheel.dynamics.weight_files import (
    FORMAT,
    Kinds,
    StoredModel,
    Wanted,
    arrays_of,
    read_arrays,
    read_side_file,
    reading,
    side_file_of,
)
from flywheel.effects import NAMED, Effect, Terms, WrittenTerm
from flywheel.effects.adopted import MOST_EFFECTS
from flywheel.errors import FlywheelError, WeightsError
from flywheel.quantities import Bounds, ControlStep, Seed
from flywheel.robots import Robot
from flywheel.validation import Frozen

KIND = "residual"
_ABOUT: Kinds = {"corrected": dict, "config": dict, "share": (int, float)}


class CorrectedPlant(Frozen):
    """The corrected plant, without its MJCF.

    Attributes:
      dt: control step.
      window, degree, roll, seed: of its start, see `RestartedPlant`.
      effects: all effects beyond its MJCF.
    """

    dt: ControlStep
    window: Annotated[int, Bounds(1, 100_000, "steps")]
    degree: Literal[1, 2]
    roll: Literal["random", "keyframe", "relaxed"]
    seed: Seed = 0
    effects: tuple[WrittenTerm, ...] = Field((), max_length=MOST_EFFECTS)

    @classmethod
    def of(cls, plant: RestartedPlant) -> Self:
        """Record of a plant for the file."""
        names = ("dt", "window", "degree", "roll", "seed")
        return cls(
            **{name: getattr(plant, name) for name in names},
            effects=tuple(WrittenTerm.of(term, plant.robot) for term in plant.plant.terms),
        )

    def terms(self, robot: Robot, library: Mapping[str, Effect] = NAMED) -> Terms:
        """The effects of a library, with their values; raises what `WrittenTerm.term` does."""
        return tuple(effect.term(robot, library) for effect in self.effects)

    def plant(
        self, robot: Robot, threads: int = 1, library: Mapping[str, Effect] = NAMED
    ) -> RestartedPlant:
        """The plant, on level ground and without obstacles."""
        plant = with_effects(Plant(robot, self.dt, threads=threads), self.terms(robot, library))
        return RestartedPlant(plant, self.window, self.degree, self.roll, self.seed)


@dataclass(frozen=True)
class ResidualWeights(StoredModel):
    """A corrected plant in its stored form; the arrays are the network's.

    Attributes:
      corrected: the plant.
      config: shape of the network.
      share: applied fraction of the correction.
    """

    corrected: CorrectedPlant
    config: ResidualConfig
    share: float

    @classmethod
    def of(cls, model: ResidualDynamics) -> Self:
        """The weights of a model."""
        return cls(
            model.robot.digest,
            arrays_of(model.network),
            CorrectedPlant.of(model.plant),
            model.network.config,
            model.share,
        )

    @property
    def head(self) -> dict[str, Any]:
        return {
            "kind": KIND,
            "robot": self.robot,
            "corrected": self.corrected.model_dump(mode="json"),
            "config": self.config.model_dump(mode="json"),
            "share": self.share,
        }

    @classmethod
    def read(
        cls,
        path: Path | str,
        robot: Robot,
        plant: Plant | None = None,
        library: Mapping[str, Effect] = NAMED,
    ) -> Self:
        """Read what `write` wrote.

        Args:
          path: of the file.
          robot: to be predicted.
          plant: must be the corrected one; None for any.
          library: of its effects.

        Raises:
          WeightsError: the file is missing or damaged, or for another robot or plant.
        """
        path = Path(path)
        about = side_file_of(path, robot, FORMAT, _ABOUT)
        with reading(path):
            found = cls(
                robot.digest,
                {},
                CorrectedPlant.model_validate(about["corrected"]),
                ResidualConfig.model_validate(about["config"]),
                Bounds(0, 1).check(about["share"], f"The share in {path.name}", WeightsError),
            )
            wanted = {
                name: Wanted(tuple(value.shape), np.dtype(np.float32))
                for name, value in _network(robot, found.config).state_dict().items()
            }
            arrays = read_arrays(path, wanted, found.head, about["digest"])
        found = replace(found, arrays=arrays)
        found._check(path, robot, plant, library)
        return found

    def _check(
        self, path: Path, robot: Robot, plant: Plant | None, library: Mapping[str, Effect]
    ) -> None:
        """Check that a plant is the corrected one; raises a `WeightsError`."""
        try:
            self.corrected.terms(robot, library)
        except FlywheelError as error:
            raise WeightsError(
                f"{path.name} corrects a plant that cannot be made: {error}"
            ) from None
        if plant is None:
            return
        there = tuple(WrittenTerm.of(term, robot) for term in plant.terms)
        if there != self.corrected.effects:
            raise WeightsError(
                f"{path.name} corrects the plant with {_named(self.corrected.effects)}; this one "
                f"has {_named(there)}. Train it again for this plant."
            )
        if abs(plant.dt - self.corrected.dt) > 1e-9:
            raise WeightsError(
                f"{path.name} corrects a plant in steps of {self.corrected.dt:g} s; this one has "
                f"{plant.dt:g} s."
            )

    def dynamics(
        self,
        robot: Robot,
        threads: int = 1,
        library: Mapping[str, Effect] = NAMED,
        arithmetic: Arithmetic = Arithmetic(),
    ) -> ResidualDynamics:
        """The dynamics model, in its own arithmetic in any case: its plant is simulated on the processor."""
        network = _network(robot, self.config)
        state = {name: torch.from_numpy(np.array(value)) for name, value in self.arrays.items()}
        network.load_state_dict(state)
        return ResidualDynamics(
            self.corrected.plant(robot, threads, library), network, self.share, threads
        )


def is_residual(path: Path | str) -> bool:
    """True if a file of weights describes a corrected plant.

    Raises:
      WeightsError: it is missing or malformed.
    """
    return bool(read_side_file(path).get("kind") == KIND)


def _network(robot: Robot, config: ResidualConfig) -> ResidualNetwork:
    with torch.random.fork_rng(devices=[]):  # the weights are replaced: draw no random number
        return ResidualNetwork(robot, config)


def _named(effects: tuple[WrittenTerm, ...]) -> str:
    """The effects of a plant, in words."""
    names = []
    for effect in effects:
        values = ", ".join(f"{name} {value:.4g}" for name, value in effect.parameters.items())
        names.append(f"{effect.label} ({values})")
    return ", ".join(names) or "no effects"
