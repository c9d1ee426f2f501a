"""Integrators and time steps of the shipped robots: how far off motions end, and what they cost.

    python -m benchmarks.steps [ROBOT ...]     some eight minutes on one core; the rest stays as it was
    python -m benchmarks.tables                makes the tables of docs/results/steps.md from it

Every motion lasts two seconds, and is compared with the same one in steps so short that another integrator
in such steps ends in the same place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.command import parser_of
from benchmarks.rows import RESULTS, other_rows, write_rows
from flywheel.control import Gait, RandomControls, random_drop
from flywheel.control.gaits import FORWARDS
from flywheel.dynamics.plant import Plant, PlantParameters, StepStudy
from flywheel.dynamics.plant.refined import with_steps
from flywheel.errors import ModelError
from flywheel.records import Floats, Past, State
from flywheel.robots import ROBOTS, load_robot
from flywheel.robots.integrators import INTEGRATORS

STEPS_CSV, REST_CSV = RESULTS / "steps.csv", RESULTS / "steps_at_rest.csv"
SECONDS = 2.0
MOTIONS = {"prism3": 24, "icosa6": 12, "platform4": 24}
DT = 0.01  # between commands [s]
STEPS = tuple(DT / count for count in (1, 2, 3, 4, 5, 10))  # that DT is a multiple of [s]
EXACT = ("Euler", DT / 200)
NEARLY = (("Euler", DT / 100), ("implicitfast", DT / 100), ("RK4", DT / 20))  # what shows that
FEW = tuple((name, DT / count) for count in (1, 2, 4) for name in ("implicitfast", "Euler"))
OTHERS = {  # plants that fits and trainings meet, and beyond
    "contacts x 3": PlantParameters(contact_stiffness=3.0),
    "contacts x 10": PlantParameters(contact_stiffness=10.0),
    "stiffness x 4": PlantParameters(cable_stiffness=4.0),
    "damping x 4": PlantParameters(cable_damping=4.0),
    "damping x 20": PlantParameters(cable_damping=20.0),
}
AS_IS = {"the MJCF's": PlantParameters()}
SHOWN = ("10", "5", "2.5", "0.5")  # of the integrators that cost more [ms]
STILL = 1e-3  # slower [mm/s] and nearer [mm] is not shown
SETTLED, WATCHED = 5.0, 20.0  # at rest: after how long, and for how long [s]


@dataclass(frozen=True)
class StepRow:
    """How far off one integrator with one step is.

    Attributes:
      robot, plant, controls: of the motions.
      integrator: by the MJCF's word for it.
      step: [ms].
      median, most: distances of tracked points at the end; 90 % are below `most`; NaN if it diverged [mm].
      energy: median error of the mechanical energy at the end [J].
      speed: simulated seconds per second of one CPU.
    """

    robot: str
    plant: str
    controls: str
    integrator: str
    step: float
    median: float
    most: float
    energy: float
    speed: float


@dataclass(frozen=True)
class RestRow:
    """Motion of a robot at rest: the speed of its fastest point, and its displacement.

    Attributes:
      robot, plant, integrator, step: see `StepRow`.
      speed: after five seconds; NaN if it diverged [mm/s].
      way: of the tracked point that goes farthest in the next 20 seconds [mm].
    """

    robot: str
    plant: str
    integrator: str
    step: float
    speed: float
    way: float


@dataclass(frozen=True)
class Motions:
    """Motions to be compared.

    Attributes:
      start: (B,) states.
      controls: (B, T, W) commands.
    """

    start: State
    controls: Floats


def random_motions(plant: Plant, count: int) -> Motions:
    """Under random commands, begun in the midst of such."""
    controls, start = RandomControls(plant.robot, DT), plant.settle(3.0)

    def told(winch: Floats, seconds: float, seed: int) -> Floats:
        steps = round(seconds / DT)
        return np.stack([controls.sequence(each, steps, seed + i) for i, each in enumerate(winch)])

    before = told(np.repeat(plant.winch(start), count, axis=0), 1.0, 0)
    states = plant.simulate(start, before).states
    assert states is not None
    begun = states[:, -1]
    return Motions(begun, told(plant.winch(begun), SECONDS, 1000))


def held_motions(plant: Plant, count: int) -> Motions:
    """The same, but the winches stop: it comes to rest."""
    begun = random_motions(plant, count).start
    hold = plant.robot.holding(plant.winch(begun))
    return Motions(begun, np.repeat(hold[:, None], round(SECONDS / DT), axis=1))


def dropped_motions(plant: Plant, count: int) -> Motions:
    """Dropped in any orientation from some height."""
    begun = random_drop(plant, np.random.default_rng(0), count)
    hold = plant.robot.holding(plant.winch(begun))
    return Motions(begun, np.repeat(hold[:, None], round(SECONDS / DT), axis=1))


def gait_motions(plant: Plant, count: int) -> Motions:
    """Pieces of gaits, by the commands that the gaits gave."""
    steps, each = round(SECONDS / DT), -(-count // len(FORWARDS))
    begun, told = [], []
    for pattern in FORWARDS:
        gait, state = Gait(plant.robot, pattern, DT), plant.settle(1.0)
        for _ in range(each):
            begun.append(state)
            commands = []
            for _ in range(steps):
                seen = plant.observe(state[:, None])
                past = Past(seen, np.zeros((1, 0, len(plant.robot.winches))), seen.winch)
                commands.append(gait.act(past).controls[0])
                states = plant.simulate(state, commands[-1][None, None]).states
                assert states is not None
                state = states[:, -1]
            told.append(commands)
    start = State(
        *(np.concatenate([getattr(s, name) for s in begun]) for name in ("qpos", "qvel", "act"))
    )
    return Motions(start[:count], np.array(told)[:count])


CONTROLS: dict[str, Callable[[Plant, int], Motions]] = {
    "random": random_motions,
    "held": held_motions,
    "dropped": dropped_motions,
    "gaits": gait_motions,
}
POSSIBLE = {  # some only fly, or have no gaits
    "prism3": ("random", "held", "dropped", "gaits"),
    "icosa6": ("random", "held", "dropped"),
    "platform4": ("random", "held"),
}


def step_rows(
    robot: str, kind: str, plant_name: str, parameters: PlantParameters
) -> Iterator[StepRow]:
    """One row for each integrator and step, on one plant and one kind of motion."""
    loaded = load_robot(robot)
    plant = Plant(loaded, DT, parameters)
    motions = CONTROLS[kind](with_steps(plant, "Euler", 0.001), MOTIONS[robot])
    whole = kind == "random" and plant_name in AS_IS
    exact = EXACT if whole else NEARLY[0]
    study = StepStudy(plant, motions.start, motions.controls, *exact)
    grid = [(name, step) for step in STEPS for name in INTEGRATORS] if whole else FEW
    for integrator, step in [*(NEARLY if whole else ()), *grid]:
        error = study.error(integrator, step)
        yield StepRow(
            robot,
            plant_name,
            kind,
            integrator,
            1e3 * step,
            _finite(1e3 * error.median),
            _finite(1e3 * error.most),
            error.energy,
            error.speed,
        )


def _finite(number: float) -> float:
    return number if np.isfinite(number) else np.nan


def rest_rows(robot: str) -> Iterator[RestRow]:
    """One row for each plant, integrator and step of a robot that should lie still."""
    for name, parameters in {**AS_IS, **OTHERS}.items():
        plant = Plant(load_robot(robot), DT, parameters)
        for integrator, step in FEW:
            speed = way = np.nan
            try:
                other = with_steps(plant, integrator, step)
                lying = other.settle(SETTLED)
                after = other.settle(DT, start=lying)
                later = other.settle(WATCHED, start=lying)
                places = [other.observe(state).points[0] for state in (lying, after, later)]
                speed = 1e3 * np.linalg.norm(places[1] - places[0], axis=-1).max() / DT
                way = 1e3 * np.linalg.norm(places[2] - places[0], axis=-1).max()
            except ModelError:
                pass
            yield RestRow(robot, name, integrator, 1e3 * step, float(speed), float(way))


def rows_of(robot: str) -> Iterator[StepRow]:
    """All rows of a robot that moves."""
    for kind in POSSIBLE[robot]:
        yield from step_rows(robot, kind, *next(iter(AS_IS.items())))
    for name, parameters in OTHERS.items():
        yield from step_rows(robot, "random", name, parameters)


def motions_table(rows: Sequence[StepRow]) -> list[str]:
    """Lines of Markdown: integrators and steps under random commands, a column for each robot."""
    rows = [row for row in rows if row.controls == "random" and row.plant in AS_IS]
    robots = list(dict.fromkeys(row.robot for row in rows))
    of = {(row.integrator, f"{row.step:.4g}", row.robot): row for row in rows}
    steps = dict.fromkeys((row.integrator, f"{row.step:.4g}") for row in rows)
    lines = [
        f"| integrator | step [ms] | {' | '.join(robots)} |",
        "|---" * (2 + len(robots)) + "|",
    ]
    for name, step in sorted(
        steps, key=lambda each: (list(INTEGRATORS).index(each[0]), -float(each[1]))
    ):
        if name in ("Euler", "implicitfast") or step in SHOWN:
            cells = (_cell(of[name, step, robot]) for robot in robots)
            lines.append(f"| {name} | {float(step):.3g} | {' | '.join(cells)} |")
    return lines


def _cell(row: StepRow) -> str:
    near, most, lost, speed = map(_number, (row.median, row.most, row.energy, row.speed))
    return f"{near}, {most}; {lost}; {speed}"


def others_table(rows: Sequence[StepRow]) -> list[str]:
    """Lines of Markdown: other motions and other plants, a column for each of a few steps."""
    lines = _few_columns("| robot | plant | commands |")
    cases = dict.fromkeys((row.robot, row.plant, row.controls) for row in rows)
    for robot, plant, controls in cases:
        of = {
            (row.integrator, f"{row.step:.4g}"): row.median
            for row in rows
            if (row.robot, row.plant, row.controls) == (robot, plant, controls)
        }
        cells = (_number(of[name, f"{1e3 * step:.4g}"]) for name, step in FEW)
        lines.append(f"| {robot} | {plant} | {controls} | {' | '.join(cells)} |")
    return lines


def rest_table(rows: Sequence[RestRow]) -> list[str]:
    """Lines of Markdown: what robots do at rest where not all lie still, a column for each of a few steps."""
    lines = _few_columns("| robot | plant |")
    moving = [row for row in rows if not max(row.speed, row.way) < STILL]
    for robot, plant in dict.fromkeys((row.robot, row.plant) for row in moving):
        of = {
            (row.integrator, f"{row.step:.4g}"): f"{_number(row.speed)}, {_number(row.way)}"
            for row in rows
            if (row.robot, row.plant) == (robot, plant)
        }
        cells = (of[name, f"{1e3 * step:.4g}"] for name, step in FEW)
        lines.append(f"| {robot} | {plant} | {' | '.join(cells)} |")
    return lines


def _few_columns(first: str) -> list[str]:
    names = [f"{name} {1e3 * step:g} ms" for name, step in FEW]
    return [f"{first} {' | '.join(names)} |", "|---" * (first.count("|") - 1 + len(FEW)) + "|"]


def _number(number: float) -> str:
    """Two digits that count, of a hundred and more all before the point."""
    if np.isnan(number):
        return "diverged"
    if abs(number) >= 100:
        return f"{number:.0f}"
    return f"{float(f'{number:.2g}'):.4f}".rstrip("0").rstrip(".")


def main() -> None:
    """Measure, and write what was measured into the tables' files."""
    parser = parser_of(__file__, __doc__)
    parser.add_argument("robots", nargs="*", choices=[[], *ROBOTS], metavar="ROBOT")
    for robot in parser.parse_args().robots or ROBOTS:
        for path, kind, rows in (
            (STEPS_CSV, StepRow, list(rows_of(robot))),
            (REST_CSV, RestRow, list(rest_rows(robot))),
        ):
            kept = other_rows(kind, path, ("robot",), {(robot,)})
            write_rows(path, [*kept, *rows])
            print(f"{robot}: {len(rows)} rows in {path.name}", flush=True)


if __name__ == "__main__":
    main()
