"""Driving a robot through a link, based on measurements alone.

A robot that waits to be observed is driven in lockstep; planning takes none of its time. In real
time a plan is computed while the previous one is executed; it starts `lead` control steps after the
request, and the planner knows the commands until then. If a plan is late, the previous one
continues to its end.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flywheel.control.closed_loop import checked_controls, steps_of, telemetry_of
from flywheel.control.episode_log import EpisodeLog
from flywheel.control.protocol import Command, Controller, EpisodeOrder
from flywheel.data.recordings.geometry import distances, median, pairs
from flywheel.dynamics.plant import Reckoning
from flywheel.errors import LinkError, ModelError
from flywheel.records import Episode, Floats, Observation, Outcome, Past, Provenance
from flywheel.robot_link.protocol import RobotLink, Sample
from flywheel.robot_link.transcript import ReplayedLink
from flywheel.robot_link.wire import Reset, Send
from flywheel.robots import Robot
from flywheel.tasks import Task

VALID = 0.1  # how long a command stays valid if no other follows [s]: then the driver is taken to be lost
LEAST_PERIODS = 5  # the same in control periods
BLIND = 5.0  # longest time without a measured point; then the robot is taken to be lost [s]
# Times the distances of points on a body by the MJCF, which no noise makes of them.
OTHER_SIZE = 2.0
Ending = Literal["goal", "time", "lost", "failed", "stopped"]
TaskOf = Callable[[Floats], Task | None]
OnStep = Callable[[int, Sample], None]


@dataclass(frozen=True)
class Drive:
    """Result of a drive.

    Attributes:
      episode: measurements and commands, complete up to its end.
      ended: at the goal, by the time limit, by a lost link, by a failure of the controller, or by
        the user.
      why: message if something was lost or failed; else "".
      late_plans: plans that came after their start.
      skipped: control periods without a command in time; the previous one was kept.
    """

    episode: Episode
    ended: Ending
    why: str = ""
    late_plans: int = 0
    skipped: int = 0


@dataclass
class _Going:
    """A drive in progress."""

    log: EpisodeLog
    planner: Planner
    task: Task | None
    last_seen: Floats
    last_row: int = 0
    skipped: int = 0
    reached: bool = False


def drive(
    link: RobotLink,
    robot: Robot,
    controller: Controller,
    task_of: TaskOf,
    order: EpisodeOrder,
    *,
    reckoning: Reckoning,
    dataset: int = 0,
    lead: int = 0,
    on_step: OnStep | None = None,
) -> Drive:
    """Let a controller drive a robot until the goal is reached or time is up.

    Success is judged by measurements. However the drive ends, the robot is commanded to hold its
    winches, and the measurements until then are kept.

    Args:
      link: to the robot; it is reset first.
      robot: of its MJCF.
      controller: source of the commands.
      task_of: returns the task, given the points (P, 3) of the standing robot; None for none.
      order: of the episode.
      reckoning: of unmeasured winches.
      dataset: index of the data set assumed by a network.
      lead: control steps between the request for a plan and its start; 0 to wait for every plan.
      on_step: called at every control step; may raise to end the drive.

    Raises:
      ConfigError: the order is of less than one step.
      LinkError: the robot is another one, measures in other units, or is lost before the first step.
      ModelError: likewise for the controller: its commands have a wrong shape, or its model
        diverged.
    """
    link.info.check_is(robot)
    link.reset(order.seed)
    first = link.info.check(link.observe())
    _check_size(first.points, robot)
    seen = without_gaps(first.points)
    task = task_of(seen)
    steps = steps_of(order, task, link.info.period)
    log = EpisodeLog(robot, link.info.period, steps, reckoning, dataset=dataset)
    log.see(_observation(first), 0)
    controller.reset(task, order.seed)
    going = _Going(log, Planner(controller, log, lead), task, seen)
    ended, why = _to_the_end(link, going, first, steps, on_step)
    return Drive(_episode(going, order), ended, why, going.planner.late, going.skipped)


def replayed(
    link: ReplayedLink, robot: Robot, episode_id: str, provenance: Provenance, reckoning: Reckoning
) -> Drive:
    """Reconstruct a drive from its transcript up to the end of that, e.g. if the driver was killed.

    Args:
      link: the transcript, from its beginning.
      robot: of its MJCF.
      episode_id, provenance: of the episode.
      reckoning: of winches that are not measured.

    Raises:
      LinkError: it is of another robot, or ends before the first step.
    """
    seconds = max(link.seconds, link.info.period)
    order = EpisodeOrder(episode_id, provenance, seconds, link.coming(Reset).seed)
    return drive(link, robot, _Recorded(link), lambda points: None, order, reckoning=reckoning)


class _Recorded:
    """A controller that repeats the commands of a transcript."""

    name, model, history = "recorded", "", 0

    def __init__(self, link: ReplayedLink) -> None:
        self._link = link

    def reset(self, task: Task | None, seed: int) -> None:
        """Nothing: recorded commands cannot change."""

    def act(self, past: Past) -> Command:
        """The next recorded command.

        Raises:
          LinkError: the transcript has ended.
        """
        return Command(np.array([self._link.coming(Send).controls]))


def _to_the_end(
    link: RobotLink, going: _Going, first: Sample, steps: int, on_step: OnStep | None
) -> tuple[Ending, str]:
    """Drive, whatever ends it, and hold still; the ending, and the message if something failed."""
    try:
        return _go(link, going, first, steps, on_step), ""
    except (LinkError, ModelError) as error:
        if not going.log.done:
            raise
        return "lost" if isinstance(error, LinkError) else "failed", str(error)
    except KeyboardInterrupt:
        if not going.log.done:
            raise
        return "stopped", ""
    finally:
        _hold_still(link)
        going.planner.close()


def _go(
    link: RobotLink, going: _Going, sample: Sample, steps: int, on_step: OnStep | None
) -> Ending:
    log, dt, begun = going.log, link.info.period, sample.time
    valid = min(link.info.dead_man, max(VALID, LEAST_PERIODS * dt))
    newest = -1
    while log.done < steps and not going.reached:
        control = np.clip(going.planner.command(), link.info.control_low, link.info.control_high)
        link.send(control, sample.time + valid)
        sample = link.info.check(link.observe())
        passed = round((sample.time - begun) / dt) - log.done
        if passed < 1:
            raise LinkError(f"The robot's clock is stopped at {sample.time:.3f} s.")
        if passed * dt > BLIND:
            raise LinkError(
                f"The robot's clock went on by {passed * dt:g} s between two measurements, to "
                f"{sample.time:g} s: it is not in seconds, or this computer stood still."
            )
        passed = min(passed, steps - log.done)
        going.skipped += passed - 1
        log.command(_obeyed(control, passed, valid, dt, log.robot))
        row = round((sample.stamp - begun) / dt)
        if newest < row <= log.done and row > 0:
            log.see(_observation(sample), row)
            newest = row
            going.last_row = row if sample.valid.any() else going.last_row
            going.last_seen = np.where(sample.valid[:, None], sample.points, going.last_seen)
            if going.task is not None:
                _arrive(going, sample)
        if (log.done - going.last_row) * dt > BLIND:
            raise LinkError(
                f"No point of the robot was measured for {BLIND:g} s; its newest stamp is "
                f"{sample.stamp:.3f} s, at {sample.time:.3f} s of its clock."
            )
        if on_step is not None:
            on_step(log.done, sample)
    return "goal" if going.reached else "time"


def _check_size(points: Floats, robot: Robot) -> None:
    """Reject a robot whose measured points (P, 3) are in other units, or in another order.

    Raises:
      LinkError: distances on its bodies are usually those of a robot of another size.
    """
    rods = pairs(robot)
    ratio = median(distances(points, rods) / np.array([rod.distance for rod in rods]))
    if ratio > OTHER_SIZE or ratio < 1 / OTHER_SIZE:
        raise LinkError(
            f"Measured points on one body are usually {ratio:.4g} times as far apart as in the MJCF of "
            f"{robot.name}; they must be in metres, and in its order."
        )


def _arrive(going: _Going, sample: Sample) -> None:
    """Start the next task if the goal is reached, or end the drive."""
    task = going.task
    assert task is not None
    if not task.reached(sample.points):
        return
    if task.then is None:
        going.reached = True
        return
    going.task = task.then
    going.planner.begin(task.then)


class Planner:
    """Requests commands from a controller: when they are needed, or ahead of time in a thread.

    Args:
      controller: source of the commands.
      log: of the episode.
      lead: control steps ahead of which a plan is requested; 0 to wait for it.
    """

    def __init__(self, controller: Controller, log: EpisodeLog, lead: int = 0) -> None:
        self._controller, self._log, self._lead = controller, log, lead
        self._thread = ThreadPoolExecutor(1) if lead else None
        self._asked: Future[Command] | None = None
        hold = log.robot.holding(log.past().winch[0, -1])
        self._plan, self._begin, self._next = np.repeat(hold[None], lead, axis=0), 0, lead
        self._tasks = 0
        self.late = 0
        self.commands: dict[float, Command] = {}

    def begin(self, task: Task) -> None:
        """Plan for another task from the next plan on."""
        if self._asked is not None:
            self._asked.result()  # it may still plan for the task before
        self._tasks += 1
        self._controller.reset(task, self._tasks)

    def command(self) -> Floats:
        """The command (W,) of the next control step.

        Raises:
          ModelError: the controller's commands do not fit, or its model diverged.
        """
        now = self._log.done
        if self._thread is None:
            if now >= self._next:
                self._take(self._controller.act(self._log.past()), now)
        else:
            self._ask_ahead(now, self._thread)
        return self._at(now)

    def close(self) -> None:
        """Wait for the plan in progress, and discard it."""
        if self._thread is not None:
            self._thread.shutdown(wait=True, cancel_futures=True)

    def _ask_ahead(self, now: int, thread: ThreadPoolExecutor) -> None:
        if self._asked is not None and now >= self._next and self._asked.done():
            self.late += now > self._next
            self._take(self._asked.result(), self._next)
            self._asked = None
        if self._asked is None and now >= self._next - self._lead:
            self._next = max(self._next, now + self._lead)
            planned = np.array([self._at(step) for step in range(now, self._next)])
            self._asked = thread.submit(self._controller.act, self._log.past(planned=planned))

    def _take(self, command: Command, begin: int) -> None:
        controls = checked_controls(command.controls, self._controller.name, self._log.robot)
        self.commands[begin * self._log.dt] = command
        self._begin, self._next = begin, begin + len(controls)
        tail = controls[:0] if command.tail is None else command.tail
        self._plan = np.concatenate([controls, tail])

    def _at(self, step: int) -> Floats:
        """(W,) of a control step by the plan; holding commands after its last one."""
        row = step - self._begin
        return self._plan[row] if row < len(self._plan) else self._log.robot.holding(self._plan[-1])


def _obeyed(control: Floats, passed: int, valid: float, dt: float, robot: Robot) -> Floats:
    """(passed, W) commands executed while control periods passed: holding ones after `valid` [s]."""
    still = robot.holding(control)
    return np.array([control if row * dt < valid - 1e-9 else still for row in range(passed)])


def _observation(sample: Sample) -> Observation:
    return Observation(sample.points[None, None], sample.winch[None, None])


def without_gaps(points: Floats) -> Floats:
    """Points (P, 3), with the mean of the visible ones in place of missing ones."""
    seen = np.asarray(np.isfinite(points).all(axis=-1))
    middle = points[seen].mean(axis=0) if seen.any() else np.zeros(3)
    return np.where(seen[:, None], points, middle)


def _hold_still(link: RobotLink) -> None:
    try:
        link.stop()
    except LinkError:
        return  # it holds still by itself once the last command is not valid any more


def _episode(going: _Going, order: EpisodeOrder) -> Episode:
    log, task = going.log, going.task
    outcome = None
    if task is not None:
        distance = float(task.distance(going.last_seen))
        outcome = Outcome(going.reached, log.done * log.dt, distance)
    telemetry = telemetry_of(going.planner.commands) if going.planner.commands else {}
    telemetry |= {
        "late_plans": np.array([going.planner.late]),
        "skipped": np.array([going.skipped]),
    }
    return Episode(order.id, log.trajectory(), order.provenance, order.split, outcome, telemetry)
