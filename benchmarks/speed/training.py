"""Two checkouts in turns: how fast the network trains and plans with each, on one thread.

    python -m benchmarks.speed.training BEFORE AFTER --rounds 3 --precision bfloat16

Prints, for each checkout, windows of 16 prediction chunks that a training step takes per CPU second
(loss and gradient; the default network of prism3), and CPU seconds of a plan of 200 candidates over 2 s
with the network: the best of all rounds. A checkout that knows no other precision computes in float32.
The machine should have nothing else to do.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

CHUNKS, BATCHES = 16, (32, 64, 128)
CANDIDATES, SECONDS = 200, 2.0
CALLS = 5  # of which the fastest counts


def measured_here(precision: str) -> dict[str, float]:
    """Windows per CPU second by batch, and CPU seconds of a plan, with the package that is imported here."""
    import numpy as np
    import torch

    from flywheel.dynamics.gnn import ChunkNetwork, LearnedDynamics, NetworkConfig, Simulator
    from flywheel.dynamics.plant import Plant
    from flywheel.records import Observation, Past
    from flywheel.robots import load_robot

    torch.set_num_threads(1)
    robot, config = load_robot("prism3"), NetworkConfig.lean()
    torch.manual_seed(0)
    known = "precision" in inspect.signature(Simulator).parameters
    how: dict[str, Any] = {"precision": precision} if known else {}
    network, simulator = ChunkNetwork(robot, config), Simulator(robot, config, **how)
    steps, ahead = config.history + CHUNKS * config.chunk, round(SECONDS / config.dt)
    rng = np.random.default_rng(0)
    plant = Plant(robot)
    low, high = robot.control_low, robot.control_high
    controls = rng.uniform(low, high, (max(BATCHES), steps, len(robot.winches)))
    motion = plant.simulate(plant.settle(0.5, max(BATCHES)), controls)
    points, winch = motion.observations.points, motion.observations.winch

    def tensor(array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(array).float()

    past = config.history

    def trained(batch: int) -> Callable[[], object]:
        given = [points[:batch, : past + 1], controls[:batch, :past], winch[:batch, : past + 1]]
        seen, told, wound = (tensor(array) for array in given)
        commands = tensor(controls[:batch, past:])
        truth = simulator.node_positions(tensor(points[:batch, past + 1 :]))
        dataset = torch.zeros(batch, dtype=torch.int64)

        def step() -> object:
            said = simulator.unroll(network, seen, told, wound, commands, dataset)
            loss = (said.node_positions - truth).square().mean() + said.winch.square().mean()
            return torch.autograd.grad(loss, list(network.parameters()), allow_unused=True)

        return step

    found = {}
    for batch in BATCHES:
        found[f"windows/s, {batch} at once"] = batch / fastest(trained(batch))
    model = LearnedDynamics(robot, network, **how)
    seen = Observation(points[:1, : past + 1], winch[:1, : past + 1])
    start = Past(seen, controls[:1, :past], winch[:1, : past + 1])
    candidates = rng.uniform(low, high, (CANDIDATES, ahead, len(robot.winches)))
    found["plan [CPU s]"] = fastest(lambda: model.rollout(start, candidates))
    return found


def fastest(call: Callable[[], object]) -> float:
    """Least CPU seconds of a call."""
    call()
    taken = []
    for _ in range(CALLS):
        begun = time.process_time()
        call()
        taken.append(time.process_time() - begun)
    return min(taken)


def of_checkout(root: Path, folder: Path, precision: str) -> dict[str, float]:
    """One round of one checkout."""
    place = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(root)}
    words = [sys.executable, str(Path(__file__).resolve()), "here", precision]
    done = subprocess.run(words, env=place, cwd=folder, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """See the top."""
    if sys.argv[1:2] == ["here"]:
        print(json.dumps(measured_here(sys.argv[2])))
        return
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    options.add_argument("before", type=Path)
    options.add_argument("after", type=Path)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--precision", choices=("float32", "bfloat16"), default="float32")
    given = options.parse_args()
    rounds: list[list[dict[str, float]]] = []
    with TemporaryDirectory() as folder:
        for _ in range(given.rounds):
            both = (given.before.resolve(), given.after.resolve())
            rounds.append([of_checkout(root, Path(folder), given.precision) for root in both])
    for name in rounds[0][0]:
        best = max if name.startswith("windows") else min
        before, after = (best(each[i][name] for each in rounds) for i in (0, 1))
        ratio = after / before if name.startswith("windows") else before / after
        print(f"{name}: before {before:.3g}, after {after:.3g}, {ratio:.2f} times as fast")


if __name__ == "__main__":
    main()
