from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pytest

from flywheel.dynamics.baselines import Persistence
from flywheel.errors import DataError, ModelError
from flywheel.evaluation import BINS, past_at, places, score, score_by, score_full
from flywheel.records import Observation, Past, Rollout
from tests import draws


@dataclass
class Drift:
    """Predicts the last observation moving along x at a given speed, and remembers its calls."""

    robot: object
    speed: float
    dt: float = 0.01
    history: int = 5
    calls: list = field(default_factory=list)

    def rollout(self, past: Past, controls) -> Rollout:
        self.calls.append((past, controls))
        lead = np.arange(controls.shape[1] + 1)[None, :, None, None] * self.dt
        shift = lead * np.array([self.speed, 0.0, 0.0])
        points = past.observations.points[:, -1:] + shift
        return Rollout(points, self.robot.dead_reckon(past.winch[:, -1], controls, self.dt))


def test_the_model_that_is_right_has_no_error(robot, make_episode):
    table = score(Drift(robot, 1.0), [make_episode("a", 300)], seed=1)
    assert table.e_pos_mse < 1e-20
    assert table.windows == 14
    assert table.steps == 200


def test_persistence_is_off_by_the_way_travelled(robot, make_episode):
    """Drift of 1 m/s, L = 2: at lead time t the squared error is t^2."""
    table = score(Persistence(robot, 0.01), [make_episode("a", 300)], horizon_seconds=1.0, seed=1)
    lead = 0.01 * np.arange(1, 101)
    assert table.e_pos_mse == pytest.approx(100 * np.mean(lead**2) / 2)
    assert table.by_lead_time()["e_pos_rmse"][-1] == pytest.approx(100 * 1.0 / 2)
    assert table.e_rot == 0.0


def test_the_same_seed_gives_the_same_starts_to_every_model(robot, make_episode):
    episodes = [make_episode(name, 400) for name in "ab"]
    short, long = Drift(robot, 1.0, history=2), Drift(robot, 0.0, history=30)
    for model in (short, long):
        score(model, episodes, seed=7)
    last = [m.calls[0][0].observations.points[:, -1] for m in (short, long)]
    np.testing.assert_array_equal(*last)
    other = Drift(robot, 1.0)
    score(other, episodes, seed=8)
    assert not np.array_equal(other.calls[0][0].observations.points[:, -1], last[0])


def test_scores_of_the_parts_add_up_to_the_score_of_the_whole(robot, make_episode):
    episodes = [make_episode(f"e{i}", 250 + 10 * i, seed=i) for i in range(5)]
    model = Drift(robot, 0.7)
    whole = score(model, episodes, seed=3)
    parts = [score(model, part, seed=3, batch=4) for part in (episodes[:2], episodes[2:])]
    assert parts[0] + parts[1] == whole


def test_all_windows_go_into_one_rollout_call(robot, make_episode):
    model = Drift(robot, 1.0)
    score(model, [make_episode(name, 300) for name in "abcd"], seed=0)
    assert [len(past.controls) for past, _ in model.calls] == [56]


def test_a_whole_episode_is_scored_to_its_own_end_and_not_beyond(robot, make_episode):
    episodes = [make_episode("a", 100), make_episode("b", 300)]
    table = score_full(Drift(robot, 1.0), episodes)
    assert table.steps == 250
    assert table.position.count[[0, 49, 50, 249], 0].tolist() == [2, 2, 1, 1]
    assert table.e_pos_mse < 1e-20


def test_errors_can_be_taken_against_given_truth(robot, make_episode):
    episode = make_episode("a", 300)
    table = score(
        Drift(robot, 1.0), [episode], seed=0, truth=lambda e: e.trajectory.observations.points + 0.1
    )
    assert table.e_pos_mse == pytest.approx(100 * 0.03 / 2)


def test_missing_measurements_are_not_scored(robot, make_episode):
    episode = make_episode("a", 300)
    points = episode.trajectory.observations.points.copy()
    points[250:, 0] = np.nan
    observations = Observation(points, episode.trajectory.observations.winch)
    broken = replace(episode, trajectory=replace(episode.trajectory, observations=observations))
    table = score_full(Drift(robot, 1.0), [broken])
    assert table.position.count[:, 0].sum() == 199
    assert table.position.count[:, 1].sum() == 250
    assert table.e_pos_mse < 1e-20


def hidden(episode, point, rows):
    """The episode without sight of one point."""
    points = episode.trajectory.observations.points.copy()
    points[rows, point] = np.nan
    observations = Observation(points, episode.trajectory.observations.winch)
    return replace(episode, trajectory=replace(episode.trajectory, observations=observations))


def test_no_prediction_starts_where_a_point_has_long_been_out_of_sight(robot, make_episode):
    episode = make_episode("a", 600)
    begin = int(np.random.default_rng(draws.seed()).integers(60, 150))
    broken = hidden(episode, 3, slice(begin, begin + 200))
    starts = places(broken, 200, 50)
    blind = np.arange(begin + 10, begin + 200)  # 0.1 s later the last sight of it is too old
    np.testing.assert_array_equal(starts, np.setdiff1d(np.arange(50, 401), blind))
    np.testing.assert_array_equal(places(episode, 200, 50), np.arange(50, 401))
    model = Persistence(robot, 0.01)
    assert score(model, [broken], starts_per_episode=200, seed=1).windows == 200


