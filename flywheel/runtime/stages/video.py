"""Videos of episodes, sped up: from their stored states, or from measurements on a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flywheel.dynamics.plant import Scenery, states_of
from flywheel.dynamics.plant.render import Film, usual_shot
from flywheel.files import file_name
from flywheel.records import Plans, State
from flywheel.results import IterationResult, RobotResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.workers.episode_plan import EpisodePlan, evaluation, robot_drives
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder, RobotRecorder
from flywheel.smoothing import savitzky_golay
from flywheel.tasks import Task
from flywheel.terrain import Terrain, with_boxes

FPS = 20
SPEED = 4  # times real time
SIZE = (640, 368)
SMOOTHED = 0.1  # length of the parabolas that take noise out of measured points [s]


def scenery_of(task: Task, terrain: Terrain | None) -> Scenery:
    """The obstacles, goal and ground around the robot in a task."""
    return Scenery(task.last_goal, task.tolerance, with_boxes(terrain, task.obstacles))


def _hastened(plans: Plans | None, times: float) -> Plans | None:
    """The plans of an episode for a video that is `times` as fast."""
    return None if plans is None else replace(plans, begins=plans.begins / times)


def filmed(run: Run, result: IterationResult) -> IterationResult:
    """The result with a video of one of its episodes to a goal, if the configuration asks for one."""
    name = name_of(result.iteration, result.arm)
    if result.robot is not None:
        planner, video = _film_robot(run, result, result.robot, name)
        robot = result.robot.model_copy(update={"filmed": planner})
        return result.model_copy(update={"video": video, "robot": robot})
    if result.navigation is None:
        return result
    plans = evaluation(run.config, result.iteration, result.arm)
    return result.model_copy(update={"video": film(run, plans, name)})


def film(run: Run, plans: Sequence[EpisodePlan], name: str) -> str:
    """Make a video of the first of these episodes that is in the store.

    A machine that cannot render makes no video, and the run continues.

    Returns:
      Path in the run folder; "" without a video.
    """
    if (plan := _first(run, plans)) is None:
        return ""
    task, episode = EpisodeRecorder(run.config, run.robot).task(plan), run.store.read(plan.id)
    trajectory = episode.trajectory
    if task is None or trajectory.states is None:
        return ""
    stride = _stride(trajectory.dt)
    hastened = _hastened(episode.plans, stride * trajectory.dt * FPS)
    scenery = scenery_of(task, episode.terrain)
    return _rendered(run, trajectory.states[::stride], scenery, name, hastened)


def _film_robot(
    run: Run, result: IterationResult, robot: RobotResult, name: str
) -> tuple[str, str]:
    """Make a video of a measured drive with the planner that reached most goals.

    It is the first that reached its goal, if one did.

    Returns:
      The planner, and the path in the run folder; both "" without a video.
    """
    if not robot.drives:
        return "", ""
    planner = max(robot.drives, key=lambda name: robot.drives[name].success.reached)
    reached = {walk.seed for walk in robot.drives[planner].walks if walk.reached}
    plans = robot_drives(run.config, result.iteration, planner, run.effects(result.iteration))
    plan = _first(run, sorted(plans, key=lambda plan: plan.seed not in reached))
    if plan is None:
        return "", ""
    episode = run.store.read(plan.id)
    trajectory, dt = episode.trajectory, episode.trajectory.dt
    observed, task = (
        trajectory.observations,
        RobotRecorder(run.config, run.robot).task(plan, episode),
    )
    if task is None:
        return "", ""
    points, _ = savitzky_golay(observed.points, dt, SMOOTHED)
    winch = run.robot.known_winch(observed.winch, trajectory.controls, dt)
    stride = _stride(dt)
    states = states_of(run.robot, dt, points[::stride], winch[::stride])
    video = _rendered(run, states, scenery_of(task, None), name, None)
    return (planner, video) if video else ("", "")


def _first(run: Run, plans: Sequence[EpisodePlan]) -> EpisodePlan | None:
    """The first of these episodes that is in the store; None if no video is asked for."""
    there = run.store.committed() if run.config.evaluate.video else ()
    return next((plan for plan in plans if plan.id in there), None)


def _stride(dt: float) -> int:
    """Control steps from one picture to the next."""
    return max(1, round(SPEED / FPS / dt))


def _rendered(run: Run, states: State, scenery: Scenery, name: str, plans: Plans | None) -> str:
    path = f"videos/{file_name(name)}.mp4"
    try:
        shot = replace(usual_shot(scenery), size=SIZE)
        film = Film(run.robot, states, scenery, FPS, dt=1.0 / FPS, shot=shot, plans=plans)
        film.write(run.folder.path / path)
    except Exception as error:  # whatever a graphics driver throws
        run.progress.say(f"No video {path}: {error}")
        return ""
    return path
