"""Checkouts in turns: the network's error after equal CPU time, each with its own defaults.

    python -m benchmarks.recipes BEFORE AFTER --minutes 8 --seeds 0 1 2
    python -m benchmarks.recipes CHECKOUT --minutes 2 4 8
    python -m benchmarks.recipes CHECKOUT --training '{"matrix_rate": 0}' --network '{"width": 96}'
    python -m benchmarks.recipes CHECKOUT --keep

Trains prism3's default network from random weights on random motion without noise, half a minute an episode,
on one thread, and prints the errors over 2 s on episodes that no training has seen. A short training says how
many steps take the given minutes of one core; the CPU seconds that they took are printed. All have the same
episodes. --keep adds the results to results/recipes.csv under the names of the checkouts' folders, and
draws the curve of docs/results/optimiser.md.
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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # at run time in functions: trainings import another checkout
    from matplotlib.figure import Figure

    from flywheel.data import WindowCache
    from flywheel.records import Episode, Split

EPISODES: dict[Split, tuple[int, int]] = {  # how many, and their first seed
    "train": (72, 1),
    "validation": (8, 5001),
    "test": (10, 9001),
}
SECONDS, HORIZON, STARTS = 30.0, 2.0, 20
Settings = dict[str, Any]
RECIPES_CSV = Path(__file__).with_name("results") / "recipes.csv"
CURVE = Path(__file__).parents[1] / "docs" / "results" / "optimiser" / "curve.svg"
PILOT = 60  # steps of the training that measures how long one takes


@dataclass(frozen=True)
class RecipeRow:
    """A training, and its errors over 2 s on episodes that it has not seen.

    `changed` are the settings that are not the build's defaults, `data` and `minutes` those of the episodes
    and of one core that were asked for, `cpu` the seconds that it took, `e_pos` the RMSE of the centres of
    mass [% of the robot's length], `e_rot` the mean angle [deg].
    """

    build: str
    changed: str
    data: float
    minutes: float
    seed: int
    steps: int
    cpu: float
    e_pos: float
    e_rot: float


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


def table(rows: Sequence[RecipeRow]) -> list[str]:
    """Lines of Markdown: a row for each recipe, with all its seeds."""
    from benchmarks.rows import grouped

    head = "build | minutes of one core | of data | changed | steps | RMSE/L [%] | turn [deg]"
    lines = [f"| {head} |", "|---" * 7 + "|"]
    alike = grouped(rows, "build", "minutes", "data", "changed")
    for (build, minutes, data, changed), seeds in alike.items():
        cells = f"{build} | {minutes:g} | {data:g} | {changed}"
        steps, e_pos, e_rot = (
            ", ".join(format(getattr(row, name), digits) for row in seeds)
            for name, digits in (("steps", "d"), ("e_pos", ".1f"), ("e_rot", ".1f"))
        )
        lines.append(f"| {cells} | {steps} | {e_pos} | {e_rot} |")
    return lines


def figure(rows: Sequence[RecipeRow]) -> Figure:
    """Errors of builds with their defaults and all data against minutes of one core: seeds, and medians."""
    from matplotlib.figure import Figure

    from benchmarks.rows import grouped
    from flywheel.reports import style

    whole = EPISODES["train"][0] * SECONDS / 60.0
    builds = grouped([row for row in rows if row.data == whole and not row.changed], "build")
    looks = (style.MPPI, "o"), (style.CONTROL, "s"), (style.ORACLE, "^"), (style.INK, "D")
    drawn = Figure(figsize=(7.4, 3.0))
    measures = {"e_pos": "position error, RMSE/L [%]", "e_rot": "turn [deg]"}
    for axes, (measure, label) in zip(drawn.subplots(1, 2), measures.items(), strict=True):
        for ((name,), own), (colour, marker) in zip(builds.items(), looks, strict=False):
            told = sorted(grouped(own, "minutes").items())
            x = [mean(row.cpu for row in seeds) / 60.0 for _, seeds in told]
            y = [median(getattr(row, measure) for row in seeds) for _, seeds in told]
            axes.plot(x, y, color=colour)
            dots = [row.cpu / 60.0 for row in own], [getattr(row, measure) for row in own]
            axes.plot(*dots, marker, color=colour, markersize=4, label=name)
        axes.set(xlabel="minutes of one core", ylabel=label)
        style.logarithmic(axes.xaxis)
        style.logarithmic(axes.yaxis)
    drawn.legend(*drawn.axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=4)
    return drawn


def keep(rows: Sequence[RecipeRow]) -> None:
    """Add rows to the results, in place of those of the same trainings, and draw the curve."""
    from benchmarks.rows import other_rows, values_of, write_rows
    from flywheel.outputs import write_output
    from flywheel.reports.pictures import as_file

    which = ("build", "changed", "data", "minutes", "seed")
    every = other_rows(RecipeRow, RECIPES_CSV, which, {values_of(row, which) for row in rows})
    every = [*every, *rows]
    every.sort(key=lambda row: (row.build, row.changed, -row.data, row.minutes, row.seed))
    write_rows(RECIPES_CSV, every)
    picture = as_file(lambda: figure(every))
    assert picture is not None
    write_output(CURVE, picture)


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
    options.add_argument("--keep", action="store_true", help="add to the results of the docs")
    given, rows = options.parse_args(), []
    changed = ", ".join(
        f"{name} {value}" for name, value in (given.training | given.network).items()
    )
    for minutes, seed in itertools.product(given.minutes, given.seeds):
        for root in given.checkouts:
            found = of_checkout(root, minutes, seed, given.training, given.network, given.episodes)
            numbers = ", ".join(f"{name} {value:.4g}" for name, value in found.items())
            print(f"{root.name}, {minutes:g} min, seed {seed}: {numbers}", flush=True)
            errors = found["RMSE/L [%]"], found["turn [deg]"]
            took = int(found["steps"]), found["CPU [s]"]
            data = given.episodes * SECONDS / 60.0
            rows.append(RecipeRow(root.name, changed, data, minutes, seed, *took, *errors))
    if given.keep:
        keep(rows)


if __name__ == "__main__":
    main()
