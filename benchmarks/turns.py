"""Two checkouts in turns: what a plant, a plan and a diagnosis cost with each, on a quiet machine.

    python -m benchmarks.turns BEFORE AFTER --rounds 3

Prints, for each checkout and round, simulated seconds per CPU second of every shipped robot, the CPU seconds
of a plan on prism3's plant and of a diagnosis, and what that says. The log has friction in the cables; it is
the same for both.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

SECONDS, SEED = 6.0, 3  # of the log
MOTIONS, STEPS = 32, 200  # of each robot
PLAN = {"samples": 200, "horizon_seconds": 2.0}


def measured_here() -> dict[str, float]:
    """Speeds of the plants [s/s] and CPU seconds of a plan, with the package that is imported here."""
    import numpy as np

    from flywheel.control import Mppi, MppiConfig, RandomControls
    from flywheel.dynamics.plant import Plant, PlantDynamics
    from flywheel.records import Past
    from flywheel.robots import ROBOTS, load_robot
    from flywheel.tasks import TaskConfig, sample_task

    found = {}
    for name in ROBOTS:
        plant = Plant(load_robot(name))
        start, controls = plant.settle(1.0, MOTIONS), RandomControls(plant.robot, plant.dt)
        winch = plant.winch(start)
        told = np.stack([controls.sequence(each, STEPS, i) for i, each in enumerate(winch)])
        began = time.process_time()
        plant.simulate(start, told)
        found[f"{name} [s/s]"] = told[..., 0].size * plant.dt / (time.process_time() - began)
    plant = Plant(load_robot("prism3"))
    track = plant.simulate(plant.rest(), np.zeros((1, 1, len(plant.robot.winches))))
    assert track.states is not None
    past = Past(
        track.observations, track.controls, track.observations.winch, state=track.states[:, -1]
    )
    task = sample_task(
        "reach",
        plant.robot,
        track.observations.points[0, -1],
        np.random.default_rng(0),
        TaskConfig(),
    )
    planner = Mppi(PlantDynamics(plant), MppiConfig(**PLAN))  # type: ignore[arg-type]
    planner.reset(task, 0)
    began = time.process_time()
    planner.act(past)
    return found | {"plan [CPU s]": time.process_time() - began}


def write_log(folder: Path) -> Path:
    """Write the log as CSV."""
    from benchmarks.regression.cases import Log

    return Log({"cable_friction": 1.0}, seed=SEED, seconds=SECONDS).write(folder, "log")


def of_checkout(root: Path, log: Path, folder: Path) -> dict[str, Any]:
    """One round of one checkout."""
    place = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(root)}
    words = [sys.executable, str(Path(__file__).resolve()), "here"]
    done = subprocess.run(words, env=place, cwd=folder, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    answer = folder / "answer.json"
    words = [sys.executable, "-m", "flywheel.cli", "diagnose", str(log), "--robot", "prism3"]
    began = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [*words, "--threads", "1", "--json", str(answer), "--page", str(folder / "page.html")],
        env=place,
        cwd=folder,
        capture_output=True,
        check=False,
    )
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    taken = ended.ru_utime + ended.ru_stime - began.ru_utime - began.ru_stime
    said = json.loads(answer.read_text())
    return found | {
        "diagnosis [CPU s]": taken,
        **{name: said[name] for name in ("verdict", "answer_set", "error", "time_steps")},
    }


def main() -> None:
    """Measure both in turns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkouts", nargs="+", type=Path)
    parser.add_argument("--rounds", type=int, default=1)
    asked = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = Path(name)
        log = write_log(folder)
        for number in range(asked.rounds):
            for root in asked.checkouts:
                found = of_checkout(root.resolve(), log, folder)
                print(number, root, json.dumps(found), flush=True)


if __name__ == "__main__":
    if sys.argv[1:] == ["here"]:
        print(json.dumps(measured_here()))
    else:
        main()
