"""How much of MuJoCo's own speed a plant keeps."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import Rollout as MujocoRollout

from flywheel.dynamics.plant.plant import Plant


@dataclass(frozen=True)
class Throughput:
    """Plant steps (MuJoCo's, not control steps) per second of the clock, best of the repeats.

    Attributes:
      plant: of `Plant.simulate`, with observations [1/s].
      mujoco: of bare `mujoco.rollout` [1/s].
    """

    plant: float
    mujoco: float

    @property
    def ratio(self) -> float:
        """Share of MuJoCo's own speed that the plant keeps."""
        return self.plant / self.mujoco


def plant_throughput(
    plant: Plant,
    simulations: int = 16,
    seconds: float = 4.0,
    repeats: int = 5,
    seed: int = 0,
    clock: Callable[[], float] = time.perf_counter,
) -> Throughput:
    """Time the plant against bare `mujoco.rollout`: same model, controls and threads, interleaved.

    Args:
      plant: with one set of parameters.
      simulations: batch size.
      seconds: simulated per simulation [s].
      repeats: of each side.
      seed: of the random controls, which change every half second.
      clock: what counts as time; `time.process_time` where others use the machine too.
    """
    robot, rng = plant.robot, np.random.default_rng(seed)
    steps = round(seconds / plant.dt)
    hold = round(0.5 / plant.dt)
    knots = rng.uniform(
        robot.control_low, robot.control_high, (simulations, -(-steps // hold), len(robot.winches))
    )
    controls = np.repeat(knots, hold, axis=1)[:, :steps]
    start = plant.rest(simulations)
    packed = plant.packed(start)
    commands = np.repeat(plant.commands(controls), plant.substeps, axis=1)
    threads = plant.threads if plant.threads > 1 else 0
    engine = MujocoRollout(nthread=threads)
    data = [mujoco.MjData(plant.model) for _ in range(max(1, threads))]

    def bare() -> None:
        engine.rollout([plant.model], data, packed, commands)

    best = {"plant": np.inf, "mujoco": np.inf}
    for _ in range(repeats):
        best["plant"] = min(best["plant"], _seconds(lambda: plant.simulate(start, controls), clock))
        best["mujoco"] = min(best["mujoco"], _seconds(bare, clock))
    taken = simulations * steps * plant.substeps
    return Throughput(taken / best["plant"], taken / best["mujoco"])


def _seconds(work: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    work()
    return clock() - start
