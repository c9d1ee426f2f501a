import dataclasses

import numpy as np
import pytest

from flywheel.control import (
    Command,
    EpisodeOrder,
    Hold,
    Mppi,
    MppiConfig,
    RandomControls,
    random_drop,
    record_episode,
)
from flywheel.dynamics.plant import (
    EffectivePlant,
    MeasurementModel,
    Plant,
    PlantDynamics,
    PlantParameters,
    Reckoning,
)
from flywheel.dynamics.plant.reckoning import APART
from flywheel.effects import NAMED, Scales, Term
from flywheel.errors import ConfigError, ModelError, RobotError
from flywheel.records import Observation, Past, Provenance
from flywheel.robots import Robot, load_robot
from flywheel.tasks import TaskConfig, sample_task
from tests import draws

DT = 0.01
EXACT = MeasurementModel()
NOISY = MeasurementModel(noise=0.01, dropout=0.1)


@pytest.fixture(scope="module")
def plant(robot: Robot) -> Plant:
    return Plant(robot, DT)


def recorded(plant: Plant, controller, task=None, measurement=EXACT, seconds=1.0, seed=0, **more):
    return record_episode(
        plant,
        measurement,
        controller,
        task,
        EpisodeOrder("one", Provenance(plant.robot.digest), seconds, seed),
        start=plant.rest(),
        **more,
    )


class Spy(RandomControls):
    """Random controls that remember what they were shown."""

    def reset(self, task, seed) -> None:
        super().reset(task, seed)
        self.pasts: list[Past] = []

    def act(self, past: Past) -> Command:
        self.pasts.append(past)
        return Command(super().act(past).controls[:40], plan_seconds=0.25)


def test_an_episode_is_what_the_plant_does_under_its_controls(plant: Plant) -> None:
    episode = recorded(plant, RandomControls(plant.robot, DT), seconds=4.0, seed=3)
    trajectory = episode.trajectory
    assert trajectory.steps == 400
    again = plant.simulate(plant.rest(), trajectory.controls[None])
    np.testing.assert_array_equal(again.states.qpos[0], trajectory.states.qpos)
    np.testing.assert_array_equal(again.states.act[0], trajectory.states.act)
    np.testing.assert_array_equal(again.observations.points[0], trajectory.observations.points)
    assert episode.outcome is None


def test_the_controller_is_shown_all_that_was_measured_so_far(plant: Plant) -> None:
    spy = Spy(plant.robot, DT)
    episode = recorded(plant, spy, measurement=NOISY, seed=draws.seed())
    seen = episode.trajectory.observations
    assert np.isnan(seen.points).any() and np.isnan(seen.winch).all()
    assert [past.history for past in spy.pasts] == [0, 40, 80]
    for past in spy.pasts:
        now = past.history
        np.testing.assert_array_equal(past.observations.points[0], seen.points[: now + 1])
        np.testing.assert_array_equal(past.controls[0], episode.trajectory.controls[:now])
        np.testing.assert_array_equal(past.state.qpos[0], episode.trajectory.states.qpos[now])
    assert episode.telemetry["plan_seconds"].tolist() == [0.25, 0.25, 0.25]
    assert episode.plans is None


def test_unmeasured_winches_are_reckoned_from_the_commands(plant: Plant) -> None:
    spy = Spy(plant.robot, DT)
    episode = recorded(plant, spy, seed=draws.seed())
    truth = plant.winch(episode.trajectory.states)
    for past in spy.pasts:
        assert np.isfinite(past.winch).all()
        np.testing.assert_allclose(past.winch[0], truth[: past.history + 1], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 7, 50])
