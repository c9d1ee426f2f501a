"""A made-up log of a real robot, to be broken in every way."""

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from flywheel.robots import Robot, load_robot
from flywheel.truth_simulator.measurement import Measurement
from flywheel.truth_simulator.recording import HiddenRecording, record
from tests import draws

SEED = draws.seed()  # fresh; shown when a test fails


@dataclass
class Sheet:
    """A CSV that can be edited.

    Attributes:
      header: names of the columns.
      rows: cells, as text.
      robot: that it is about.
      made: what it was written from.
    """

    header: list[str]
    rows: list[list[str]]
    robot: Robot
    made: HiddenRecording
    folder: Path
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(SEED))

    def column(self, name: str) -> np.ndarray:
        index = self.header.index(name)
        return np.array([float(row[index] or "nan") for row in self.rows])

    def put(self, name: str, values: np.ndarray) -> None:
        index = self.header.index(name)
        for row, value in zip(self.rows, values, strict=True):
            row[index] = "" if np.isnan(value) else repr(float(value))

    def positions(self, marker: str) -> np.ndarray:
        """(N, 3) of a marker."""
        return np.stack([self.column(f"{marker}.{axis}") for axis in "xyz"], axis=1)

    def move(self, marker: str, to: np.ndarray) -> None:
        """Put a marker at positions (N, 3)."""
        for axis, values in zip("xyz", to.T, strict=True):
            self.put(f"{marker}.{axis}", values)

    def cells(self, prefix: str) -> list[str]:
        """Columns whose names begin so."""
        return [name for name in self.header if name.startswith(prefix)]

    def scale(self, prefix: str, factor: float) -> None:
        for name in self.cells(prefix):
            self.put(name, factor * self.column(name))

    def save(self, name: str = "log.csv") -> Path:
        path = self.folder / name
        with path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([self.header, *self.rows])
        return path


@pytest.fixture(scope="session")
def robots() -> dict[str, Robot]:
    return {name: load_robot(name) for name in ("prism3", "platform4")}


@pytest.fixture(scope="session")
def recorded(robots: dict[str, Robot]) -> dict[str, HiddenRecording]:
    settings = Measurement(winch_noise=0.001)
    return {
        name: record(robot, seconds=2.0, seed=SEED, measurement=settings)
        for name, robot in robots.items()
    }


@pytest.fixture
def sheet(
    robots: dict[str, Robot], recorded: dict[str, HiddenRecording], tmp_path: Path
) -> Callable[..., Sheet]:
    def of(name: str = "prism3") -> Sheet:
        made, robot = recorded[name], robots[name]
        log, _ = made.write(tmp_path / "whole", name, robot)
        with log.open() as file:
            header, *rows = list(csv.reader(file))
        return Sheet(header, rows, robot, made, tmp_path)

    return of
