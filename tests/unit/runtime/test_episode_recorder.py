"""What episodes begin with, and do, follows from their seeds."""

import dataclasses
from typing import ClassVar

import numpy as np
import pytest

from flywheel.control import MppiConfig
from flywheel.dynamics.plant import PlantDynamics, PlantParameters
from flywheel.effects import WrittenTerm
from flywheel.errors import DataError
from flywheel.records import Floats, Past, Rollout
from flywheel.robots import Box, TerrainConfig, load_course, load_robot
from flywheel.runtime.config.parts import CollectConfig, DataSet, EvaluateConfig
from flywheel.runtime.config.run_config import RunConfig
from flywheel.runtime.workers.episode_plan import EpisodePlan, collection, unseen, unseen_ceiling
from flywheel.runtime.workers.episode_recorder import EpisodeRecorder
from flywheel.runtime.workers.stored_episodes import EpisodeWinches
from flywheel.tasks import TaskConfig
from tests import draws

SECONDS = 8.0  # the first target takes about 3


def gaits_of_one_kind(seed: int) -> list[Floats]:
    """Measured points (T, P, 3) of all rolls on the same plant."""
    collect = CollectConfig(gaits=6, gait_seconds=SECONDS, validation=0.2, test=0.2)
    config = RunConfig(seed=seed, collect=collect, datasets=(DataSet(),))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    plans = [p for p in collection(config, 0, "mppi") if p.controller == "gait:roll"]
    episodes = [recorder.record(p, None, "") for p in plans]
    return [e.trajectory.observations.points[0] for e in episodes]


@pytest.mark.slow
def test_gaits_of_the_same_kind_on_the_same_plant_are_different_motions():
    """Else the episodes kept for tests are trained on."""
    seed = draws.seed()
    first, second = gaits_of_one_kind(seed)
    pairs = np.triu_indices(first.shape[1], 1)
    spans = [np.linalg.norm(p[:, pairs[0]] - p[:, pairs[1]], axis=-1) for p in (first, second)]
    start, end = slice(0, 100), slice(-300, None)
    assert np.ptp(first[end].mean(1), axis=0).max() > 0.05, "it does not walk"
    for part in (start, end):  # however one is turned and shifted, it is not the other
        assert np.abs(spans[0][part] - spans[1][part]).max() > 0.02, (seed, part)


def test_winches_of_episodes_are_where_what_is_known_of_their_plant_says() -> None:
    """Simulated ones tell what that was; of a recording it is what has been adopted so far."""
    strong = WrittenTerm(effect="winch_gain", parameters={"share": 0.2})
    collect = CollectConfig(gaits=0, random=6, random_seconds=2.0, validation=0.2, test=0.2)
    config = RunConfig(collect=collect, seed=draws.seed())
    robot = load_robot(config.model)
    episode = EpisodeRecorder(config, robot).record(
        collection(config, 0, "mppi", (strong,))[0], None, ""
    )
    about = dataclasses.replace(episode.provenance, source="recording", effects={})
    log = dataclasses.replace(episode, id="log", provenance=about)
    truth = robot.winch_of(episode.trajectory.states)
    nothing, adopted = EpisodeWinches(robot), EpisodeWinches(robot, (strong,))
    assert np.abs(nothing(log) - truth).max() > 0.01
    for known in (nothing(episode), adopted(episode), adopted(log)):
        assert np.allclose(known, truth, atol=1e-6)
    assert nothing.effects_digest == "" and adopted.effects_digest
    weaker = WrittenTerm(effect="winch_gain", parameters={"share": 0.1})
    assert adopted.effects_digest != EpisodeWinches(robot, (weaker,)).effects_digest


def test_winches_of_a_data_set_turn_as_fast_as_its_plant_says() -> None:
    slow = DataSet(name="slow", plant=PlantParameters(winch_speed=0.9))
    collect = CollectConfig(gaits=0, random=6, random_seconds=2.0, validation=0.2, test=0.2)
    config = RunConfig(collect=collect, datasets=(DataSet(), slow))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    for plan in collection(config, 0, "mppi")[:2]:
        episode = recorder.record(plan, None, "")
        truth = recorder.robot.winch_of(episode.trajectory.states)
        assert np.allclose(EpisodeWinches(recorder.robot)(episode), truth, atol=1e-6), plan.dataset


class Told(PlantDynamics):
    """The plant, which remembers which winch positions it was told, and where they were."""

    pairs: ClassVar[list[tuple[Floats, Floats]]] = []

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        self.pairs.append((past.winch[0, -1], self.robot.winch_of(past.state)[0]))
        return super().rollout(past, controls)


