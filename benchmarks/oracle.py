"""Success of MPPI with the plant itself as model: the ceiling for every learned model.

    python -m benchmarks.oracle --goals 24
    python -m benchmarks.oracle --robot icosa6 --course s_course --seconds 120 --goals 10

Prints one row per setting: share of goals reached, time to goal, computing time per plan. With
`--coarse` the model takes MuJoCo steps twice as long as the plant: half the time, with a small
model error. docs/results/oracle.md lists its rows.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from benchmarks.command import parser_of
from flywheel.control import Controller, EpisodeOrder, Mppi, MppiConfig, record_episode, standing
from flywheel.control.protocol import Command
from flywheel.dynamics.plant import MeasurementModel, Plant, PlantDynamics
from flywheel.dynamics.protocol import Dynamics
from flywheel.records import Past, Provenance
from flywheel.robots import Robot, load_robot, read_robot
from flywheel.tasks import Task, TaskConfig, sample_task
from flywheel.terrain import with_boxes

Planner = Callable[[Dynamics], Controller]

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
    label: str, robot: Robot, plan_with: Planner, task: TaskConfig, coarse: bool, goals: int
) -> str:
    """Row of the table for one setting: `goals` tasks, the same ones for every setting."""
    ground = Plant(robot)
    start = ground.settle(SETTLE_SECONDS)
    points = ground.observe(start).points[0]
    seconds, distances, plans, begun = [], [], 0, time.process_time()
    for seed in range(FIRST_SEED, FIRST_SEED + goals):
        goal = sample_task(task.name, robot, points, np.random.default_rng(seed), task)
        around = with_boxes(None, goal.obstacles)
        plant = Plant(robot, terrain=around)
        model = Plant(_coarser(robot) if coarse else robot, terrain=around)
        stand = goal.begin
        episode = record_episode(
            plant,
            MeasurementModel(),
            plan_with(PlantDynamics(model)),
            goal,
            EpisodeOrder(f"study-{seed}", Provenance(robot.digest), task.seconds, seed, "test"),
            start=start if stand is None else standing(plant, start, stand.place, stand.turn),
        )
        assert episode.outcome is not None
        seconds.append(episode.outcome.seconds if episode.outcome.success else np.inf)
        distances.append(episode.outcome.distance)
        plans += len(episode.telemetry["plan_seconds"])
    cpu = (time.process_time() - begun) / plans
    times, reached = np.array(seconds), np.isfinite(seconds)
    median = f"{np.median(times):.1f}" if reached.mean() > 0.5 else "-"
    slowest = f"{times[reached].max():.1f}" if reached.any() else "-"
    return (
        f"| {label} | {reached.sum()}/{goals} | {median} | {slowest} | {max(distances):.1f} | "
        f"{1000 * cpu:.0f} |"
    )


def settings(task: TaskConfig) -> dict[str, tuple[Planner, TaskConfig]]:
    """The compared settings: the default, and the default with one change."""

    def mppi(**changes: float) -> Planner:
        config = MppiConfig().model_copy(update=changes)
        return lambda dynamics: Mppi(dynamics, config)

    return {
        "default": (mppi(), task),
        "24 samples": (mppi(samples=24), task),
        "200 samples, 2 s": (mppi(samples=200, horizon_seconds=2.0), task),
        "two rounds": (mppi(samples=24, rounds=2), task),
        "no fresh strokes": (mppi(fresh=0.0), task),
        "4 neighbours": (mppi(), task.model_copy(update={"moves": "manhattan"})),
        "broadside 0.5": (mppi(), task.model_copy(update={"broadside": 0.5})),
        "broadside 1.5": (mppi(), task.model_copy(update={"broadside": 1.5})),
        "random shooting": (lambda dynamics: RandomShooting(dynamics, MppiConfig()), task),
    }


def _coarser(robot: Robot) -> Robot:
    finer = f'timestep="{robot.timestep:g}"'
    return read_robot(robot.xml.replace(finer, 'timestep="0.01"'))


def main() -> None:
    """Print the table."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("--robot", default="prism3")
    parser.add_argument("--course", help="an obstacle course instead of open ground")
    parser.add_argument("--goals", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--coarse", action="store_true")
    parser.add_argument("--rows", nargs="*", help="names of settings; all if not given")
    given = parser.parse_args()
    robot = load_robot(given.robot)
    task = TaskConfig(seconds=given.seconds)
    if given.course:
        task = TaskConfig(name="obstacle_course", course=given.course, seconds=given.seconds)
    table = settings(task)
    print("| setting | reached | median [s] | slowest [s] | farthest end [m] | CPU per plan [ms] |")
    print("|---|---|---|---|---|---|")
    for label in given.rows or table:
        plan_with, cost = table[label]
        print(study(label, robot, plan_with, cost, given.coarse, given.goals), flush=True)


if __name__ == "__main__":
    main()