def test_an_episode_without_sight_of_a_point_has_no_windows_but_does_not_stop_the_others(
    robot, make_episode
):
    whole, blind = make_episode("a", 300), hidden(make_episode("b", 300), 2, slice(None))
    model = Persistence(robot, 0.01)
    alone, both = (score(model, found, seed=1) for found in ([whole], [whole, blind]))
    assert both.windows == alone.windows and both.e_pos_mse == alone.e_pos_mse
    with pytest.raises(DataError, match="all points are in sight"):
        score(model, [blind], seed=1)
    with pytest.raises(DataError, match="all points in sight"):
        score_full(model, [blind])


def test_a_whole_episode_is_predicted_from_where_all_points_are_in_sight(robot, make_episode):
    late = hidden(make_episode("a", 300), 1, slice(0, 120))
    table = score_full(Drift(robot, 1.0), [late])
    assert table.steps == 180
    assert table.e_pos_mse < 1e-20


def test_each_data_set_is_rolled_out_under_its_own_index(robot, make_episode):
    episodes = [make_episode("a", 300, dataset="x"), make_episode("b", 300, dataset="y")]
    model = Drift(robot, 1.0)
    score(model, episodes, seed=0, datasets={"x": 3, "y": 5})
    assert [past.dataset for past, _ in model.calls] == [3, 5]
    with pytest.raises(DataError, match=r"'y'.*Known: x"):
        score(model, episodes, seed=0, datasets={"x": 3})


def test_bins_split_the_episodes_and_add_up_again(robot, make_episode):
    episodes = [make_episode("a", 300, dataset="x"), make_episode("b", 300, dataset="y")]
    scorer = partial(score, Drift(robot, 0.5), seed=0)
    tables = score_by(BINS["dataset"], episodes, scorer)
    assert list(tables) == ["x", "y"]
    assert tables["x"] + tables["y"] == scorer(episodes)


def test_episodes_that_are_all_too_short_are_refused(robot, make_episode):
    with pytest.raises(DataError, match="long enough"):
        score(Drift(robot, 1.0), [make_episode("a", 100)], seed=0)
    with pytest.raises(DataError, match="long enough"):
        score(Drift(robot, 1.0), [], seed=0)


def test_an_episode_of_another_time_step_is_refused(robot, make_episode):
    with pytest.raises(DataError, match="dt"):
        score(Drift(robot, 1.0, dt=0.02), [make_episode("a", 500)], seed=0)


def test_a_prediction_that_is_not_finite_is_an_error(robot, make_episode):
    with pytest.raises(ModelError, match="finite"):
        score(Drift(robot, np.nan), [make_episode("a", 300)], seed=0)


def test_a_start_before_the_history_is_padded_by_rest(robot, make_episode):
    episode = make_episode("a", 300)
    winch = robot.known_winch(
        episode.trajectory.observations.winch, episode.trajectory.controls, 0.01
    )
    past = past_at(episode, robot, 3, 10, winch)
    assert past.observations.points.shape == (1, 11, 5, 3)
    np.testing.assert_array_equal(past.controls[0, :7], 0.0)
    np.testing.assert_array_equal(past.controls[0, 7:], episode.trajectory.controls[:3])


def test_unmeasured_winches_are_dead_reckoned_from_the_keyframe(robot):
    controls = np.full((2, 4, 1), 0.5)
    got = robot.known_winch(np.full((2, 5, 1), np.nan), controls, 0.01)
    np.testing.assert_allclose(got[:, :, 0], [0.7 + 0.005 * np.arange(5)] * 2)
    measured = np.random.default_rng(draws.seed()).uniform(0.3, 1.0, (2, 5, 1))
    np.testing.assert_array_equal(robot.known_winch(measured, controls, 0.01), measured)


def test_a_winch_that_is_measured_now_and_then_is_reckoned_on_from_there(robot):
    controls = np.full((4, 1), 0.5)
    seen = np.array([[np.nan], [np.nan], [0.9], [np.nan], [0.8]])
    got = robot.known_winch(seen, controls, 0.01)
    np.testing.assert_allclose(got[:, 0], [0.7, 0.705, 0.9, 0.905, 0.8])


def test_persistence_falls_back_to_where_a_point_was_last_seen(robot, resting):
    points = np.stack([resting, resting + 1.0, resting + 2.0])[None].copy()
    points[0, 1:, 0] = np.nan
    past = Past(
        Observation(points, np.full((1, 3, 1), np.nan)),
        np.zeros((1, 2, 1)),
        np.full((1, 3, 1), 0.7),
    )
    got = Persistence(robot, 0.01).rollout(past, np.full((4, 6, 1), 0.5))
    assert got.points.shape == (4, 7, 5, 3)
    np.testing.assert_array_equal(got.points[2, 5, 0], resting[0])
    np.testing.assert_array_equal(got.points[2, 5, 1], resting[1] + 2.0)
    np.testing.assert_allclose(got.winch[0, -1], 0.73)


def test_persistence_refuses_a_point_that_was_never_seen(robot, resting):
    points = np.stack([resting, resting])[None].copy()
    points[0, :, 4] = np.nan
    past = Past(
        Observation(points, np.full((1, 2, 1), np.nan)),
        np.zeros((1, 1, 1)),
        np.full((1, 2, 1), 0.7),
    )
    with pytest.raises(ModelError, match="not seen"):
        Persistence(robot, 0.01).rollout(past, np.zeros((1, 3, 1)))