def test_a_planner_is_told_where_the_winches_are() -> None:
    strong = WrittenTerm(effect="winch_gain", parameters={"share": 0.2})
    config = RunConfig(collect=CollectConfig(mppi=3), task=TaskConfig(seconds=2.0))
    robot = load_robot(config.model)
    dynamics = Told(EpisodeRecorder(config, robot).plant(0))
    plan = next(p for p in collection(config, 1, "mppi", (strong,)) if p.controller == "mppi")
    plan = dataclasses.replace(plan, samples=4, seconds=2.0)
    EpisodeRecorder(config, robot).record(plan, dynamics, "")
    known, truth = (np.stack(each) for each in zip(*Told.pairs, strict=True))
    assert np.ptp(truth, axis=0).max() > 0.05
    assert np.allclose(known - truth, known[0] - truth[0], atol=1e-6)


def test_episodes_are_recorded_with_the_run_s_effects() -> None:
    heavy = WrittenTerm(effect="winch_gain", parameters={"share": -0.5})
    collect = CollectConfig(gaits=0, random=6, random_seconds=2.0, validation=0.2, test=0.2)
    plain = RunConfig(collect=collect)
    slow = plain.model_copy(update={"effects": (heavy,)})
    robot = load_robot(plain.model)
    one, other = (
        EpisodeRecorder(config, robot).record(plan, None, "")
        for config in (plain, slow)
        for plan in collection(config, 0, "mppi", config.effects)[:1]
    )
    assert other.provenance.effects == {"winch_gain": {"share": -0.5}}
    assert one.provenance.effects == {}
    moved = [np.ptp(e.trajectory.states.act, axis=0).max() for e in (one, other)]
    assert 0.3 * moved[0] < moved[1] < 0.9 * moved[0]


class CountsPlans(PlantDynamics):
    """The plant as a model, which remembers how many plans it was asked to try."""

    asked = 0

    def rollout(self, past: Past, controls: Floats) -> Rollout:
        CountsPlans.asked = max(CountsPlans.asked, len(controls))
        return super().rollout(past, controls)


@pytest.mark.slow
def test_mppi_tries_as_many_plans_as_its_episode_asks_for() -> None:
    config = RunConfig()
    recorder, counts = EpisodeRecorder(config, load_robot(config.model)), []
    for samples in (5, None):
        plan = EpisodePlan("one", "mppi", 1, "train", 0.5, seed=1, task_seed=1, samples=samples)
        CountsPlans.asked = 0
        recorder.record(plan, CountsPlans(recorder.plant(0)), "")
        counts.append(CountsPlans.asked)
    assert counts == [5, config.mppi.samples]


def test_an_obstacle_course_begins_at_its_start_among_its_walls() -> None:
    seed = draws.seed()
    config = RunConfig(task=TaskConfig(name="obstacle_course", course="maze"))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    plan = EpisodePlan("one", "random", 0, "test", 1.0, seed=seed, task_seed=seed)
    task = recorder.task(plan)
    assert task is not None and task.begin is not None
    episode = recorder.record(plan, None, "")
    points = recorder.plant(0).observe(episode.trajectory.states).points
    assert task.place(points[0]) == pytest.approx(task.begin.place, abs=1e-6), seed
    speeds = np.diff(points[:5], axis=0) / episode.trajectory.dt
    assert np.abs(speeds).max() < 0.3 * recorder.robot.length, (
        seed
    )  # it stands there, it does not fall
    assert np.linalg.norm(task.place(points[0]) - load_course("maze").start) < 0.6 * 2.95


@pytest.mark.parametrize("kind", ["slope", "bumps", "steps"])
@pytest.mark.parametrize("controller", ["random", "drop", "gait:roll"])
def test_episodes_begin_and_stay_on_their_own_ground(kind: str, controller: str) -> None:
    seed = draws.seed()
    config = RunConfig(terrain=TerrainConfig(kinds=(kind,)))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    plan = EpisodePlan("one", controller, 0, "train", 4.0, seed=seed)
    episode = recorder.record(plan, None, "")
    assert episode.terrain is not None and episode.terrain == recorder.terrain(plan)
    points = episode.trajectory.observations.points
    heights, normals = episode.terrain.at(points[..., :2])
    radii = np.array([point.radius for point in recorder.robot.points])
    gaps = (points[..., 2] - heights) * normals[..., 2] - radii
    lowest = gaps.min(axis=1)
    assert lowest.min() > -0.1, seed  # caps sink into an edge that they lie across
    assert lowest[-1] < 0.1, seed


def test_boxes_of_the_run_and_of_a_task_stand_in_its_episodes() -> None:
    wall = Box(center=(30.0, 0.0, 1.0), half_size=(1.0, 5.0, 1.0))
    terrain, course = TerrainConfig(boxes=(wall,)), load_course("maze")
    config = RunConfig(terrain=terrain, task=TaskConfig(name="obstacle_course", course="maze"))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    dropped = recorder.record(EpisodePlan("one", "drop", 0, "train", 0.1, seed=1), None, "")
    assert dropped.terrain is not None and dropped.terrain.boxes == (wall,)
    plan = EpisodePlan("two", "mppi", 0, "test", 0.1, seed=1, task_seed=1)
    plant = recorder.plant(0, task=recorder.task(plan), terrain=recorder.terrain(plan))
    assert plant.terrain is not None and plant.terrain.boxes == (wall, *course.obstacles)


