"""Time steps in `flywheel robot check`: their error, and better settings."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from flywheel.cli.console import Out, table

if TYPE_CHECKING:
    import numpy as np

    from flywheel.dynamics.plant import Plant, StepError
    from flywheel.dynamics.plant.time_steps import CableDamping
    from flywheel.records import State
    from flywheel.robots import Robot

MOTIONS, SECONDS, BEFORE = 6, 2.0, 1.0  # that are compared, and that precede them [s]
THROWN = 0.2  # speeds of a robot without winches, in sqrt(g L)
FINE = 20  # times shorter than the robot's own are the steps of what is taken for right
PATIENCE = 20.0  # of a processor, about, for all motions in all steps [s]
ALL_STEPS = FINE + 12.0  # what these cost, beside the motions in the robot's own steps
OTHERS = ("Euler", "implicitfast")  # that cost about the same; the rest cost 3 to 4 times as much
FACTORS = (2.0, 1.0, 0.5)  # of the robot's own step
NEARER = 0.8  # of an error: what is worth another integrator
ENOUGH = 1e-3  # of the robot's length: a third of what motion capture scatters
SPARE = 0.5  # of the stable limit: dampers of a fitted or a lighter robot may come nearer to it


def show_steps(out: Out, plant: Plant) -> bool:
    """Print the error due to the time steps of a robot that settles.

    Args:
      out: to print to.
      plant: of the robot.

    Returns:
      False if the robot diverges under commands.
    """
    from flywheel.dynamics.plant import cable_damping
    from flywheel.errors import ModelError

    robot, damping = plant.robot, cable_damping(plant)
    try:
        errors = measured(plant)
    except ModelError as error:
        how = "under random commands" if robot.winches else "thrown at random"
        out.say(f"It diverges {how}. {error}", style="red")
        return not robot.winches
    if not errors:
        out.say("It is too slow for its time steps to be measured here.")
        return True
    out.print(
        table(
            f"Time steps: where tracked points are after {SECONDS:g} s "
            f"{'of random commands' if robot.winches else 'thrown at random'}",
            ["integrator", "step [ms]", "off, median [mm]", "90 % below", "s per CPU second"],
            [
                (
                    each.integrator,
                    1e3 * each.timestep,
                    _millimetres(each.median),
                    _millimetres(each.most),
                    _short(each.speed),
                )
                for each in errors
            ],
        )
    )
    out.say(advice(errors, robot, damping))
    if words := _limit("RK4" if robot.integrator == "RK4" else "Euler", robot.timestep, damping):
        out.say(words)
    return True


def beyond_limit(plant: Plant) -> str:
    """A sentence about steps that are too long for the damping of its cables; "" if they are not."""
    from flywheel.dynamics.plant import cable_damping

    robot, damping = plant.robot, cable_damping(plant)
    beyond = robot.timestep > damping.limit(robot.integrator)
    return _limit(robot.integrator, robot.timestep, damping) if beyond else ""


def _limit(integrator: str, timestep: float, damping: CableDamping) -> str:
    """A sentence about the stable limit of an explicit integrator; "" if there is none."""
    limit = damping.limit(integrator)
    if not math.isfinite(limit):
        return ""
    now, most, alone = (
        f"{rate * step:.3g}"
        for rate, step in ((damping.rate, timestep), (damping.rate, limit), (damping.own, timestep))
    )
    return (
        f"With {integrator} the damping of its cables is explicit, and stable in steps below "
        f"{1e3 * limit:.3g} ms: c dt / m is {now} in steps of {1e3 * timestep:.3g} ms, and has to be below "
        f"{most} (all cables taut; {damping.cable} alone has {alone})."
    )


def measured(plant: Plant) -> list[StepError]:
    """The errors of some integrators with some steps; none if that would take too long.

    Raises:
      ModelError: a motion diverged in short steps.
    """
    import numpy as np

    from flywheel.control import RandomControls
    from flywheel.dynamics.plant import StepStudy

    robot, controls = plant.robot, RandomControls(plant.robot, plant.dt)
    start = _begun(plant)

    def commands(seconds: float, winch: np.ndarray, seed: int) -> np.ndarray:
        steps = max(1, round(seconds / plant.dt))
        return np.stack([controls.sequence(each, steps, seed + i) for i, each in enumerate(winch)])

    began = time.process_time()
    states = plant.simulate(start, commands(BEFORE, plant.winch(start), 0)).states
    assert states is not None
    price = (time.process_time() - began) / BEFORE * SECONDS * ALL_STEPS
    count = min(MOTIONS, int(MOTIONS * PATIENCE / max(price, 1e-9)))
    if not count:
        return []
    begun = states[:count, -1]
    told = commands(SECONDS, plant.winch(begun), MOTIONS)
    study = StepStudy(plant, begun, told, robot.integrator, robot.timestep / FINE)
    return [
        study.error(integrator, timestep)
        for timestep in _steps(plant)
        for integrator in dict.fromkeys((robot.integrator, *OTHERS))
    ]


def _begun(plant: Plant) -> State:
    """States of all motions before their commands; thrown where there are no winches to move them."""
    import numpy as np

    from flywheel.dynamics.plant import turning
    from flywheel.records import State
    from flywheel.robots import GRAVITY

    length = plant.robot.length
    state = State.joined([plant.settle(BEFORE)] * MOTIONS)
    if plant.robot.winches:
        return state
    speeds = np.random.default_rng(0).normal(0.0, THROWN, state.qvel.shape)
    unit = np.where(turning(plant), 1.0, length) * math.sqrt(GRAVITY / length)
    return State(state.qpos, state.qvel + unit * speeds, state.act)


def _steps(plant: Plant) -> list[float]:
    """Steps [s] that the control step is a multiple of, longest first."""
    steps = (factor * plant.robot.timestep for factor in FACTORS)
    return [step for step in steps if abs(plant.dt / step - round(plant.dt / step)) < 1e-6]


def stable(errors: Sequence[StepError], damping: CableDamping) -> list[StepError]:
    """Those of steps that are well below the stable limit of their integrator."""
    return [e for e in errors if e.timestep <= SPARE * damping.limit(e.integrator)]


def chosen(plant: Plant) -> StepError | None:
    """The longest steps that are exact enough, else the most exact ones; None where none are measured."""
    from flywheel.dynamics.plant import cable_damping
    from flywheel.errors import ModelError

    try:
        safe = stable(measured(plant), cable_damping(plant))
    except ModelError:
        return None
    enough = [each for each in safe if each.most <= ENOUGH * plant.robot.length]
    if enough:
        return max(enough, key=lambda each: (each.timestep, -each.median))
    return min(safe, key=lambda each: each.median, default=None)


def advice(errors: Sequence[StepError], robot: Robot, damping: CableDamping) -> str:
    """The error of a robot's time steps in words, and the option for better ones, if there are any.

    Args:
      errors: measured ones, including those of the robot's own steps.
      robot: of the steps.
      damping: of its cables.
    """
    timestep, safe = robot.timestep, stable(errors, damping)
    own = next(e for e in errors if (e.integrator, e.timestep) == (robot.integrator, timestep))
    words = f"Its time steps cost {said(own)}, {_short(100 * own.median / robot.length)} % of L"
    enough = ENOUGH * robot.length
    longer = [
        e for e in safe if e.timestep > timestep and (e.median <= own.median or e.most <= enough)
    ]
    nearer = [e for e in safe if e.timestep == timestep and e.median <= NEARER * own.median]
    for better, why in ((longer, "Fewer would do"), (nearer, "As many can do better")):
        if better:
            best = min(better, key=lambda e: (-e.timestep, e.median))
            return (
                f"{words}. {why}, {said(best)}: write "
                f'<option timestep="{best.timestep:.12g}" integrator="{best.integrator}"/>.'
            )
    finer = [e for e in safe if e.timestep < timestep]
    if finer:
        best = min(finer, key=lambda e: e.median)
        words += f"; twice as many would cost {said(best)}"
    return f"{words}. No other integrator is much better in steps of this length."


def said(error: StepError) -> str:
    """An error with its steps."""
    return (
        f"{_millimetres(error.median)} mm after {SECONDS:g} s ({error.integrator}, "
        f"{1e3 * error.timestep:.3g} ms)"
    )


def _millimetres(distance: float) -> str:
    return _short(1e3 * distance) if math.isfinite(distance) else "diverged"


def _short(number: float) -> str:
    """A number with two significant digits."""
    return f"{float(f'{number:.2g}'):g}"