def test_unmeasured_winches_of_a_known_plant_are_where_its_effects_say(plant: Plant, steps) -> None:
    """However often the controller acts, and whatever the winches carry."""
    effect, scales = NAMED["torque_speed"], Scales.of(plant.robot)
    slow = (Term(effect, None, (3.0 * effect.sizes[0].typical(scales),)),)

    class Often(Spy):
        def act(self, past: Past) -> Command:
            return Command(super().act(past).controls[:steps])

    spy, seed = Often(plant.robot, DT), draws.seed()
    slower = EffectivePlant(Plant(plant.robot), slow)
    reckoning = Reckoning(plant.robot, DT, slow)
    episode = recorded(slower, spy, seconds=3.0, seed=seed, reckoning=reckoning)
    track = episode.trajectory
    truth = slower.winch(track.states)[: spy.pasts[-1].history + 1]
    nominal = plant.robot.dead_reckon(truth[0], track.controls, DT)[: len(truth)]
    known = spy.pasts[-1].winch[0] - spy.pasts[-1].winch[0, 0] + truth[0]
    wrong, off = (np.abs(each - truth).max() for each in (nominal, known))
    assert wrong > 0.03
    assert off < 0.35 * wrong


def test_measured_winches_are_taken_as_measured(plant: Plant) -> None:
    slow = Plant(plant.robot, DT, PlantParameters(winch_speed=0.5))
    spy, blind = Spy(plant.robot, DT), Spy(plant.robot, DT)
    episode = recorded(slow, spy, measurement=MeasurementModel(winch_measured=True), seed=1)
    recorded(slow, blind, seed=1)
    truth = slow.winch(episode.trajectory.states)
    np.testing.assert_allclose(spy.pasts[-1].winch[0], truth[:81], atol=1e-12)
    assert np.abs(blind.pasts[-1].winch[0] - truth[:81]).max() > 0.05


class OneGap(MeasurementModel):
    """Winches are measured 0.2 m too long, but winch 2 not in the first piece after the beginning."""

    def apply(self, truth: Observation, robot: Robot, rng: np.random.Generator) -> Observation:
        winch = np.full((*truth.points.shape[:2], len(robot.winches)), 1.7)
        if truth.points.shape[1] > 1:
            winch[:, 3, 2] = np.nan
        return Observation(truth.points, winch)


def test_a_winch_that_was_not_measured_at_some_step_is_reckoned_for_all(plant: Plant) -> None:
    """Or it would seem to jump where measurements and reckoning meet."""
    spy = Spy(plant.robot, DT)
    recorded(plant, spy, measurement=OneGap(), seed=1)
    first, *later = (past.winch[0] for past in spy.pasts)
    assert (first == 1.7).all()
    for winch in later:
        assert (np.delete(winch, 2, axis=1) == 1.7).all()
        assert winch[0, 2] == 1.7 and np.isfinite(winch).all()
        assert len(np.unique(winch[:, 2])) > 5
        fastest = plant.robot.control_high[2] * DT
        assert np.abs(np.diff(winch[:, 2])).max() <= fastest + 1e-12


@dataclasses.dataclass(frozen=True)
class Looked(Reckoning):
    """Reckons as without loads; every cable is longer at each step that is looked at."""

    looks: list = dataclasses.field(default_factory=list)
    used: list = dataclasses.field(default_factory=list)
    loaded = True

    def lengths(self, points, winch, last=None):
        self.looks.append((points.copy(), winch.copy()))
        steps = (
            len(points) - last + np.arange(last)
        )  # of the episode, after which a cable is so long
        return np.repeat(steps[:, None], len(self.robot.cables), axis=1).astype(float)

    def wound(self, start, told, lengths=None, measured=None):
        self.used.append(lengths)
        return super().wound(start, told)