def test_a_task_has_the_same_ground_whoever_plans_for_it() -> None:
    config = RunConfig(terrain=TerrainConfig(kinds=("bumps",)))
    recorder = EpisodeRecorder(config, load_robot(config.model))
    first, second = (
        EpisodePlan(name, "mppi", 1, "test", 4.0, seed=seed, task_seed=7)
        for name, seed in (("a", 1), ("b", 2))
    )
    assert recorder.terrain(first) == recorder.terrain(second) is not None


def test_what_is_hidden_is_in_the_plant_and_in_nobody_s_head() -> None:
    """A planner reckons with the winches that it was told of."""
    told = WrittenTerm(effect="winch_gain", parameters={"share": 0.2})
    real = WrittenTerm(effect="winch_gain", parameters={"share": -0.3})
    collect = CollectConfig(gaits=0, random=6, random_seconds=1.0, validation=0.2, test=0.2)
    config = RunConfig(collect=collect, seed=draws.seed())
    recorder = EpisodeRecorder(config, load_robot(config.model))
    plan = collection(config, 0, "mppi", (told,))[0]
    stand_in = dataclasses.replace(plan, hidden=(real,))
    hidden = recorder.record(stand_in, None, "")
    went = hidden.trajectory
    again = {
        (effects, fineness): recorder.plant(plan.dataset, effects, fineness=fineness)
        .simulate(went.states[:1], went.controls[None])
        .states.qpos[0]
        for effects, fineness in (((real,), stand_in.fineness), ((real,), 1), ((told,), 1))
    }
    same = {key: np.array_equal(went.states.qpos, qpos) for key, qpos in again.items()}
    assert same == {((real,), 4): True, ((real,), 1): False, ((told,), 1): False}
    assert hidden.provenance.effects == {"winch_gain": {"share": -0.3}}
    assert plan.fineness == 1


def test_an_episode_of_another_run_is_not_taken_for_its_own() -> None:
    collect = CollectConfig(gaits=0, random=6, random_seconds=0.2, validation=0.2, test=0.2)
    mine, other = (RunConfig(collect=collect, seed=seed) for seed in (1, 2))
    episode = EpisodeRecorder(mine, load_robot(mine.model)).record(
        collection(mine, 0, "mppi")[0], None, ""
    )
    EpisodeRecorder(mine, load_robot(mine.model)).check_own(episode)
    with pytest.raises(DataError, match="its own store"):
        EpisodeRecorder(other, load_robot(other.model)).check_own(episode)


def test_an_unseen_course_takes_the_place_of_the_task() -> None:
    config = RunConfig(model="icosa6", task=TaskConfig(seconds=1.0))
    recorder, course = EpisodeRecorder(config, load_robot("icosa6")), load_course("maze")
    for plan in (*unseen(config, "maze"), *unseen_ceiling(config, "maze")):
        task = recorder.task(plan)
        assert task.obstacles == course.obstacles
        assert np.linalg.norm(task.last_goal - course.goals[-1]) <= config.task.spread * 2.95
        assert task.seconds == 1.0
    plan = dataclasses.replace(unseen_ceiling(config, "maze")[0], seconds=0.5)
    recorder = EpisodeRecorder(
        config.model_copy(update={"mppi": MppiConfig(samples=2)}), recorder.robot
    )
    assert recorder.record(plan, None, "").provenance.task == "obstacle_course"


def test_unseen_courses_that_cannot_be_read_are_refused_before_a_run_begins() -> None:
    with pytest.raises(ValueError, match="maze"):
        EvaluateConfig(unseen=("mase",))
    with pytest.raises(ValueError, match="There is no course nowhere.xml"):
        EvaluateConfig(unseen=("nowhere.xml",))


@pytest.mark.parametrize("controller", ["random", "gait:cw", "drop"])
def test_an_episode_by_a_box_is_among_those_of_its_course(controller: str) -> None:
    robot = load_robot("prism3")
    recorder = EpisodeRecorder(RunConfig(), robot)
    boxes = load_course("low_clearance").obstacles
    found = []
    for seed in (0, 1):
        plan = EpisodePlan("one", controller, 0, "train", 0.5, seed, course="low_clearance")
        episode = recorder.record(plan, None, "")
        assert episode.terrain is not None and episode.terrain.boxes == boxes
        first = episode.trajectory.observations.points.reshape(-1, 6, 3)[0]
        gaps = [np.linalg.norm(np.maximum(b.beyond(first), 0), axis=1).min() for b in boxes]
        assert min(gaps) < 1.5 * robot.length
        found.append(first)
    assert np.abs(found[0] - found[1]).max() > 0.1
