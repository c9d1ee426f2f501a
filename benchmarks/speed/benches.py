"""The measurements of `python -m benchmarks.speed`.

Compared contenders are timed in turns, within one process. One thread is timed by its own computing
time, so that a busy machine does not matter; several by the clock, for which the machine must be
idle.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from benchmarks.speed.network import (
    CANDIDATES,
    Speed,
    blocked_against_unblocked,
    fused_against_plain,
    lean_against_paper,
    learned_against_plant,
    least_seconds,
    product_fraction,
)
from benchmarks.speed.plant import SIMULATIONS, STEPS, contenders
from benchmarks.speed.store import store_benchmark
from flywheel.control import Mppi, MppiConfig
from flywheel.dynamics.baselines import LinearDynamics
from flywheel.dynamics.baselines.named import BASELINES
from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig
from flywheel.dynamics.plant import Plant, PlantDynamics
from flywheel.dynamics.protocol import Dynamics
from flywheel.records import Past
from flywheel.robots import Robot
from flywheel.tasks import TaskConfig, sample_task

ENGINES = ("mujoco", "torch", "zarr", "numpy")
STEPS_PER_S = "control steps/s"
PLANS = (64, 200)  # K, candidates of one plan
PLAN_SECONDS = 2.0  # H


@dataclass(frozen=True)
class Measurement:
    """One number.

    Attributes:
      of: name of the measurement.
      value: best of all repetitions.
      unit: of the value.
      threads: in use.
      against: the reference of `ratio`, or "".
      ratio: how many times better it is than the reference.
    """

    of: str
    value: float
    unit: str
    threads: int
    against: str = ""
    ratio: float | None = None


Bench = Callable[[Robot, int, float], list[Measurement]]


def machine() -> dict[str, object]:
    """Inputs of the measurements."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        **{name: version(name) for name in ENGINES},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def bench_plant(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """Simulated control steps per second, compared with bare `mujoco.rollout`."""
    taken = least_seconds(contenders(robot, threads), seconds, threads)
    rates = {name: SIMULATIONS * STEPS / each for name, each in taken.items()}
    ratio = rates["plant"] / rates["bare"]
    return [
        Measurement("bare mujoco.rollout", rates["bare"], STEPS_PER_S, threads),
        Measurement("plant", rates["plant"], STEPS_PER_S, threads, "bare mujoco.rollout", ratio),
    ]


def bench_network(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """The whole learned step compared with bare `mujoco.rollout`."""
    bare = contenders(robot, threads)["bare"]
    return measured(
        learned_against_plant(robot, bare, SIMULATIONS * STEPS, seconds, threads), threads
    )


def bench_kernels(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """The network's forward pass in its variants; always on one thread."""
    if threads != 1:
        return []
    lean = NetworkConfig.lean()
    speeds = (
        *lean_against_paper(robot, lean.width, seconds),
        *fused_against_plain(robot, lean, seconds),
        *blocked_against_unblocked(robot, lean, seconds),
        *product_fraction(robot, lean, seconds),
    )
    return measured(speeds, threads)


def measured(speeds: Iterable[Speed], threads: int) -> list[Measurement]:
    """Speeds of the network's own benchmarks as measurements."""
    return [
        Measurement(
            of=speed.of,
            value=speed.rate,
            unit="flop/s" if "flop/s" in speed.of else STEPS_PER_S,
            threads=threads,
            against=speed.against,
            ratio=speed.ratio or None,
        )
        for speed in speeds
    ]


def bench_plan(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """Time of one plan of MPPI, with the lean network and with the plant as its model."""
    torch.manual_seed(0)
    network = ChunkNetwork(robot, NetworkConfig.lean())
    models: dict[str, Dynamics] = {
        "lean": LearnedDynamics(robot, network, threads=threads),
        "plant": PlantDynamics(Plant(robot, threads=threads)),
    }
    calls = {
        f"MPPI plan, {name}, K = {samples}, H = {PLAN_SECONDS:g} s": planning(
            model, samples, PLAN_SECONDS
        )
        for samples in PLANS
        for name, model in models.items()
    }
    taken = least_seconds(calls, seconds, threads)
    return [Measurement(name, 1e3 * each, "ms", threads) for name, each in taken.items()]


def planning(model: Dynamics, samples: int, seconds: float) -> Callable[[], object]:
    """One plan over these seconds, from the keyframe to a goal; always the same one."""
    robot = model.robot
    planner = Mppi(model, MppiConfig(samples=samples, horizon_seconds=seconds))
    past = resting(robot, max(model.history, 1))
    points = past.observations.points[0, -1]
    task = sample_task("reach", robot, points, np.random.default_rng(0), TaskConfig())

    def plan() -> object:
        planner.reset(task, 0)
        return planner.act(past)

    return plan


def resting(robot: Robot, steps: int) -> Past:
    """The past of a robot that held its winches for so many steps from the keyframe on."""
    plant = Plant(robot)
    state = plant.rest()
    controls = np.repeat(robot.holding(plant.winch(state))[:, None], steps, axis=1)
    trajectory = plant.simulate(state, controls)
    assert trajectory.states is not None
    seen = trajectory.observations
    return Past(seen, controls, seen.winch, state=trajectory.states[:, -1])


def bench_baselines(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """Predicted control steps per second of the networks and the baselines, compared with the plant."""
    dt, rng = 0.01, np.random.default_rng(0)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        networks = {
            name: LearnedDynamics(robot, ChunkNetwork(robot, config), threads=threads)
            for name, config in (("lean", NetworkConfig.lean()), ("hybrid", NetworkConfig.hybrid()))
        }
    models: dict[str, Dynamics] = {
        "oracle": PlantDynamics(Plant(robot, dt, threads=threads)),
        **networks,
        "arx": LinearDynamics(robot, dt),
        **{name: make(robot, dt, threads) for name, make in BASELINES.items()},
    }
    past = resting(robot, max(model.history for model in models.values()))
    size = (CANDIDATES, STEPS, len(robot.winches))
    controls = rng.uniform(robot.control_low, robot.control_high, size)
    calls = {name: partial(model.rollout, past, controls) for name, model in models.items()}
    taken = least_seconds(calls, seconds, threads)
    rates = {name: CANDIDATES * STEPS / each for name, each in taken.items()}
    return [
        Measurement(
            f"rollout, {name}", rate, STEPS_PER_S, threads, "oracle", rate / rates["oracle"]
        )
        for name, rate in rates.items()
    ]


def bench_store(robot: Robot, threads: int, seconds: float) -> list[Measurement]:
    """Committed bytes per second, and training windows per second compared with plain memory."""
    with TemporaryDirectory() as folder:
        speed = store_benchmark(robot, Path(folder), repeats=max(1, round(20 * seconds)))
    unit, windows, ram = "windows/s", speed.windows_per_s, speed.ram_windows_per_s
    return [
        Measurement("store, committed", speed.write_mb_per_s, "MB/s", threads),
        Measurement("windows from plain memory", ram, unit, threads),
        Measurement(
            "windows from the cache", windows, unit, threads, "plain memory", windows / ram
        ),
    ]


BENCHES: dict[str, Bench] = {
    "plant": bench_plant,
    "network": bench_network,
    "kernels": bench_kernels,
    "plan": bench_plan,
    "baselines": bench_baselines,
    "store": bench_store,
}