def test_cables_are_looked_at_now_and_then_and_are_as_long_as_last_seen_until_then(plant):
    class Often(Spy):
        def act(self, past: Past) -> Command:
            return Command(super().act(past).controls[:4])

    spy, reckoning = Often(plant.robot, DT), Looked(plant.robot, DT)
    points = recorded(
        plant, spy, seconds=0.6, seed=2, reckoning=reckoning
    ).trajectory.observations.points
    last, known = -np.inf, []
    for end in range(4, 61, 4):
        if looked := end * DT >= last + APART - 1e-9:
            last = end * DT
            known.append(end)
        rows = np.arange(end - 3, end + 1) if looked else np.full(4, known[-1])
        used = reckoning.used[end // 4 - 1]
        np.testing.assert_array_equal(used, np.tile(rows[:, None], (1, len(plant.robot.cables))))
    assert len(reckoning.looks) == len(known) == 5
    for end, (seen, winch) in zip(known, reckoning.looks, strict=True):
        np.testing.assert_array_equal(seen, points[: end + 1])
        np.testing.assert_array_equal(winch, spy.pasts[end // 4 - 1].winch[0, -1])


def test_the_same_seed_gives_the_same_episode_and_another_seed_another(plant: Plant) -> None:
    controller = RandomControls(plant.robot, DT)
    one, two, other = (recorded(plant, controller, None, NOISY, seed=s) for s in (5, 5, 6))
    np.testing.assert_array_equal(
        one.trajectory.observations.points, two.trajectory.observations.points
    )
    assert not np.array_equal(one.trajectory.controls, other.trajectory.controls)


def test_noise_does_not_change_what_an_open_loop_controller_does(plant: Plant) -> None:
    clean = recorded(plant, RandomControls(plant.robot, DT), None, EXACT, seed=5)
    noisy = recorded(plant, RandomControls(plant.robot, DT), None, NOISY, seed=5)
    np.testing.assert_array_equal(clean.trajectory.controls, noisy.trajectory.controls)


def easy_task(plant: Plant, metres: float, seconds: float = 60.0, tolerance: float = 0.05):
    """A goal that the settling robot is about to pass, or one that it never reaches."""
    start = plant.observe(plant.rest()).points[0]
    here = start[:, :2].mean(axis=0)
    config = TaskConfig(goal=tuple(here + (metres, 0)), tolerance=tolerance, seconds=seconds)
    return sample_task("reach", plant.robot, start, np.random.default_rng(0), config)


def test_an_episode_ends_at_the_first_step_at_which_the_true_robot_is_there(plant: Plant) -> None:
    free = recorded(plant, RandomControls(plant.robot, DT), seconds=6.0, seed=2)
    far = easy_task(plant, 0.0)
    way = far.place(plant.observe(free.trajectory.states).points)
    goal = way[450]
    task = dataclasses.replace(far, goal=goal, tolerance=0.02)
    first = int((np.linalg.norm(way - goal, axis=1) <= 0.02).argmax())
    assert 0 < first <= 450
    episode = recorded(plant, RandomControls(plant.robot, DT), task, NOISY, 6.0, seed=2)
    assert episode.outcome.success
    assert episode.trajectory.steps == first
    assert episode.outcome.seconds == pytest.approx(first * DT)
    assert episode.outcome.distance <= 0.02


def test_a_goal_not_reached_in_time_is_a_failure_with_its_distance(plant: Plant) -> None:
    task = easy_task(plant, 10.0, seconds=0.5)
    episode = recorded(plant, Hold(plant.robot, DT), task, seconds=3.0)
    assert not episode.outcome.success
    assert episode.outcome.seconds == pytest.approx(0.5)
    assert episode.outcome.distance == pytest.approx(10.0, abs=0.1)


def test_progress_is_told_and_can_end_the_recording(plant: Plant) -> None:
    told: list[int] = []
    recorded(plant, Spy(plant.robot, DT), on_piece=lambda piece: told.append(piece.done))
    assert told == [40, 80, 100]

    def stop(piece: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recorded(plant, Spy(plant.robot, DT), on_piece=stop)


@pytest.mark.parametrize(
    ("controls", "message"),
    [
        (np.full((3, 6), np.nan), "not finite"),
        (np.zeros((3, 5)), r"\(S, 6\) with S >= 1, got \(3, 5\)"),
        (np.zeros((0, 6)), r"got \(0, 6\)"),
        (np.zeros((1, 3, 6)), r"got \(1, 3, 6\)"),
    ],
)
def test_commands_that_do_not_fit_are_refused_by_name(plant: Plant, controls, message) -> None:
    class Wrong(Hold):
        name = "wrong"

        def act(self, past: Past) -> Command:
            return Command(controls)

    with pytest.raises(ModelError, match=f"wrong .*{message}"):
        recorded(plant, Wrong(plant.robot, DT))


def test_no_time_for_a_step_is_refused(plant: Plant) -> None:
    with pytest.raises(ConfigError, match="at least one step"):
        recorded(plant, Hold(plant.robot, DT), seconds=0.001)


def test_dropped_robots_are_whole_above_the_ground_and_turned_any_way(plant: Plant) -> None:
    robot, rng = plant.robot, np.random.default_rng(seed := draws.seed())
    drops = random_drop(plant, rng, 40)
    points, rest = plant.observe(drops).points, plant.observe(plant.rest()).points

    def apart(p: np.ndarray) -> np.ndarray:
        return np.linalg.norm(p[:, :, None] - p[:, None], axis=-1)

    np.testing.assert_allclose(apart(points), np.repeat(apart(rest), 40, axis=0), atol=1e-9)
    lowest = (points[..., 2] - robot.points[0].radius).min(axis=1)
    assert (lowest > 0).all() and lowest.max() < 0.5 * robot.length, seed
    up = (points[:, 1] - points[:, 0]) / np.linalg.norm(points[:, 1] - points[:, 0], axis=1)[
        :, None
    ]
    assert (np.abs(up.mean(axis=0)) < 0.45).all(), seed
    assert (up.max(axis=0) > 0.4).all() and (up.min(axis=0) < -0.4).all(), seed
    # and MuJoCo finds no cable stretched
    one = plant.simulate(drops, np.zeros((40, 1, 6))).states
    assert np.abs(one.qvel).max() < 1.0


def test_a_robot_that_hangs_cannot_be_dropped() -> None:
    hanging = Plant(load_robot("platform4"), DT)
    with pytest.raises(RobotError, match="cannot be dropped or carried: it hangs on cables"):
        random_drop(hanging, np.random.default_rng(0), 1)


@pytest.mark.slow
def test_the_oracle_comes_nearer_to_a_goal(plant: Plant) -> None:
    start = plant.observe(plant.rest()).points[0]
    task = sample_task(
        "reach", plant.robot, start, np.random.default_rng(0), TaskConfig(goal=(6.0, 0.0))
    )
    mppi = Mppi(PlantDynamics(plant), MppiConfig(samples=12, horizon_seconds=2.0), "oracle")
    episode = recorded(plant, mppi, task, seconds=6.0, seed=1)
    assert episode.outcome.distance < task.distance(start) - 0.3
    assert len(episode.telemetry["plan_seconds"]) == 12
    np.testing.assert_allclose(episode.plans.begins, np.arange(12) * 0.5)
    points = episode.trajectory.observations.points[:: round(0.5 / DT)]
    here = np.stack([episode.plans.at(t)[0, 0] for t in episode.plans.begins])
    np.testing.assert_allclose(here, task.place(points)[:12], atol=6e-4)


class Told(RandomControls):
    """Random controls that remember what they were told to do."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, DT)
        self.goals: list[list[float]] = []

    def reset(self, task, seed) -> None:
        super().reset(task, seed)
        self.goals.append(task.goal.tolist())


def test_a_tour_goes_on_to_the_next_goal_and_ends_at_the_last(plant: Plant) -> None:
    seed = draws.seed()
    points = plant.observe(plant.rest()).points[0]
    rng = np.random.default_rng(seed)
    tour = sample_task("tour", plant.robot, points, rng, TaskConfig(stops=2))
    here = dataclasses.replace(tour, goal=tour.place(points))  # reached at once
    told = Told(plant.robot)
    outcome = recorded(plant, told, here, seconds=0.3, seed=seed).outcome
    assert told.goals == [here.goal.tolist(), tour.last_goal.tolist()]
    assert outcome is not None and not outcome.success, seed
    left = np.linalg.norm(tour.place(points) - tour.last_goal)
    assert outcome.distance == pytest.approx(left, rel=0.2), seed
