"""Recording episodes: a controller, a plant, and a measurement between them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flywheel.control.episode_log import EpisodeLog
from flywheel.control.protocol import Command, Controller, EpisodeOrder, OnPiece, Piece
from flywheel.dynamics.plant import MeasurementModel, Plant, Reckoning
from flywheel.errors import ConfigError, ModelError
from flywheel.records import Episode, Floats, Observation, Outcome, State, Trajectory
from flywheel.robots import Robot
from flywheel.tasks import Task


class PlantLog(EpisodeLog):
    """An episode on a plant so far, including the true states.

    Args:
      plant: stepped plant.
      measurement: between the plant and the controller.
      start: (1,) state.
      rng: of the measurement.
      steps: maximum number of recorded steps.
      reckoning: of unmeasured winches.
    """

    def __init__(
        self,
        plant: Plant,
        measurement: MeasurementModel,
        start: State,
        rng: np.random.Generator,
        steps: int,
        reckoning: Reckoning,
    ) -> None:
        super().__init__(plant.robot, plant.dt, steps, reckoning, plant.terrain)
        self._measurement, self._rng = measurement, rng
        self._states = [start[:, None]]
        self._measure(plant.observe(start[:, None]), 0)

    @property
    def state(self) -> State:
        """(1,) the plant's state now."""
        return self._states[-1][:, -1]

    def append(self, simulated: Trajectory) -> None:
        """Append the plant's motion from the present on."""
        assert simulated.states is not None
        self._measure(simulated.observations[:, 1:], self.done + 1)
        self.command(simulated.controls[0])
        self._states.append(simulated.states[:, 1:])

    def states(self) -> State:
        """The true states of the whole trajectory, unbatched."""
        return State.joined(self._states, axis=1)[0]

    def _measure(self, truth: Observation, first: int) -> None:
        self.see(self._measurement.apply(truth, self.robot, self._rng), first)


def record_episode(
    plant: Plant,
    measurement: MeasurementModel,
    controller: Controller,
    task: Task | None,
    order: EpisodeOrder,
    *,
    start: State,
    on_piece: OnPiece | None = None,
    reckoning: Reckoning | None = None,
) -> Episode:
    """Let a controller drive the plant until the goal is reached or time is up.

    The controller sees measurements and the ground only; `Past.state` is for the oracle. Success is
    judged at every step on the true points.

    Args:
      plant: one simulation is stepped, with the plant's (first) parameters.
      measurement: between the plant and the controller, and for the recording.
      controller: source of the commands.
      task: with its successors, or None. Its time limit covers all of them, in addition to the order's.
      order: of the episode.
      start: (1,) state.
      on_piece: called with each piece; may raise to end the recording.
      reckoning: of unmeasured winches; None for nominal ones.

    Raises:
      ConfigError: the order is of less than one step.
      ModelError: the controller's commands have a wrong shape, or plant or model diverged.
    """
    steps = steps_of(order, task, plant.dt)
    for_controller, noise = np.random.SeedSequence(order.seed).spawn(2)
    reckoning = reckoning or Reckoning(plant.robot, plant.dt)
    log = PlantLog(plant, measurement, start, np.random.default_rng(noise), steps, reckoning)
    controller.reset(task, number_of(for_controller))
    commands: dict[float, Command] = {}
    reached, course = False, plant.begin(start)
    while log.done < steps and not reached:
        command = controller.act(log.past(log.state))
        commands[log.done * plant.dt] = command
        controls = checked_controls(command.controls, controller.name, plant.robot)
        simulated = course.go(controls[None, : steps - log.done])
        if task is not None:
            simulated, reached = _until_reached(simulated, task)
            if reached and task.then is not None:
                task, reached = task.then, False
                controller.reset(task, number_of(for_controller.spawn(1)[0]))
        log.append(simulated)
        if on_piece:
            on_piece(Piece(log.done, simulated, command))
    outcome = None if task is None else _outcome(plant, log, task, reached)
    track, telemetry = log.trajectory(log.states()), telemetry_of(commands)
    return Episode(
        order.id, track, order.provenance, order.split, outcome, telemetry, plant.terrain
    )


def number_of(seeds: np.random.SeedSequence) -> int:
    return int(seeds.generate_state(1, np.uint64)[0])


def telemetry_of(commands: Mapping[float, Command]) -> dict[str, Floats]:
    """Planning times and predictions, with time stamps; rounded to millimetres, for figures only."""
    taken = np.array([command.plan_seconds for command in commands.values()])
    paths = {at: c.diagnostics["paths"] for at, c in commands.items() if "paths" in c.diagnostics}
    if not paths:
        return {"plan_seconds": taken}
    drawn = np.stack(list(paths.values())).round(3)
    return {"plan_seconds": taken, "plan_begins": np.array(list(paths)), "plan_paths": drawn}


def _until_reached(simulated: Trajectory, task: Task) -> tuple[Trajectory, bool]:
    """The piece up to the first step at which the goal is reached; the whole piece if another task
    follows.
    """
    assert simulated.states is not None
    there = task.reached(simulated.observations.points[0, 1:])
    if not there.any() or task.then is not None:
        return simulated, bool(there.any())
    steps = int(there.argmax()) + 1
    upto = slice(None, steps + 1)
    return Trajectory(
        simulated.observations[:, upto],
        simulated.controls[:, :steps],
        simulated.dt,
        simulated.states[:, upto],
    ), True


def _outcome(plant: Plant, log: PlantLog, task: Task, reached: bool) -> Outcome:
    distance = task.distance(plant.observe(log.state).points[0])
    return Outcome(reached, log.done * plant.dt, float(distance))


def checked_controls(controls: Floats, name: str, robot: Robot) -> Floats:
    controls = np.asarray(controls, float)
    if controls.ndim != 2 or not len(controls) or controls.shape[1] != len(robot.winches):
        raise ModelError(
            f"Controller {name} must give commands (S, {len(robot.winches)}) with S >= 1, got "
            f"{controls.shape}."
        )
    if not np.isfinite(controls).all():
        raise ModelError(f"Controller {name} gave a command that is not finite.")
    return controls


def steps_of(order: EpisodeOrder, task: Task | None, dt: float) -> int:
    seconds = order.seconds if task is None else min(order.seconds, task.seconds)
    steps = round(seconds / dt)
    if steps < 1:
        raise ConfigError(f"An episode needs at least one step of {dt:g} s, got {seconds:g} s.")
    return steps
