"""How well MPPI does when its model is the plant itself: the ceiling for every learned model.

    python -m pipelines.oracle_study --goals 24

Prints one row per setting: share of goals reached, time to goal, computing time per plan. With
`--coarse` the model takes MuJoCo steps twice as long as the plant: half the time, a model that is a
little wrong. The rows that are in docs/results/oracle.md say which.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from flywheel.control import Controller, Mppi, MppiConfig, record_episode
from flywheel.control.protocol import Command
from flywheel.dynamics.plant import MeasurementModel, Plant, PlantDynamics
from flywheel.dynamics.protocol import Dynamics
from flywheel.records import Past, Provenance
from flywheel.robots import Robot, load_robot
from flywheel.tasks import Task, TaskConfig, sample_task

FIRST_SEED = 1000
SETTLE_SECONDS = 3.0


class RandomShooting:
    """Independent rates per knot, drawn anew for each plan; the best is carried out. No average."""

    name, model, history = "random shooting", "", 0

    def __init__(self, dynamics: Dynamics, config: MppiConfig) -> None:
        self.dynamics, self.config = dynamics, config

    def reset(self, task: Task | None, seed: int) -> None:
        """Begin an episode."""
        self._task, self._rng = task, np.random.default_rng(seed)

    def act(self, past: Past) -> Command:
        """The beginning of the best of K plans."""
        assert self._task is not None
        config, robot, dt = self.config, self.dynamics.robot, self.dynamics.dt
        knots = round(config.horizon_seconds / config.knot_seconds)
        shape = (config.samples, knots, len(robot.winches))
        rates = self._rng.uniform(robot.control_low, robot.control_high, shape)
        controls = np.repeat(rates, round(config.knot_seconds / dt), axis=1)
        costs = self._task.cost(self.dynamics.rollout(past, controls).points)
        return Command(controls[costs.argmin(), : round(config.replan_seconds / dt)])


def study(
    label: str,
    plant: Plant,
    controller: Controller,
    task: TaskConfig,
    goals: int,
) -> str:
    """Row of the table for one setting: `goals` tasks, the same ones for every setting."""
    start = plant.settle(SETTLE_SECONDS)
    points = plant.observe(start).points[0]
    seconds, distances, plans, begun = [], [], 0, time.process_time()
    for seed in range(FIRST_SEED, FIRST_SEED + goals):
        goal = sample_task(task.name, plant.robot, points, np.random.default_rng(seed), task)
        episode = record_episode(
            plant,
            MeasurementModel(),
            controller,
            goal,
            start=start,
            seconds=task.seconds,
            seed=seed,
            episode_id=f"study-{seed}",
            provenance=Provenance(plant.robot.digest),
            split="test",
        )
        assert episode.outcome is not None
        seconds.append(episode.outcome.seconds if episode.outcome.success else np.inf)
        distances.append(episode.outcome.distance)
        plans += len(episode.timing["plan_seconds"])
    cpu = (time.process_time() - begun) / plans
    times, reached = np.array(seconds), np.isfinite(seconds)
    median = f"{np.median(times):.1f}" if reached.mean() > 0.5 else "-"
    slowest = f"{times[reached].max():.1f}" if reached.any() else "-"
    return (
        f"| {label} | {reached.sum()}/{goals} | {median} | {slowest} | {max(distances):.1f} | "
        f"{1000 * cpu:.0f} |"
    )


def settings(robot: Robot, coarse: bool) -> dict[str, tuple[Controller, TaskConfig]]:
    """What is compared: the default, and the default with one thing changed."""
    finer = f'timestep="{robot.timestep:g}"'
    model = robot if not coarse else Robot.from_mjcf(robot.xml.replace(finer, 'timestep="0.01"'))
    dynamics = PlantDynamics(Plant(model))

    def mppi(**changes: float) -> Controller:
        return Mppi(dynamics, MppiConfig().model_copy(update=changes))

    task = TaskConfig()
    return {
        "default": (mppi(), task),
        "24 samples": (mppi(samples=24), task),
        "no fresh strokes": (mppi(fresh=0.0), task),
        "broadside 0.5": (mppi(), task.model_copy(update={"broadside": 0.5})),
        "broadside 1.5": (mppi(), task.model_copy(update={"broadside": 1.5})),
        "random shooting": (RandomShooting(dynamics, MppiConfig()), task),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--robot", default="prism3")
    parser.add_argument("--goals", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--coarse", action="store_true")
    parser.add_argument("--rows", nargs="*", help="names of settings; all if not given")
    given = parser.parse_args()
    robot = load_robot(given.robot)
    table = settings(robot, given.coarse)
    print("| setting | reached | median [s] | slowest [s] | farthest end [m] | CPU per plan [ms] |")  # noqa: T201
    print("|---|---|---|---|---|---|")  # noqa: T201
    for label in given.rows or table:
        controller, task = table[label]
        task = task.model_copy(update={"seconds": given.seconds})
        print(study(label, Plant(robot), controller, task, given.goals), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
