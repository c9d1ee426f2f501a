"""Speed of the network relative to alternatives: for `python -m benchmarks.speed`.

Every function times its contenders in turns within one process and keeps the least time of each, so
only ratios between them are meaningful; one thread is timed by its CPU time, several by wall-clock
time. Speeds do not depend on the weights, which are random here, and are robot-steps per second:
one predicted control step of one candidate.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from flywheel.dynamics.arithmetic import Device
from flywheel.dynamics.gnn.config import NetworkConfig
from flywheel.dynamics.gnn.fused import FusedForward
from flywheel.dynamics.gnn.learned import BLOCK, LearnedDynamics
from flywheel.dynamics.gnn.network import ChunkNetwork
from flywheel.dynamics.gnn.prediction import ForwardFactory
from flywheel.dynamics.gnn.simulator import Simulator
from flywheel.dynamics.threads import one_thread_per_operation
from flywheel.records import Observation, Past
from flywheel.robots import Robot

STEPS = 48  # control steps predicted per call: whole prediction chunks of 1, 2, 3, 4, 6, 8, 12, 16
CANDIDATES = 64
_LEAST_ROUNDS = 5
_PRODUCT = (768, 128, 128)  # sizes of the matrix product that stands for the machine's peak


@dataclass(frozen=True)
class Speed:
    """One measured speed.

    Attributes:
      of: name of the contender.
      rate: robot-steps per second, or floating-point operations per second where stated.
      against: the reference of `ratio`, or "".
      ratio: how many times faster it is than the reference; 0 without one.
    """

    of: str
    rate: float
    against: str = ""
    ratio: float = 0.0


def least_seconds(
    contenders: Mapping[str, Callable[[], object]], seconds: float, threads: int = 1
) -> dict[str, float]:
    """Least time of one call of each [s], called in turns after one call to warm up.

    Args:
      contenders: functions to time, by name.
      seconds: minimum time for each; at least five calls are made.
      threads: used by a call.
    """
    clock = time.process_time if threads == 1 else time.perf_counter
    for call in contenders.values():
        call()
    least = dict.fromkeys(contenders, float("inf"))
    until, rounds = time.perf_counter() + seconds * len(contenders), 0
    while time.perf_counter() < until or rounds < _LEAST_ROUNDS:
        for name, call in contenders.items():
            begun = clock()
            call()
            least[name] = min(least[name], clock() - begun)
        rounds += 1
    return least


def rollout_call(
    robot: Robot,
    config: NetworkConfig,
    candidates: int = CANDIDATES,
    threads: int = 1,
    block: int = BLOCK,
    device: Device = "cpu",
) -> Callable[[], object]:
    """A call of a whole rollout of `STEPS` steps from one past, as in a planner."""
    torch.manual_seed(0)
    network = ChunkNetwork(robot, config)
    model = LearnedDynamics(robot, network, threads, block, device=device)
    rng = np.random.default_rng(0)
    points = rng.normal(0.0, 0.5, (1, 1, len(robot.points), 3)) * robot.length
    points = np.repeat(points, config.history + 1, axis=1)
    winch = np.repeat(0.5 * (robot.rest_low + robot.rest_high)[None, None], points.shape[1], axis=1)
    past = Past(Observation(points, winch), robot.holding(winch)[:, 1:], winch)
    size = (candidates, STEPS, len(robot.winches))
    controls = rng.uniform(robot.control_low, robot.control_high, size)
    return lambda: model.rollout(past, controls)


def learned_against_plant(
    robot: Robot,
    plant: Callable[[], object],
    plant_steps: int,
    seconds: float,
    threads: int = 1,
    configs: Mapping[str, NetworkConfig] | None = None,
) -> tuple[Speed, ...]:
    """The whole learned step compared with the plant.

    Args:
      robot: the robot.
      plant: simulates this many robot-steps on as many threads, e.g. with bare `mujoco.rollout`.
      plant_steps: robot-steps (control steps) of one such call, over all its simulations.
      seconds: to spend on each contender.
      threads: of each.
      configs: networks by name; by default `lean`.
    """
    configs = configs or {"lean": NetworkConfig.lean()}
    candidates = CANDIDATES * threads
    calls: dict[str, Callable[[], object]] = {"plant": plant}
    for name, config in configs.items():
        calls[f"{name}, float32"] = rollout_call(robot, config, candidates, threads)
    least = least_seconds(calls, seconds, threads)
    base = plant_steps / least.pop("plant")
    rates = {name: candidates * STEPS / each for name, each in least.items()}
    learned = (Speed(f"learned step, {n}", r, "plant", r / base) for n, r in rates.items())
    return (Speed("plant", base), *learned)


def lean_against_paper(robot: Robot, width: int, seconds: float) -> tuple[Speed, ...]:
    """`lean` compared with `paper` at the same width and number of rounds."""
    paper = NetworkConfig.paper(width=width)
    lean = NetworkConfig.lean(width=width, rounds=paper.rounds)
    calls = {"paper": rollout_call(robot, paper), "lean": rollout_call(robot, lean)}
    rates = _rates(least_seconds(calls, seconds), CANDIDATES * STEPS)
    return (
        Speed(f"paper, width {width}", rates["paper"]),
        Speed(f"lean, width {width}", rates["lean"], "paper", rates["lean"] / rates["paper"]),
    )


def fused_against_plain(robot: Robot, config: NetworkConfig, seconds: float) -> tuple[Speed, ...]:
    """The fused forward pass compared with plain PyG: one call of the network alone, at equal weights."""
    from benchmarks.speed.reference import PlainForward  # PyG takes seconds to import

    calls = {
        "plain PyG": _forward_call(robot, config, PlainForward),
        "fused, float32": _forward_call(robot, config, FusedForward),
    }
    with one_thread_per_operation(), torch.inference_mode():
        rates = _rates(least_seconds(calls, seconds), CANDIDATES * config.chunk)
    plain = rates.pop("plain PyG")
    fused = (Speed(n, r, "plain PyG", r / plain) for n, r in rates.items())
    return (Speed("plain PyG", plain), *fused)


def blocked_against_unblocked(
    robot: Robot, config: NetworkConfig, seconds: float, candidates: int = 1024
) -> tuple[Speed, ...]:
    """Many candidates in blocks compared with all at once."""
    blocked = f"blocks of {BLOCK}"
    calls = {
        "unblocked": rollout_call(robot, config, candidates, block=candidates),
        blocked: rollout_call(robot, config, candidates),
    }
    rates = _rates(least_seconds(calls, seconds), candidates * STEPS)
    return (
        Speed(f"unblocked, K = {candidates}", rates["unblocked"]),
        Speed(
            f"{blocked}, K = {candidates}",
            rates[blocked],
            "unblocked",
            rates[blocked] / rates["unblocked"],
        ),
    )


def product_fraction(robot: Robot, config: NetworkConfig, seconds: float) -> tuple[Speed, ...]:
    """Floating-point operations per second of the fused network compared with those of `torch.mm`."""
    rows, inner, columns = _PRODUCT
    left, right = torch.randn(rows, inner), torch.randn(inner, columns)
    network = _forward_call(robot, config, FusedForward)
    with one_thread_per_operation(), torch.inference_mode():
        with FlopCounterMode(display=False) as counter:
            network()
        calls = {"network": network, "torch.mm": lambda: torch.mm(left, right)}
        least = least_seconds(calls, seconds)
    peak = 2.0 * rows * inner * columns / least["torch.mm"]
    rate = counter.get_total_flops() / least["network"]
    return (
        Speed("torch.mm [flop/s]", peak),
        Speed("fused network [flop/s]", rate, "torch.mm", rate / peak),
    )


def _forward_call(
    robot: Robot, config: NetworkConfig, prepare: ForwardFactory
) -> Callable[[], object]:
    """One call of the network, with given features and LSTM state."""
    torch.manual_seed(0)
    network = ChunkNetwork(robot, config).requires_grad_(False)
    simulator = Simulator(robot, config, prepare=prepare)
    parts = simulator.parts()
    points = robot.length * torch.randn(CANDIDATES, 1, len(robot.points), 3)
    shape = (CANDIDATES, config.history, len(robot.winches))
    start = simulator.start(
        points.expand(-1, config.history + 1, -1, -1),
        torch.zeros(shape),
        torch.ones(CANDIDATES, config.history + 1, len(robot.winches)),
    )
    state, heading = start.states[-1], parts.builder.heading(start.states[-1])
    controls = torch.rand(len(robot.winches), CANDIDATES, config.control_history + config.chunk)
    features = parts.builder(state, start.origin, heading, controls, torch.zeros(1).long())
    forward = simulator.prepare(network)
    memory = forward.warm_up(features.nodes["body_node"], features.dataset, None)
    return lambda: forward(features, memory)


def _rates(least: Mapping[str, float], steps: int) -> dict[str, float]:
    return {name: steps / seconds for name, seconds in least.items()}
