"""A GPU beside one core, and beside MuJoCo on all cores: training, predictions, plans.

    python -m benchmarks.speed.gpu --minutes 12

prism3. Prints each row as soon as it is measured, then trains a network of the paper's size for the rest of
the minutes, and ends with all rows as one line of JSON. Times are by the clock: nothing else should run.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, cast

import numpy as np
import torch

from benchmarks.speed.benches import machine, planning
from benchmarks.speed.episodes import Episodes
from benchmarks.speed.network import STEPS as AHEAD
from benchmarks.speed.network import rollout_call
from benchmarks.speed.plant import SIMULATIONS, STEPS, contenders
from flywheel.cli.app import App
from flywheel.cli.exits import CODES, OneCommand
from flywheel.data import WindowCache
from flywheel.dynamics.arithmetic import Device
from flywheel.dynamics.gnn import (
    ChunkNetwork,
    LearnedDynamics,
    NetworkConfig,
    Simulator,
    check_device,
    fit_normalisation,
)
from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.quantities import Bounds
from flywheel.robots import load_robot
from flywheel.training import Schedule, Stage, TrainingConfig
from flywheel.training.objective import Objective
from flywheel.training.optimiser import NetworkOptimiser
from flywheel.training.schedules import learning_rate

ROBOT, CORES = load_robot("prism3"), len(os.sched_getaffinity(0))
ENDS = 5  # steps whose mean loss stands for the beginning of a training, and for its end
MINUTE = 60.0
ALL = "MuJoCo on all cores"


class Sizes(NamedTuple):
    """Sizes of the measurements: networks, and one to train; windows; K; H [s]; least times [s]."""

    networks: tuple[NetworkConfig, ...] = (NetworkConfig.lean(), NetworkConfig.paper(width=128))
    trained: NetworkConfig = NetworkConfig.paper()
    windows: tuple[int, ...] = (64, 256)
    windows_on_a_core: int = 16  # its steps are counted as if they had as many as the GPU's
    chunks: int = 16
    candidates: tuple[int, ...] = (200, 1024, 4096)
    plan_seconds: float = 2.0
    episodes: int = 128
    seconds: float = 3.0


TINY = NetworkConfig.lean(width=8), NetworkConfig.paper(width=4)
DRY = Sizes(TINY, TINY[1], (2,), 2, 1, (4,), 0.5, 2, 0.0)


def rate(make: Callable[[], Callable[[], object]], of_call: float, seconds: float) -> float:
    """Units per second at the fastest of several calls, after one to warm up."""
    call, least = make(), math.inf
    call()
    until = time.perf_counter() + seconds
    while least == math.inf or time.perf_counter() < until:
        begun = time.perf_counter()
        call()
        least = min(least, time.perf_counter() - begun)
    return of_call / least


class Measuring:
    """Measures a device, and prints the rows as they come."""

    def __init__(self, sizes: Sizes, device: Device) -> None:
        self._begun, self._sizes, self._device = time.perf_counter(), sizes, device
        self.rows: list[dict[str, Any]] = []
        self._cache = Episodes(ROBOT, sizes.episodes, CORES)

    def _add(self, of: str, unit: str, values: dict[str, float]) -> None:
        elapsed = round(time.perf_counter() - self._begun, 1)
        self.rows.append({"elapsed": elapsed, "of": of, "unit": unit, **values})
        shown = ", ".join(f"{name} {value:.4g}" for name, value in values.items())
        print(f"{elapsed:6.1f} s  {of} [{unit}]: {shown}", flush=True)

    def _training(self, shape: NetworkConfig, n: int, device: Device) -> Callable[[], float]:
        """A step on n windows, which ends when the device is done, and gives its loss."""
        stages = (Stage(chunks=self._sizes.chunks, share=1),)
        schedule = Schedule(steps=10**6, stages=stages, learning_rate=1e-3, warmup_steps=100)
        batch = n * self._sizes.chunks
        config = TrainingConfig(chunks_per_batch=batch, least_windows=1, device=device)
        simulator = Simulator(ROBOT, shape, precision=config.precision)
        objective = Objective(config, schedule, simulator, cast(WindowCache, self._cache))
        torch.manual_seed(0)
        network = ChunkNetwork(ROBOT, shape)
        fit_normalisation(simulator, network, [objective.measured()])
        network.to(device)
        optimiser, numbers = NetworkOptimiser(network, config), iter(range(schedule.steps))

        def step() -> float:
            number = next(numbers)
            loss = objective.backward(network, number).total
            torch.nn.utils.clip_grad_norm_(network.parameters(), config.clip)
            optimiser.step(learning_rate(schedule, number))
            if device == "cuda":
                torch.cuda.synchronize()
            return loss.item()

        return step

    def training(self) -> None:
        """Rows of training steps per second."""
        few, wait = self._sizes.windows_on_a_core, self._sizes.seconds
        for shape in self._sizes.networks:
            core = rate(partial(self._training, shape, few, "cpu"), few, wait)
            for n in self._sizes.windows:
                there = rate(partial(self._training, shape, n, self._device), 1, wait)
                values = {self._device: there, "one core": core / n}
                what = f"{n} windows of {self._sizes.chunks} chunks"
                self._add(f"training, {named(shape)}, {what}", "steps/s", values)

    def planning(self) -> None:
        """Rows of predicted steps and plans per second; on one core, slow networks only with few."""
        horizon, wait = self._sizes.plan_seconds, self._sizes.seconds
        bare = rate(lambda: contenders(ROBOT, CORES)["bare"], SIMULATIONS * STEPS, wait)
        plant = PlantDynamics(Plant(ROBOT, threads=CORES))
        for k in self._sizes.candidates:
            whole = rate(partial(planning, plant, k, horizon), 1, wait)
            for shape in self._sizes.networks:
                steps, plans = dict[str, float](), dict[str, float]()
                places: dict[str, Device] = {self._device: self._device}
                if shape == self._sizes.networks[0] or k == self._sizes.candidates[0]:
                    places["one core"] = "cpu"
                for name, place in places.items():
                    call = partial(rollout_call, ROBOT, shape, k, device=place)
                    steps[name] = rate(call, k * AHEAD, wait)
                    model = LearnedDynamics(ROBOT, ChunkNetwork(ROBOT, shape), device=place)
                    plans[name] = rate(partial(planning, model, k, horizon), 1, wait)
                what = f"{named(shape)}, K = {k}"
                self._add(f"learned steps, {what}", "1/s", {**steps, ALL: bare})
                self._add(f"plans of {horizon:g} s, {what}", "1/s", {**plans, ALL: whole})

    def train(self, seconds: float) -> None:
        """Train until so long after the beginning; a row each minute, and one at the end."""
        losses, shape, shown = list[float](), self._sizes.trained, time.perf_counter()
        step = self._training(shape, self._sizes.windows[0], self._device)
        while time.perf_counter() < self._begun + seconds or len(losses) < 2 * ENDS:
            losses.append(step())
            if time.perf_counter() > shown + MINUTE:
                shown += MINUTE
                self._add(f"loss, {named(shape)}", "1", {"steps": len(losses), "now": losses[-1]})
        first, last = float(np.mean(losses[:ENDS])), float(np.mean(losses[-ENDS:]))
        ends = {"steps": len(losses), "start": first, "end": last}
        self._add(f"loss, {named(shape)}", "1", ends)


def named(shape: NetworkConfig) -> str:
    """The network in the rows."""
    return f"{'paper' if shape.edge_updates else 'lean'} of width {shape.width}"


app = App(add_completion=False, pretty_exceptions_enable=False)


@app.command(cls=OneCommand, epilog=CODES)
def gpu(
    *,
    device: Literal["cuda", "cpu"] = "cuda",
    minutes: Annotated[float, Bounds(0, 1000)] = 12.0,
    dry: bool = False,
) -> None:
    """Measure a GPU: training, predictions and plans, beside one core and MuJoCo on all.

    Args:
      device: To be measured.
      minutes: In all.
      dry: Tiny sizes on the processor: a test.
    """
    place: Device = "cpu" if dry else device
    check_device(place, "--device")
    torch.set_num_threads(1)
    measuring = Measuring(DRY if dry else Sizes(), place)
    measuring.training()
    measuring.planning()
    measuring.train(0.0 if dry else minutes * MINUTE)
    there = torch.cuda.get_device_name() if place == "cuda" else place
    print(json.dumps({"device": there, "machine": machine(), "rows": measuring.rows}))


if __name__ == "__main__":
    app(prog_name="python -m benchmarks.speed.gpu")
