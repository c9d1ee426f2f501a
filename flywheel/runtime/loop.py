"""The loop: a whole run, from an empty folder or from its last state, to its final result."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flywheel.data import TrajectoryStore
from flywheel.data.places import local_folder
from flywheel.errors import ConfigError
from flywheel.outputs import check_folder
from flywheel.reports import write_report
from flywheel.results import RESULT_FILE, ErrorNumbers, IterationResult, RobotResult, RunResult
from flywheel.robots import Robot
from flywheel.run_identity import Identity
from flywheel.runtime.config.parts import WorkersConfig
from flywheel.runtime.config.run_config import RunConfig, continued
from flywheel.runtime.pool.interrupts import Interrupted, StopRequest
from flywheel.runtime.pool.jobs import Group
from flywheel.runtime.pool.lock import hold
from flywheel.runtime.pool.pool import Patience, WorkerPool
from flywheel.runtime.pool.progress import Progress, Quiet
from flywheel.runtime.pool.ray_backend import Cluster, RayBackend
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import RunFolder
from flywheel.runtime.run.inventory import check_sound
from flywheel.runtime.run.provenance import end_rests_on, keep, result_so_far
from flywheel.runtime.run.publish import Page
from flywheel.runtime.run.suitability import check_new, check_reached
from flywheel.runtime.stages import (
    Iteration,
    collect,
    decide,
    diagnose,
    evaluate,
    record,
    snapshot,
    train,
)
from flywheel.runtime.stages.final_evaluation import evaluate_finally
from flywheel.runtime.stages.on_robot import score_finally
from flywheel.runtime.stages.video import filmed
from flywheel.runtime.tracking.dashboard import DATABASE, database_uri
from flywheel.runtime.tracking.mlflow_client import Board
from flywheel.runtime.tracking.tracker import Tracker
from flywheel.runtime.workers.robot_worker import RobotWorker
from flywheel.runtime.workers.sim_worker import SimWorker
from flywheel.runtime.workers.trainer_worker import TrainerWorker
from flywheel.validation import differences

OVERBOOKED = 16  # most configured cores per core of this machine; each is a process of about 300 MB
# Longest that the tracker may deliver when a run ends early; a resumed run delivers the rest.
EARLY_END_DELIVERY_SECONDS = 3.0


def run(
    config: RunConfig,
    folder: str | Path,
    *,
    resume: bool = False,
    address: str | None = None,
    tracked: bool = True,
    progress: Progress = Quiet(),
) -> RunResult:
    """Run `config.iterations` iterations after iteration 0.

    Args:
      config: of the run.
      folder: of the run; made if it is missing.
      resume: continue the run in the folder, or start one if there is none.
      address: of an existing Ray cluster; by default a local one is started.
      tracked: publish the results at MLflow, and write the page of the run.
      progress: display for people.

    Raises:
      ConfigError: the folder is in use, not writable, contains a run although `resume` is false, or
        contains a run of another configuration; the robot cannot do the run; the cluster is too
        small; or the GPU that it asks for is not there.
      RobotError: the MJCF cannot be used.
      RunError: the run cannot continue, or its files were changed since it stopped; the message
        says why. Finished work is kept.
      Interrupted: the user asked to stop.
    """
    local_cores = cores_of(config.workers, address)
    files = RunFolder(Path(folder).absolute())
    check_folder(files.path, "folder of the run", ConfigError)
    _check_store(files.store_url(config))
    if tracked and not config.tracking.uri:
        database_uri(files.path / DATABASE)  # refused before anything is there
    if not files.config_file.exists():  # a run that is refused leaves nothing
        check_new(config, address)
    files.path.mkdir(parents=True, exist_ok=True)
    with hold(files.lock, f"The run in {folder}"):
        identity = files.begin(config, resume)
        config = _from_here_on(files.config(), config, progress)
        robot = files.robot(config)
        check_sound(files, TrajectoryStore(files.store_url(config)))
        if (done := finished_run(files)) is not None:
            with _tracking(config, files, robot, tracked, progress) as tracker:
                if tracker is not None:  # delivers what is waiting
                    tracker.show(done)
                return done
        files.check_space(config.workers.least_free_gb)
        check_reached(config, robot, address)
        progress.say(f"The run is in {folder}. Ctrl-C stops it; --resume continues it.")
        with (
            Cluster(address, local_cores) as ray,
            StopRequest() as stop,  # after Ray, which catches signals, too
            _tracking(config, files, robot, tracked, progress) as tracker,
        ):
            cores = config.workers.cores or ray.cpus
            with _pool(config, files, robot, ray, cores, stop) as pool:
                store = TrajectoryStore(files.store_url(config))
                return finish(Run(config, files, robot, store, pool, tracker, progress), identity)


def _from_here_on(stored: RunConfig, given: RunConfig, progress: Progress) -> RunConfig:
    """The configuration with which a run continues, and a line per setting that is not as at its start."""
    config = continued(stored, given)  # only the robot's workers know the stand-in
    for change in differences(stored.model_dump(mode="json"), config.model_dump(mode="json")):
        progress.say(f"Not as at the start of the run: {change}.")
    return config


def _check_store(url: str) -> None:
    """Reject a store that is nowhere, before anything is there."""
    TrajectoryStore(url)
    if (episodes := local_folder(url)) is not None:
        check_folder(episodes, "store", ConfigError)


def finished_run(files: RunFolder) -> RunResult | None:
    """The result of a finished run; None for an unfinished one."""
    if not (files.path / RESULT_FILE).exists():
        return None
    result = RunResult.load(files.path)
    return result if result.finished else None


def finish(run: Run, identity: Identity) -> RunResult:
    """Complete the unfinished part of a run, and return its result."""
    run.store.sweep()
    result = result_so_far(run, identity, [])
    run.show(result)
    for iteration in range(run.config.iterations + 1):
        problems = run_iteration(run, iteration)
        for problem in problems:
            run.progress.say(problem)
        result = result_so_far(run, identity, problems)
        result.save(run.folder.path)
        run.show(result)
    result = score_finally(run, evaluate_finally(run, result))
    if run.tracker is not None:
        write_report(result, run.folder.path)
    result.save(run.folder.path, end_rests_on(run, result))
    run.show(result)
    return result


@contextmanager
def _pool(
    config: RunConfig, files: RunFolder, robot: Robot, ray: Cluster, cores: int, stop: StopRequest
) -> Iterator[WorkerPool]:
    workers, arguments = config.workers, (config, files.store_url(config), robot)
    both = (config.control_arm and config.iterations) or config.residual.on
    trainers = workers.trainers or (2 if both else 1)
    groups = [
        Group("sim", SimWorker, arguments, workers.sim, threads=config.sim_threads),
        Group(
            "trainer",
            TrainerWorker,
            arguments,
            trainers,
            workers.trainer_cpus,
            workers.trainer_gpus,
            config.training.processes,
        ),
    ]
    if config.robot is not None:
        on_robot = (*arguments, files.robot_folder)
        links, threads = config.robot.links, config.sim_threads
        groups.append(Group("robot", RobotWorker, on_robot, links, 0.0, threads=threads))
    ray.check_fits(groups)
    patience = Patience(workers.start_seconds, workers.stall_seconds, workers.drain_seconds)
    pool = WorkerPool(RayBackend(), groups, cores, patience, stop)
    try:
        yield pool
    finally:
        pool.close()


@contextmanager
def _tracking(
    config: RunConfig, files: RunFolder, robot: Robot, tracked: bool, progress: Progress
) -> Iterator[Tracker[RunResult] | None]:
    """A tracker; at the end of the block the outcome is published, which may take some time."""
    if not tracked:
        yield None
        return
    board = Board(files.path, config.tracking, Path(config.model).stem)
    tracker = Tracker(Page(board, files, (len(robot.points), len(robot.winches))).publish)
    patience = EARLY_END_DELIVERY_SECONDS
    try:
        yield tracker
        patience = config.tracking.close_seconds
    except BaseException as error:
        stopped = isinstance(error, (Interrupted, KeyboardInterrupt))
        tracker.end("KILLED" if stopped else "FAILED")
        raise
    finally:
        if not tracker.close(patience):
            progress.say(
                f"tracking: not everything has reached MLflow ({tracker.problem or 'no time was left'}). "
                f"It is kept in {files.path}; the same command with --resume delivers it."
            )


def cores_of(workers: WorkersConfig, address: str | None) -> int:
    """The cores of a local cluster: as configured, or all that this process may use.

    Raises:
      ConfigError: this machine has far fewer than configured, and no cluster's address is given.
    """
    there = len(os.sched_getaffinity(0))
    cores = workers.cores or there
    if address is None and cores > OVERBOOKED * there:
        raise ConfigError(
            f"workers.cores is {cores:,}, this machine has {there}; at most {OVERBOOKED * there} "
            "are allowed here. Give the address of a cluster with --address."
        )
    return cores


def run_iteration(run: Run, number: int) -> list[str]:
    """Do one iteration in every arm that has not completed it.

    Returns:
      Sentences about problems in the iteration.
    """
    arms = [arm for arm in run.arms(number) if run.folder.finished(number, arm) is None]
    if not arms:
        return []
    latest = {arm: run.latest(arm) for arm in arms}
    models = {arm: run.model_of(each) for arm, each in latest.items() if each is not None}
    iteration = Iteration(number, latest, models)
    if run.config.diagnose.on and number:
        with iteration.timed("diagnose"):
            iteration.diagnosis = diagnose(run, iteration)
    iteration.effects = run.effects(number)
    with iteration.timed("collect"):
        collected = collect(run, iteration, arms)
    with iteration.timed("snapshot"):
        outcomes = snapshot(run, iteration, collected)
    with iteration.timed("train"):
        outcomes = train(run, iteration, outcomes)
    with iteration.timed("evaluate"):
        outcomes = evaluate(run, iteration, outcomes)
    outcomes = decide(run, iteration, outcomes)
    for result in record(run, iteration, outcomes):
        keep(run, filmed(run, result))
        run.progress.say(summary(result))
    return iteration.problems


def summary(result: IterationResult) -> str:
    """One line about an iteration, for people."""
    words = [f"iteration {result.iteration}"]
    if result.arm != "mppi":
        words[0] += f" ({result.arm} arm)"
    words.append(f"{result.episodes} episodes")
    if result.test is not None:
        words.append(f"test {_errors(result.test.short)}")
    if result.recordings is not None:
        words.append(f"recordings {_errors(result.recordings.short)}")
    if result.diagnosis is not None:
        words.append(f"diagnosis: {result.diagnosis.reason}")
    if result.robot is not None:
        words.append(_on_robot(result.robot))
    elif result.navigation is not None:
        success = result.navigation.success
        words.append(f"{success.reached} of {success.total} goals reached")
    if result.gate is not None:
        words.append(result.gate.reason)
    return "; ".join(words)


def _on_robot(robot: RobotResult) -> str:
    """Results of an iteration on the robot."""
    errors = ", ".join(
        f"{name} {each.short.e_pos_rmse:.2f} %" for name, each in robot.errors.items()
    )
    noise = "" if robot.noise is None else f" (noise {robot.noise.e_pos_rmse:.2f} %)"
    goals = ", ".join(
        f"{name} {each.success.reached} of {each.success.total}"
        for name, each in robot.drives.items()
    )
    return (
        f"on the robot after {robot.minutes:.1f} min: e_pos {errors}{noise}; goals reached: {goals}"
    )


def _errors(numbers: ErrorNumbers) -> str:
    rotation = "" if numbers.turnless else f", e_rot {numbers.e_rot:.2f} deg"
    return f"e_pos {numbers.e_pos_rmse:.2f} %{rotation}"
