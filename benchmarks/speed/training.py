"""Two checkouts in turns: how fast the network trains and plans with each, and trains on two cores.

    python -m benchmarks.speed.training BEFORE AFTER --rounds 3 --precision bfloat16

Prints, for each checkout, windows of 16 prediction chunks that a training step takes per CPU second
(loss and gradient; the default network of prism3), and CPU seconds of a plan of 200 candidates over 2 s
with the network: the best of all rounds. A checkout that knows no other precision computes in float32.
Then windows per second of wall time that whole trainings take, with one process and with two.
The machine should have nothing else to do.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import itertools
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

CHUNKS, BATCHES, TRAINED = 16, (32, 64, 128), (64, 128)
CANDIDATES, SECONDS = 200, 2.0
CALLS = 5  # of which the fastest counts
STARTING, STEPS = 10.0, 20  # seconds before a training's steps count, and how many of them do


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
    return found | trained_here(robot, config, points, controls, winch, how)


def trained_here(
    robot: Any, network: Any, points: Any, controls: Any, winch: Any, how: dict[str, Any]
) -> dict[str, float]:
    """Windows per second of wall time by batch and processes; none of a checkout that knows no processes.

    Args:
      robot, network: of the trainings.
      points, controls, winch: of motions of one window each.
      how: its precision.
    """
    import numpy as np

    from flywheel.data import WindowCache
    from flywheel.training import Schedule, Stage, Trainer, TrainingConfig

    if "processes" not in TrainingConfig.model_fields:
        return {}
    count, steps = controls.shape[:2]
    controls = np.concatenate([controls, controls[:, :1]], axis=1)
    seen, told, wound = (
        each.reshape(-1, *each.shape[2:]).astype(np.float32) for each in (points, controls, winch)
    )
    whole, flat = np.ones(seen.shape[:2], bool), (None,) * count
    lengths, dataset = np.full(count, steps), np.zeros(count, int)
    rows = (seen, seen, wound, wound, told, whole, lengths, dataset, flat, ("nominal",))
    train, held_out = (WindowCache(*rows, split, "0" * 64) for split in ("train", "validation"))
    schedule = Schedule(
        steps=10_000,
        stages=(Stage(chunks=CHUNKS, share=1.0),),
        learning_rate=1e-3,
        warmup_steps=100,
    )
    found = {}
    for windows in (*TRAINED, 2 * TRAINED[-1]):
        for processes in (1, 2) if windows in TRAINED else (2,):
            config = TrainingConfig(
                initial=schedule,
                least_windows=windows,
                report_every=1,
                validation_seconds=0.1,
                processes=processes,
                **how,
            )
            with TemporaryDirectory() as folder:
                trainer = Trainer(config, network, robot, train, held_out, Path(folder))
                found[wall(windows, processes)] = windows / least_step(trainer)
    return found


def wall(windows: int, processes: int) -> str:
    """Name of a training's measurement."""
    return f"windows/s of wall time, {windows} a step, {processes} process{'es' * (processes > 1)}"


def least_step(trainer: Any) -> float:
    """Least seconds of a training's steps, once its processes have started."""
    begun = time.perf_counter()
    ends: list[float] = []

    def note(progress: object) -> None:
        if time.perf_counter() - begun > STARTING:
            ends.append(time.perf_counter())
        if len(ends) > STEPS:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt):
        trainer.run(note)
    return min(after - before for before, after in itertools.pairwise(ends))


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
        if name in rounds[0][1]:
            best = max if name.startswith("windows") else min
            before, after = (best(each[i][name] for each in rounds) for i in (0, 1))
            ratio = after / before if name.startswith("windows") else before / after
            print(f"{name}: before {before:.3g}, after {after:.3g}, {ratio:.2f} times as fast")
    for windows in TRAINED if wall(TRAINED[0], 1) in rounds[0][1] else ():
        one, shared, each = (
            max(found[1].get(name, 0.0) for found in rounds)
            for name in (wall(windows, 1), wall(windows, 2), wall(2 * windows, 2))
        )
        print(
            f"{windows} windows a step, after: {one:.0f}/s of wall time with one process, "
            f"{shared:.0f}/s with two ({shared / one:.2f} times), {each:.0f}/s with "
            f"{windows} for each of two ({each / one:.2f} times)"
        )


if __name__ == "__main__":
    main()
