"""Checkouts in turns: the network's error after equal CPU time, each with its own defaults.

    python -m benchmarks.recipes BEFORE AFTER --minutes 8 --seeds 0 1 2
    python -m benchmarks.recipes CHECKOUT --minutes 2 4 8
    python -m benchmarks.recipes CHECKOUT --training '{"matrix_rate": 0}' --network '{"width": 96}'

Trains prism3's default network from random weights on random motion without noise, half a minute an episode,
on one thread, and prints the errors over 2 s on episodes that no training has seen. A short training says how
many steps take the given minutes of one core; the CPU seconds that they took are printed. All have the same
episodes.
"""

from __future__ import annotations

import argparse
import inspect
import itertools
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flywheel.data import WindowCache
    from flywheel.records import Episode, Split

EPISODES: dict[Split, tuple[int, int]] = {  # how many, and their first seed
    "train": (72, 1),
    "validation": (8, 5001),
    "test": (10, 9001),
}
SECONDS, HORIZON, STARTS = 30.0, 2.0, 20
Settings = dict[str, Any]
PILOT = 60  # steps of the training that measures how long one takes


def recorded(split: Split, count: int) -> list[Episode]:
    """Episodes with random controls of prism3's plant."""
    from flywheel.robots import load_robot
    from flywheel.runtime.config.run_config import RunConfig
    from flywheel.runtime.workers.episode_plan import EpisodePlan
    from flywheel.runtime.workers.episode_recorder import EpisodeRecorder

    recorder = EpisodeRecorder(RunConfig(), load_robot("prism3"))
    told = "heartbeat" in inspect.signature(recorder.record).parameters  # of an older checkout
    more: dict[str, Any] = (
        {"heartbeat": SimpleNamespace(progress=lambda done: None)} if told else {}
    )
    _, first = EPISODES[split]
    plans = (
        EpisodePlan(
            id=f"random-{seed}",
            controller="random",
            iteration=0,
            split=split,
            dataset=0,
            seconds=SECONDS,
            seed=seed,
        )
        for seed in range(first, first + count)
    )
    return [recorder.record(plan, None, "", **more) for plan in plans]


def windows(split: Split, count: int) -> WindowCache:
    """Episodes as a training reads them; their store is in the working folder."""
    from flywheel.data import SplitSource, TrajectoryStore, WindowCache
    from flywheel.robots import load_robot

    store, episodes = TrajectoryStore(f"store-{split}"), recorded(split, count)
    store.commit(split, episodes)
    source = SplitSource(store, store.seal(split, [split]), split, load_robot("prism3"))
    return WindowCache.build(source, Path("cache"))


def trained_here(
    minutes: float, seed: int, training: Settings, network: Settings, episodes: int
) -> dict[str, float]:
    """Errors of a trained network, and what it took, with the package that is imported here."""
    from flywheel.dynamics.gnn import LearnedDynamics, NetworkConfig, load_weights
    from flywheel.evaluation import score
    from flywheel.robots import load_robot
    from flywheel.training import Trainer, TrainingConfig

    robot, defaults = load_robot("prism3"), TrainingConfig(**training, seed=seed)
    train = windows("train", episodes)
    validation = windows("validation", EPISODES["validation"][0])
    shape = NetworkConfig.lean(**network)

    def trained(steps: int) -> tuple[Path, float]:
        schedule = defaults.initial.model_copy(update={"steps": steps})
        config = defaults.model_copy(update={"initial": schedule})
        begun, folder = time.process_time(), Path(str(steps))
        trainer = Trainer(config, shape, robot, train, validation, folder)
        weights = trainer.run().weights
        return weights, time.process_time() - begun

    trained(len(defaults.initial.stages))  # compiles the kernels
    _, taken = trained(PILOT)
    steps = round(60.0 * minutes / taken * PILOT)
    weights, taken = trained(steps)
    model = LearnedDynamics(robot, load_weights(weights, robot))
    test = recorded("test", EPISODES["test"][0])
    errors = score(model, test, horizon_seconds=HORIZON, starts_per_episode=STARTS, seed=0)
    return {
        "RMSE/L [%]": errors.e_pos_rmse,
        "MSE/L [%]": errors.e_pos_mse,
        "turn [deg]": errors.e_rot,
        "steps": steps,
        "CPU [s]": taken,
    }


def of_checkout(root: Path, *asked: Any) -> dict[str, float]:
    """One training with a checkout; arguments as of `trained_here`."""
    place = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(root.resolve())}
    words = [sys.executable, str(Path(__file__).resolve()), "here", json.dumps(asked)]
    with TemporaryDirectory() as folder:
        done = subprocess.run(words, env=place, cwd=folder, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """See the top."""
    if sys.argv[1:2] == ["here"]:
        print(json.dumps(trained_here(*json.loads(sys.argv[2]))))
        return
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    options.add_argument("checkouts", type=Path, nargs="+")
    options.add_argument("--minutes", type=float, nargs="+", default=[8.0])
    options.add_argument("--seeds", type=int, nargs="+", default=[0])
    options.add_argument(
        "--training", type=json.loads, default={}, help="of TrainingConfig, as JSON"
    )
    options.add_argument("--network", type=json.loads, default={}, help="of NetworkConfig, as JSON")
    options.add_argument("--episodes", type=int, default=EPISODES["train"][0])
    given = options.parse_args()
    for minutes, seed in itertools.product(given.minutes, given.seeds):
        for root in given.checkouts:
            found = of_checkout(root, minutes, seed, given.training, given.network, given.episodes)
            numbers = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
            print(f"{root.name}, {minutes:g} min, seed {seed}: {numbers}", flush=True)


if __name__ == "__main__":
    main()
