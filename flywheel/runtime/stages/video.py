"""Videos of episodes, sped up, filmed from their stored states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flywheel.dynamics.plant import Scenery
from flywheel.dynamics.plant.render import render_episode, usual_shot
from flywheel.files import file_name
from flywheel.records import Plans
from flywheel.runtime.results import IterationResult
from flywheel.runtime.run.context import Run
from flywheel.runtime.run.folder import name_of
from flywheel.runtime.workers.episode_plan import EpisodePlan, evaluation
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.tasks import Task
from flywheel.terrain import Terrain

FPS = 20
SPEED = 4  # times real time
SIZE = (640, 368)


def scenery_of(task: Task, terrain: Terrain | None) -> Scenery:
    """The obstacles, goal and ground around the robot in a task."""
    return Scenery(task.obstacles, task.last_goal, task.tolerance, terrain)


def _hastened(plans: Plans | None, times: float) -> Plans | None:
    """The plans of an episode for a video that is `times` as fast."""
    return None if plans is None else replace(plans, begins=plans.begins / times)


def filmed(run: Run, result: IterationResult) -> IterationResult:
    """The result with a video of its first evaluation episode, if the configuration asks for one."""
    if result.navigation is None:
        return result
    plans = evaluation(run.config, result.iteration, result.arm)
    name = name_of(result.iteration, result.arm)
    return result.model_copy(update={"video": film(run, plans, name)})


def film(run: Run, plans: Sequence[EpisodePlan], name: str) -> str:
    """Make a video of the first of these episodes that is in the store.

    A machine that cannot render makes no video, and the run goes on.

    Returns:
      Path in the run folder; "" without a video.
    """
    there = run.store.committed() if run.config.evaluate.video else ()
    plan = next((plan for plan in plans if plan.id in there), None)
    if plan is None:
        return ""
    path = f"videos/{file_name(name)}.mp4"
    task, episode = EpisodeRecorder(run.config, run.robot).task(plan), run.store.read(plan.id)
    trajectory = episode.trajectory
    if task is None or trajectory.states is None:
        return ""
    scenery = scenery_of(task, episode.terrain)
    stride = max(1, round(SPEED / FPS / trajectory.dt))
    try:
        render_episode(
            run.robot,
            trajectory.states[::stride],
            run.folder.path / path,
            scenery,
            FPS,
            dt=1.0 / FPS,
            shot=replace(usual_shot(scenery), size=SIZE),
            plans=_hastened(episode.plans, stride * trajectory.dt * FPS),
        )
    except Exception as error:  # whatever a graphics driver throws
        run.progress.say(f"No video {path}: {error}")
        return ""
    return path
